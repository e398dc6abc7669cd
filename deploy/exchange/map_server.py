"""A map as the grid of ROS's map_server: a picture (PGM) whose grey says occupied, free or unknown, and its YAML.

ROS 2's nav2_map_server documents both, mode `trinary`: occupied is darker than `occupied_thresh`, free is brighter than
`free_thresh`. The picture's first row is the highest y; `origin` is the lower left corner of the lower left cell.
"""

from __future__ import annotations

import math

import numpy as np
import shapely
import yaml
from numpy.typing import NDArray

from agent.geometry.cells import CELL_M, MARGIN_CELLS, wall_cells
from deploy.exchange.maps import NamedMap
from protocol.errors import InputError
from protocol.text import printable

OCCUPIED, FREE, UNKNOWN = 0, 254, 205  # greys, as map_saver writes them
OCCUPIED_THRESHOLD, FREE_THRESHOLD = 0.65, 0.196  # of darkness, 0 to 1; UNKNOWN has 0.19608
MAX_CELLS = 50_000_000  # a square of 350 m


def pgm(named: NamedMap) -> bytes:
    """The picture, binary PGM."""
    grid = cells(named)[::-1]
    height, width = grid.shape
    head = f"P5\n# unit: m a cell {CELL_M}; frame: {printable(named.frame)}\n{width} {height}\n255\n"
    return head.encode("ascii", "replace") + grid.tobytes()


def description(named: NamedMap) -> str:
    """The YAML beside it."""
    (x0, y0), _ = _box(named)
    image = {"image": f"{named.name}.pgm"}
    quoted = yaml.safe_dump(image, allow_unicode=True, width=math.inf)  # where it must be
    return (
        f"# unit: m, rad; frame: {printable(named.frame)}\n"
        f"{quoted}mode: trinary\nresolution: {CELL_M}\norigin: [{x0:.4f}, {y0:.4f}, 0.0]\n"
        f"negate: 0\noccupied_thresh: {OCCUPIED_THRESHOLD}\nfree_thresh: {FREE_THRESHOLD}\n"
    )


def cells(named: NamedMap) -> NDArray[np.uint8]:
    """(ny, nx) greys, row 0 the lowest y: cells that a wall crosses are occupied."""
    (x0, y0), (nx, ny) = _box(named)
    grid = np.full((ny, nx), UNKNOWN, np.uint8)
    x, y = np.meshgrid(x0 + CELL_M * (np.arange(nx) + 0.5), y0 + CELL_M * (np.arange(ny) + 0.5))
    free = named.free
    shapely.prepare(free)
    grid[shapely.contains_xy(free, x, y)] = FREE
    walls = named.walls
    column, row = wall_cells(walls, (x0, y0)).T
    grid[row, column] = OCCUPIED
    return grid


def _box(named: NamedMap) -> tuple[tuple[float, float], tuple[int, int]]:
    """Lower left corner, a multiple of the cell, and numbers of cells along x and y; all walls and views are in it."""
    points = np.vstack([named.map.vertices, named.viewpoints, np.zeros((0 if len(named.map.vertices) else 1, 2))])
    ends = np.floor(shapely.total_bounds([shapely.MultiPoint(points), named.free]) / CELL_M)
    low, high = ends[:2] - MARGIN_CELLS, ends[2:] + MARGIN_CELLS + 1
    nx, ny = (high - low).astype(int).tolist()
    if nx * ny > MAX_CELLS:
        size = f"{nx * CELL_M:.0f} m x {ny * CELL_M:.0f} m"
        raise InputError(f"what {named.robot} has seen is {size}: too large for a grid")
    x0, y0 = (low * CELL_M).tolist()
    return (x0, y0), (nx, ny)
