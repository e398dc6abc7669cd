"""Equal storage: an occupancy grid against the wireframe, from the same scans and poses.

In doubt the grid is favoured: it covers just the true outline's bounding box, costs no header, is made with full
log-odds and only then counted as two bits a cell (free, unknown, occupied), and each of its occupied cells counts as
a piece of wall as long as the cell in the direction of the true wall nearest to it.
"""

import math
import zlib

import numpy as np
import shapely

from deploy.bench.cases import Case, Figures, each
from deploy.bench.filter.recording import ScanRecording, record
from deploy.bench.layouts import present
from deploy.bench.tables import Outcomes, Row, Table, by_label
from deploy.metrics import Truth, score_walls
from deploy.occupancy_grid import CELLS_PER_BYTE, OccupancyGrid, two_bits
from protocol.walls import directions
from protocol.wireframe import encode_wireframe
from world.lidar.lidar import Lidar

FINEST_M = 0.005  # cells are not made smaller: half the range noise


def measure_storage(world: str, limit_s: float) -> Figures:
    """Scores of the wireframe and of grids of its sizes in bytes."""
    run = record(world, 0, limit_s=limit_s)
    mind = run.new_filter()
    for tick in range(len(run.scans)):
        run.show(mind, tick)
    wireframe = mind.wireframe()
    codec = len(encode_wireframe(wireframe))
    sizes = {"codec": codec, "one particle": round(mind.nbytes / len(mind.edges)), "whole filter": mind.nbytes}
    grids = {which: (size, _grid(run, _cell_for(run, size))) for which, size in sizes.items()}
    grids["codec, zlib"] = codec, _compressed_grid(run, codec)
    ours = score_walls(wireframe.segments(), run.truth)._asdict()
    return {"rows": [{"storage": which, **_row(ours, *grid, run.truth)} for which, grid in grids.items()]}


def _box(run: ScanRecording) -> tuple[float, float, float, float]:
    points = run.truth.outline.reshape(-1, 2)
    (x0, y0), (x1, y1) = points.min(0).tolist(), points.max(0).tolist()
    return x0, y0, x1, y1


def _cell_for(run: ScanRecording, size: int) -> float:
    """Cell size of the finest grid over the box that takes no more than so many bytes."""
    x0, y0, x1, y1 = _box(run)
    cell = math.sqrt((x1 - x0) * (y1 - y0) / (size * CELLS_PER_BYTE))
    while math.ceil((x1 - x0) / cell) * math.ceil((y1 - y0) / cell) > size * CELLS_PER_BYTE:
        cell *= 1.002
    return max(cell, FINEST_M)


def _grid(run: ScanRecording, cell_m: float) -> OccupancyGrid:
    rays = Lidar(np.zeros((0, 4)), run.spec.lidar).rays(np.array(run.poses))
    return OccupancyGrid(_box(run), cell_m, run.spec.lidar.range_max_m).add(run.ranges, rays)


def _compressed_grid(run: ScanRecording, size: int) -> OccupancyGrid:
    """The finest grid that takes no more than so many bytes after zlib."""
    low, high = FINEST_M, _cell_for(run, size)
    best = _grid(run, high)
    while high - low > 0.02 * low:
        cell = math.sqrt(low * high)
        grid = _grid(run, cell)
        if len(zlib.compress(two_bits(grid.states()), 9)) <= size:
            best, high = grid, cell
        else:
            low = cell
    return best


def _row(ours: Figures, size: int, grid: OccupancyGrid, truth: Truth) -> Row:
    """Score of the occupied cells of a grid of that size in bytes, beside ours."""
    cells = grid.occupied()
    lines = shapely.linestrings(truth.outline.reshape(-1, 2, 2))
    nearest = shapely.STRtree(lines).nearest(shapely.points(cells)) if len(cells) else np.zeros(0, np.intp)
    half = 0.5 * grid.cell_m * directions(truth.outline[nearest])
    walls: Figures = score_walls(np.hstack([cells - half, cells + half]), truth)._asdict()
    row: Row = {"bytes": size, "cell_m": grid.cell_m, "ours_rmse_m": ours["rmse_m"]}
    row |= {f"grid_{key}": walls[key] for key in ("recall", "precision", "rmse_m")}
    row |= {f"{key}_ahead": ours[key] - walls[key] for key in ("recall", "precision")}
    return row | {"rmse_ahead_m": walls["rmse_m"] - ours["rmse_m"]}


def cases(quick: bool) -> list[Case]:
    """A few layouts."""
    more = ["maze-15", "office", "apartment", *present(["drlnav_stage7", "gbeltramo_building"])]
    limit_s = 100.0 if quick else 3600.0
    return each("storage/{world}", measure_storage, {"limit_s": limit_s}, world=["apartment"] if quick else more)


def _rows(figures: Outcomes) -> list[Row]:
    """A row a layout and size."""
    found = by_label(figures, "storage/{world}").items()
    return [{"world": world} | row for world, (run,) in found for row in run["rows"]]


TABLES = [
    Table(
        "storage",
        "Equal storage: occupancy grid against wireframe",
        _rows,
        "world; storage; bytes; cell_m: grid's cell m; ours_rmse_m: our rmse m; grid_rmse_m: grid's rmse m; "
        "rmse_ahead_m >= 0.0001; recall_ahead >= -0.01; precision_ahead >= -0.01; grid_recall: grid's recall; "
        "grid_precision: grid's precision",
        judged=lambda row: row["storage"] in ("codec", "one particle"),
        note="Grid: 2 bits a cell over the outline's bounding box; occupied cells get the true wall's direction. "
        "Ideal sensing.",
        sensing="ideal",
    )
]
