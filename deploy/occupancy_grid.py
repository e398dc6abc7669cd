"""An occupancy grid from scans at known poses, as the textbooks make it: what a wireframe is compared with.

Log-odds per cell; a beam adds evidence for free space in the cells that it crosses and for a wall in the one where it
ends. Within one scan an end outweighs crossings of the same cell, as in OctoMap: else grazing beams erase walls.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agent.kernels import kernel
from protocol.arrays import Floats

HIT, MISS = 0.85, -0.4
"""Log-odds of one scan: OctoMap's defaults, probabilities 0.7 and 0.4."""
LOW, HIGH = -2.0, 3.5
"""Clamp: OctoMap's defaults, probabilities 0.12 and 0.97."""
CELLS_PER_BYTE = 4
"""Two bits hold a cell's state."""


class Grid(NamedTuple):
    """Log-odds of being occupied; 0 is unknown."""

    corner: tuple[float, float]
    """m, outer corner of cell (0, 0)."""
    cell_m: float
    log_odds: Floats
    """(nx, ny)."""

    def occupied(self) -> Floats:
        """(n, 2) middles of the cells that are rather occupied than free, metres."""
        cells = np.argwhere(self.log_odds > 0)
        middles: Floats = (cells + 0.5) * self.cell_m + np.array(self.corner)
        return middles

    def states(self) -> NDArray[np.uint8]:
        """(nx, ny) 0 unknown, 1 free, 2 occupied: what two bits a cell hold."""
        return np.where(self.log_odds > 0, 2, np.where(self.log_odds < 0, 1, 0)).astype(np.uint8)


def two_bits(states: NDArray[np.uint8]) -> bytes:
    """States of cells (see `Grid.states`), four a byte, the first in the lowest bits."""
    padded = np.zeros((-(-states.size // CELLS_PER_BYTE), CELLS_PER_BYTE), np.uint8)
    padded.reshape(-1)[: states.size] = states.reshape(-1)
    packed: NDArray[np.uint8] = (padded << np.array([0, 2, 4, 6], np.uint8)).sum(1).astype(np.uint8)
    return packed.tobytes()


class GrowingGrid:
    """A grid that takes scans as they come."""

    def __init__(self, box: tuple[float, float, float, float], cell_m: float, range_max_m: float) -> None:
        """box: x0, y0, x1, y1 in metres; what is seen beyond is not kept."""
        x0, y0, x1, y1 = box
        shape = max(1, math.ceil((x1 - x0) / cell_m)), max(1, math.ceil((y1 - y0) / cell_m))
        self.grid = Grid((x0, y0), cell_m, np.zeros(shape))
        self._range_max_m = range_max_m
        self._marks = np.zeros(shape, np.int64)
        self._scans = 0

    def add(self, ranges: Floats, poses: Floats) -> None:
        """Take scans (t, beams) at poses (t, 3); inf: nothing within range, nan: nothing known."""
        log_odds, (x0, y0), cell_m = self.grid.log_odds, self.grid.corner, self.grid.cell_m
        _integrate(log_odds, self._marks, self._scans, ranges, poses, self._range_max_m, x0, y0, cell_m)
        self._scans += len(poses)


def grid_of(
    ranges: Floats, poses: Floats, range_max_m: float, box: tuple[float, float, float, float], cell_m: float
) -> Grid:
    """Grid over a box (x0, y0, x1, y1) from ranges (t, beams), inf: nothing within range_max_m, at poses (t, 3)."""
    grid = GrowingGrid(box, cell_m, range_max_m)
    grid.add(ranges, poses)
    return grid.grid


@kernel
def _integrate(
    log_odds: Floats,
    mark: NDArray[np.int64],
    first: int,
    ranges: Floats,
    poses: Floats,
    range_max: float,
    x0: float,
    y0: float,
    cell: float,
) -> None:
    """Add all scans, of which the first is scan `first`.

    mark: the last scan t to touch a cell, 2 t + 1 where it crossed it, 2 t + 2 where it ended there.
    """
    nx, ny = log_odds.shape
    beams = ranges.shape[1]
    for t in range(first, first + len(poses)):
        x, y, theta = poses[t - first]
        for b in range(beams):  # ends first: they outweigh crossings
            r = ranges[t - first, b]
            if not math.isfinite(r):
                continue
            angle = theta + 2 * math.pi * b / beams
            i = math.floor((x + r * math.cos(angle) - x0) / cell)
            j = math.floor((y + r * math.sin(angle) - y0) / cell)
            if 0 <= i < nx and 0 <= j < ny and mark[i, j] < 2 * t + 2:
                mark[i, j] = 2 * t + 2
                log_odds[i, j] = min(log_odds[i, j] + HIT, HIGH)
        for b in range(beams):
            angle = theta + 2 * math.pi * b / beams
            c, s = math.cos(angle), math.sin(angle)
            r = 0.0 if math.isnan(ranges[t - first, b]) else min(ranges[t - first, b], range_max)
            i, j = math.floor((x - x0) / cell), math.floor((y - y0) / cell)
            step_i, step_j = (1 if c > 0 else -1), (1 if s > 0 else -1)
            # range at which the beam leaves the cell, and how much farther each next cell is
            next_i = ((i + (c > 0)) * cell + x0 - x) / c if c != 0 else math.inf
            next_j = ((j + (s > 0)) * cell + y0 - y) / s if s != 0 else math.inf
            width_i = cell / abs(c) if c != 0 else math.inf
            width_j = cell / abs(s) if s != 0 else math.inf
            while min(next_i, next_j) < r:  # the cell in which the beam ends is not crossed
                if 0 <= i < nx and 0 <= j < ny and mark[i, j] < 2 * t + 1:
                    mark[i, j] = 2 * t + 1
                    log_odds[i, j] = max(log_odds[i, j] + MISS, LOW)
                if next_i < next_j:
                    i += step_i
                    next_i += width_i
                else:
                    j += step_j
                    next_j += width_j
