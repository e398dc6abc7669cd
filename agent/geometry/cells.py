"""Walls as cells of a grid, for programs that take grids."""

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Floats
from protocol.walls import directions, lengths, points_along

CELL_M = 0.05  # of such grids, as in most maps of Nav2
MARGIN_CELLS = 4  # around the walls of such a grid
ASIDE_M = 1e-6  # a wall on the line between two cells belongs to the one that is solid
SAMPLES = 4  # of a wall in the length of a cell


def wall_cells(walls: Floats, corner: tuple[float, float]) -> NDArray[np.int64]:
    """(k, 2) column and row, from a grid's lower left corner, of all cells that walls (m, 4) cross; metres.

    The grid's cells are CELL_M wide. The free side of walls is on their left. A cell may come several times.
    """
    points, wall = points_along(walls, np.ceil(lengths(walls) / CELL_M * SAMPLES).astype(np.int64) + 1)
    along = directions(walls)[wall]
    solid = points + ASIDE_M * np.stack([along[:, 1], -along[:, 0]], 1)
    return np.floor((solid - corner) / CELL_M).astype(np.int64)
