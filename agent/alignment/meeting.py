"""What two robots know from hearing each other: they are within radio range, and each stands in free space (ours)."""

import math
from dataclasses import dataclass

import numpy as np

from agent.geometry.clearance import distances_to_walls
from agent.geometry.transform import compose, inverse
from agent.kernels import kernel
from protocol.arrays import Bools, Floats, Ints
from protocol.geometry import Pose

RANGE_SLACK_M = 0.3
"""A peer may be this much beyond the radio's range, as both robots move while a message is under way."""
BODY_SLACK_M = 0.03
"""A body may overlap a mapped wall by this: 3 sigma of a corner."""


@dataclass(frozen=True)
class Place:
    """Where a robot can be by one map: clear of walls, inside outer rings of walls and outside inner ones."""

    walls: Floats
    """(m, 4) x1, y1, x2, y2 in metres."""
    rings: Floats
    """(k, 4) those of the walls that belong to closed rings."""
    ring: Ints
    """(k,) which ring each belongs to, ascending from 0."""
    outer: Bools
    """(rings,) whether free space is inside."""

    def reachable(self, points: Floats, clearance_m: float) -> Bools:
        """(n,) whether points (n, 2) can be a robot's centre."""
        clear = distances_to_walls(points, self.walls) >= clearance_m
        return np.asarray(clear & _on_the_free_side(points, self.rings, self.ring, self.outer), np.bool_)


def place_of(points: Floats, child: Ints, walls: Floats) -> Place:
    """Place by a map's vertices (n, 2), the vertex after each (n,) or -1, and its walls (m, 4)."""
    ring_of, count = _rings(child)
    members = np.flatnonzero(ring_of >= 0)
    members = members[np.argsort(ring_of[members], kind="stable")]
    rings = np.hstack([points[members], points[child[members]]])
    twice_area = rings[:, 0] * rings[:, 3] - rings[:, 2] * rings[:, 1]
    area = np.bincount(ring_of[members], twice_area, minlength=count)
    return Place(walls, rings, ring_of[members], area > 0)


@kernel
def _rings(child: Ints) -> tuple[Ints, int]:
    """(n,) the closed ring that each vertex belongs to, or -1, and how many there are."""
    n = child.shape[0]
    ring, seen = np.full(n, -1), np.zeros(n, np.int64)
    count = 0
    for start in range(n):
        v = start
        while v >= 0 and seen[v] == 0:
            seen[v] = start + 1
            v = child[v]
        if v >= 0 and seen[v] == start + 1:
            while ring[v] < 0:
                ring[v] = count
                v = child[v]
            count += 1
    return ring, count


@kernel
def _on_the_free_side(points: Floats, rings: Floats, ring: Ints, outer: Bools) -> Bools:
    """Whether each point is inside all outer rings and outside all others."""
    out = np.ones(points.shape[0], np.bool_)
    for p in range(points.shape[0]):
        x, y = points[p]
        k = 0
        while k < rings.shape[0]:
            here, inside = ring[k], False
            while k < rings.shape[0] and ring[k] == here:
                ax, ay, bx, by = rings[k]
                if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
                    inside = not inside
                k += 1
            if inside != outer[here]:
                out[p] = False
                break
    return out


@dataclass(frozen=True)
class Meeting:
    """Both robots at the moment of contact."""

    mine: Pose
    """The robot that aligns, in its own frame."""
    theirs: Pose
    """The peer, in the peer's frame."""
    range_m: float = math.inf
    """How far the radio carries; inf where unknown."""
    radius_m: float = 0.0
    """Of both robots' bodies."""

    def possible(self, transforms: Floats, here: Place, there: Place) -> Bools:
        """(k,) whether transforms (k, 3) of their frame into mine put both robots in range and in free space.

        here, there: where a robot can be by my map, and by theirs.
        """
        clearance = max(self.radius_m - BODY_SLACK_M, 0.0)
        peer = compose(transforms, np.array(self.theirs))[:, :2]
        me = compose(inverse(transforms), np.array(self.mine))[:, :2]
        away = np.hypot(peer[:, 0] - self.mine[0], peer[:, 1] - self.mine[1])
        out: Bools = (away <= self.range_m + RANGE_SLACK_M) & (away >= 2 * clearance)
        out[out] = here.reachable(peer[out], clearance)
        out[out] = there.reachable(me[out], clearance)
        return out
