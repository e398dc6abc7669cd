"""An occupancy grid from scans at known poses, as the textbooks make it: what a wireframe is compared with.

Log-odds per cell; a beam adds evidence for free space in the cells that it crosses and for a wall in the one where it
ends. Within one scan an end outweighs crossings of the same cell, as in OctoMap: else grazing beams erase walls.
"""

import math
from typing import Self

import numpy as np
from numpy.typing import NDArray

from agent.kernels import kernel
from protocol.arrays import Floats, Ints
from protocol.errors import InputError

HIT, MISS = 0.85, -0.4  # log-odds of one scan: OctoMap's defaults, probabilities 0.7 and 0.4
LOW, HIGH = -2.0, 3.5  # clamp: OctoMap's defaults, probabilities 0.12 and 0.97
MAX_CELLS = 64_000_000  # 1 GB: 400 m x 400 m of cells of 5 cm, four times the largest world
CELLS_PER_BYTE = 4  # two bits hold a cell's state
Point = tuple[float, float]
States = NDArray[np.uint8]  # of cells: 0 unknown, 1 free, 2 occupied


def two_bits(states: States) -> bytes:
    """States of cells, four a byte, the first in the lowest bits."""
    padded = np.pad(states.reshape(-1), (0, -states.size % CELLS_PER_BYTE)).reshape(-1, CELLS_PER_BYTE)
    packed: States = (padded << np.array([0, 2, 4, 6], np.uint8)).sum(1).astype(np.uint8)
    return packed.tobytes()


class OccupancyGrid:
    """Log-odds of being occupied over a box, from scans as they come; 0 is unknown."""

    def __init__(self, box: tuple[float, float, float, float], cell_m: float, range_max_m: float) -> None:
        """box: x0, y0, x1, y1 in metres; what is seen beyond is not kept.

        Raises InputError for one of too many cells.
        """
        x0, y0, x1, y1 = box
        self.corner, self.cell_m = (x0, y0), cell_m
        nx, ny = (max(1, math.ceil(side_m / cell_m)) for side_m in (x1 - x0, y1 - y0))
        if nx * ny > MAX_CELLS:
            raise InputError(f"a grid of {x1 - x0:,.0f} m x {y1 - y0:,.0f} m has more than {MAX_CELLS:,} cells")
        self.log_odds = np.zeros((nx, ny))
        self._range_max_m = range_max_m
        self._marks = np.zeros(self.log_odds.shape, np.int64)
        self._scans = 0

    def add(self, ranges: Floats, rays: Floats) -> Self:
        """Take scans (t, beams) whose beams begin and point as `Lidar.rays` (t, beams, 3) says. Returns the grid.

        inf: nothing within range; nan: nothing known.
        """
        place = self._range_max_m, self.corner, self.cell_m
        _integrate(self.log_odds, self._marks, self._scans, ranges, rays, *place)
        self._scans += len(rays)
        return self

    def occupied(self) -> Floats:
        """(n, 2) middles of the cells that are rather occupied than free, metres."""
        middles: Floats = (np.argwhere(self.log_odds > 0) + 0.5) * self.cell_m + np.array(self.corner)
        return middles

    def states(self) -> States:
        """(nx, ny) of all cells."""
        return np.where(self.log_odds > 0, 2, np.where(self.log_odds < 0, 1, 0)).astype(np.uint8)


@kernel
def _integrate(
    log_odds: Floats, mark: Ints, first: int, ranges: Floats, rays: Floats, reach: float, corner: Point, cell: float
) -> None:
    """Add all scans, of which the first is scan `first`.

    mark: the last scan t to touch a cell, 2 t + 1 where it crossed it, 2 t + 2 where it ended there.
    """
    (x0, y0), (nx, ny) = corner, log_odds.shape
    beams = ranges.shape[1]
    for t in range(first, first + len(rays)):
        for b in range(beams):  # ends first: they outweigh crossings
            r = ranges[t - first, b]
            if not math.isfinite(r):
                continue
            x, y, angle = rays[t - first, b]
            i = math.floor((x + r * math.cos(angle) - x0) / cell)
            j = math.floor((y + r * math.sin(angle) - y0) / cell)
            if 0 <= i < nx and 0 <= j < ny and mark[i, j] < 2 * t + 2:
                mark[i, j] = 2 * t + 2
                log_odds[i, j] = min(log_odds[i, j] + HIT, HIGH)
        for b in range(beams):
            x, y, angle = rays[t - first, b]
            c, s = math.cos(angle), math.sin(angle)
            r = 0.0 if math.isnan(ranges[t - first, b]) else min(ranges[t - first, b], reach)
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
