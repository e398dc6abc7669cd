"""Rectilinear mazes from a seed: corridors, a few rooms, and loops."""

import math
import re
from typing import Any

import numpy as np

GENERATED = re.compile(r"generated-(\d{1,3})x(\d{1,3})-(\d{1,9})")
"""Name of a generated world: generated-WIDTHxHEIGHT-SEED, sides in metres."""
MIN_SIDE_M, MAX_SIDE_M = 8.0, 100.0  # smaller mazes have no branches; larger ones have more wall than a world may

CORRIDOR_M, THICKNESS_M = 2.0, 0.15  # width of corridors, about, and of walls where nothing else is asked for
SPAWNS = 6


def named(name: str) -> dict[str, Any] | None:
    """Fields of a maze's world file by its name, None for a name of another form; raises ValueError as `generate`."""
    if not (given := GENERATED.fullmatch(name)):
        return None
    width, height, seed = map(int, given.groups())
    return generate(width, height, np.random.default_rng(seed)) | {"name": name}


def generate(
    width_m: float, height_m: float, rng: np.random.Generator, *, loops: float = 0.15, thickness_m: float = THICKNESS_M
) -> dict[str, Any]:
    """Fields of a world file with a maze of this outer size, lower left corner at the origin (ours).

    A depth-first maze on cells of about CORRIDOR_M; then the share `loops` of the walls that it left is opened.
    Spawns lie in the middle of distinct cells. Raises ValueError for a side that is not 8 to 100 m.
    """
    for side in (width_m, height_m):
        if not MIN_SIDE_M <= side <= MAX_SIDE_M:
            raise ValueError(f"a maze has sides of {MIN_SIDE_M:g} to {MAX_SIDE_M:g} m, not {side:g} m")
    columns, rows = (round((side - thickness_m) / (CORRIDOR_M + thickness_m)) for side in (width_m, height_m))
    pitch = np.array([(width_m - thickness_m) / columns, (height_m - thickness_m) / rows])
    # east[i, j]: a wall between cells (i, j) and (i + 1, j); north[i, j]: between (i, j) and (i, j + 1)
    east, north = np.ones((columns - 1, rows), bool), np.ones((columns, rows - 1), bool)
    _carve(east, north, rng)
    for walls in (east, north):
        left = np.argwhere(walls)
        opened = rng.permutation(len(left))[: round(loops * len(left))]
        walls[tuple(left[opened].T)] = False

    half = thickness_m / 2
    # grid lines on even millimetres, so that centres and lengths are short numbers and walls stay flush
    lines_x, lines_y = (
        np.round((half + np.arange(n + 1) * step) / 0.002) * 0.002
        for n, step in ((columns, pitch[0]), (rows, pitch[1]))
    )
    boxes = []

    def wall(i0: int, j0: int, i1: int, j1: int) -> None:
        """A box along the line from one grid corner to another; both ends fill their corner."""
        x0, x1, y0, y1 = lines_x[i0], lines_x[i1], lines_y[j0], lines_y[j1]
        yaw = 0.0 if j0 == j1 else round(math.pi / 2, 12)
        length = abs(x1 - x0) + abs(y1 - y0) + thickness_m
        boxes.append([_mm((x0 + x1) / 2), _mm((y0 + y1) / 2), yaw, _mm(length), thickness_m])

    for ends in ((0, 0, columns, 0), (0, rows, columns, rows), (0, 0, 0, rows), (columns, 0, columns, rows)):
        wall(*ends)
    for i in range(columns - 1):
        for low, high in _runs(east[i]):
            wall(i + 1, low, i + 1, high)
    for j in range(rows - 1):
        for low, high in _runs(north[:, j]):
            wall(low, j + 1, high, j + 1)

    cells = rng.permutation(columns * rows)[:SPAWNS]
    middles = half + (np.stack([cells % columns, cells // columns], 1) + 0.5) * pitch
    spawns = [[_mm(x), _mm(y), _mm(rng.uniform(-math.pi, math.pi))] for x, y in middles.tolist()]
    return {"name": f"maze-{width_m:g}x{height_m:g}", "units": "m", "spawns": spawns, "boxes": boxes}


def _carve(east: np.ndarray[Any, Any], north: np.ndarray[Any, Any], rng: np.random.Generator) -> None:
    """Open walls so that every cell is reached on exactly one way (depth first)."""
    columns, rows = north.shape[0], east.shape[1]
    seen = np.zeros((columns, rows), bool)
    path = [(int(rng.integers(columns)), int(rng.integers(rows)))]
    seen[path[0]] = True
    while path:
        i, j = path[-1]
        around = ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1))
        ways = [(u, v) for u, v in around if 0 <= u < columns and 0 <= v < rows and not seen[u, v]]
        if not ways:
            path.pop()
            continue
        u, v = ways[int(rng.integers(len(ways)))]
        if u != i:
            east[min(i, u), j] = False
        else:
            north[i, min(j, v)] = False
        seen[u, v] = True
        path.append((u, v))


def _runs(walls: np.ndarray[Any, Any]) -> list[tuple[int, int]]:
    """Begin and end of each run of walls in a row."""
    steps = np.flatnonzero(np.diff(np.concatenate([[0], walls.astype(int), [0]])))
    return [(int(a), int(b)) for a, b in zip(steps[::2], steps[1::2], strict=True)]


def _mm(value: float) -> float:
    """Rounded to a tenth of a millimetre."""
    return round(float(value), 4)
