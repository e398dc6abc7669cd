"""What two robots know from hearing each other: they are within radio range, and each stands in free space (ours)."""

import math
from dataclasses import dataclass

import numpy as np

from agent.geometry.chains import chains_of
from agent.geometry.clearance import distances_to_walls
from agent.geometry.transform import compose, inverse
from protocol.arrays import Bools, Floats, Ints
from protocol.geometry import Pose

RANGE_SLACK_M = 0.3  # a peer may be this far beyond the radio's range: both robots move while a message is under way
BODY_SLACK_M = 0.03  # a body may overlap a mapped wall by so much: 3 sigma of a corner


@dataclass(frozen=True)
class Place:
    """Where a robot can be by one map: clear of walls, inside outer rings of walls and outside inner ones."""

    walls: Floats  # (m, 4) x1, y1, x2, y2 in metres
    rings: list[Floats]  # (k, 4) walls of each closed ring, free space on their left

    def reachable(self, points: Floats, clearance_m: float) -> Bools:
        """(n,) whether points (n, 2) can be a robot's centre."""
        free = distances_to_walls(points, self.walls) >= clearance_m
        x, y = points[:, :1], points[:, 1:]
        for ring in self.rings:
            ax, ay, bx, by = ring.T
            with np.errstate(divide="ignore", invalid="ignore"):  # a wall along x crosses no line along x
                crossed = ((ay > y) != (by > y)) & (x < ax + (y - ay) / (by - ay) * (bx - ax))
            outer = (ax * by - bx * ay).sum() > 0
            free &= (crossed.sum(1) % 2 == 1) == outer
        return free


def place_of(points: Floats, parent: Ints, child: Ints, walls: Floats) -> Place:
    """Place by a map's vertices (n, 2), the vertices before and after each (n,) or -1, and its walls (m, 4)."""
    rings = [points[chain] for chain in chains_of(parent, child) if len(chain) > 1 and chain[0] == chain[-1]]
    return Place(walls, [np.hstack([ring[:-1], ring[1:]]) for ring in rings])


@dataclass(frozen=True)
class Meeting:
    """Both robots at the moment of contact."""

    mine: Pose  # the robot that aligns, in its own frame
    theirs: Pose  # the peer, in the peer's frame
    range_m: float = math.inf  # how far the radio carries; inf where unknown
    radius_m: float = 0.0  # of the body of either robot

    def possible(self, transforms: Floats, here: Place, there: Place) -> Bools:
        """(k,) whether transforms (k, 3) put both in range and in free space; here, there: by my map and by theirs."""
        clearance = max(self.radius_m - BODY_SLACK_M, 0.0)
        peer = compose(transforms, np.array(self.theirs))[:, :2]
        me = compose(inverse(transforms), np.array(self.mine))[:, :2]
        away = np.hypot(peer[:, 0] - self.mine[0], peer[:, 1] - self.mine[1])
        out: Bools = (away <= self.range_m + RANGE_SLACK_M) & (away >= 2 * clearance)
        out[out] = here.reachable(peer[out], clearance)
        out[out] = there.reachable(me[out], clearance)
        return out
