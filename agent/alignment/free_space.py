"""Where a robot can stand by a map: clear of its walls, inside outer rings of them and outside inner ones (ours)."""

from dataclasses import dataclass

import numpy as np

from agent.geometry.chains import chains_of
from agent.geometry.clearance import distances_to_walls
from protocol.arrays import Bools, Floats, Ints


@dataclass(frozen=True)
class FreeSpace:
    """The ground of a map that its walls leave free."""

    walls: Floats  # (m, 4) x1, y1, x2, y2 in metres
    rings: list[Floats]  # (k, 4) walls of each closed ring, free space on their left

    def holds(self, points: Floats, clearance_m: float) -> Bools:
        """(n,) whether a robot's centre can be at points (n, 2)."""
        free = distances_to_walls(points, self.walls) >= clearance_m
        x, y = points[:, :1], points[:, 1:]
        for ring in self.rings:
            ax, ay, bx, by = ring.T
            with np.errstate(divide="ignore", invalid="ignore"):  # a wall along x crosses no line along x
                crossed = ((ay > y) != (by > y)) & (x < ax + (y - ay) / (by - ay) * (bx - ax))
            outer = (ax * by - bx * ay).sum() > 0
            free &= (crossed.sum(1) % 2 == 1) == outer
        return free


def free_space_of(points: Floats, parent: Ints, child: Ints, walls: Floats) -> FreeSpace:
    """Free space by a map's vertices (n, 2), the vertices before and after each (n,) or -1, and its walls (m, 4)."""
    rings = [points[chain] for chain in chains_of(parent, child) if len(chain) > 1 and chain[0] == chain[-1]]
    return FreeSpace(walls, [np.hstack([ring[:-1], ring[1:]]) for ring in rings])
