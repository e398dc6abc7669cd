"""How exact a map is in its frame by what the joint estimate knows of its walls, and which look would tell most (ours).

The next place to look from is the one after which least is left to be known, as in active SLAM (Feder, Leonard and
Smith, "Adaptive mobile robot navigation and mapping", 1999).
"""

import math
from typing import NamedTuple

import numpy as np

from agent.geometry.lines import Record
from agent.kernels import kernel
from agent.mapping.edges import EDGE, is_published, tip_at
from agent.mapping.joint import WALLS, crosswise, has_rows, row_of
from protocol.arrays import Floats, Ints, Records
from protocol.geometry import Pose

LOOK_M = 0.5  # distance before the middle of a wall from which it is looked at
LOOK_SD_M = 0.01  # to which a look tells how far a wall is away: some scans, and what wheels add between them


class Looks(NamedTuple):
    """Looks at k walls of the map: all whose variance is not the robot's."""

    places: Floats  # (k, 2) before the middle of each wall, on its free side, metres, frame of the map
    sds_m: Floats  # (k,) how far walls of the map may be off after each, as in `Exactness.sd_m`


class Exactness(NamedTuple):
    """What is known of how exact a map is. Its arrays may be views: it is good for one tick."""

    walls: Records = np.zeros(0, EDGE)  # (n,) of a particle
    joint: Floats = np.zeros((WALLS, WALLS))  # (m, m) the particle's covariance
    pose: Pose = (0.0, 0.0, 0.0)  # of the robot, frame of the map

    def sd_m(self) -> float:
        """Root mean square of how far walls may be off across their lines, metres, in the map's frame.

        0 where the covariance knows of no error.
        """
        return math.sqrt(_mean_variance(self.walls, self.joint, _published(self.walls, self.joint)))

    def looks(self) -> Looks:
        """A look at each wall that tells the robot where it is, and what it would tell of all walls."""
        told = _looks(self.walls, self.joint, self.pose, _published(self.walls, self.joint))
        return Looks(told[:, :2], told[:, 2])


@kernel
def _published(walls: Records, joint: Floats) -> Ints:
    """Which walls are in the map, of those that the covariance knows."""
    which, number = np.empty(len(walls), np.int64), 0
    for e in range(min(len(walls), has_rows(joint))):
        if is_published(walls[e]):
            which[number] = e
            number += 1
    return which[:number]


@kernel
def _variance(wall: Record, row: int, joint: Floats) -> float:
    """Variance of the offset of a wall, m2; while it has none, that of the robot's place across its line.

    All walls have none in the tick in which a torn map was mended.
    """
    across = wall.uy**2 * joint[0, 0] - 2.0 * wall.ux * wall.uy * joint[0, 1] + wall.ux**2 * joint[1, 1]
    return float(joint[row, row] if joint[row, row] > 0.0 else across)


@kernel
def _mean_variance(walls: Records, joint: Floats, which: Ints) -> float:
    """Mean variance of the offsets of some walls (k,), m2."""
    total = 0.0
    for e in which:
        total += _variance(walls[e], row_of(e), joint)
    return total / max(len(which), 1)


@kernel
def _looks(walls: Records, joint: Floats, pose: Pose, which: Ints) -> Floats:
    """(l, 3) of some walls (k,): where to look at each from, x and y, and how far the map may be off after that.

    A look tells how far a wall is from where the robot believes to be. Walls with the robot's variance are left out.
    """
    told, k, before = np.empty((len(which), 3)), 0, _mean_variance(walls, joint, which)
    for wall in which:
        w, row = walls[wall], row_of(wall)
        if _variance(w, row, joint) > joint[row, row]:
            continue
        middle = 0.5 * (tip_at(w, 0) + tip_at(w, 1))
        told[k, 0] = w.x + middle * w.ux - LOOK_M * w.uy
        told[k, 1] = w.y + middle * w.uy + LOOK_M * w.ux
        same, grows = crosswise(w, pose)
        rows = (row, row + 1, 0, 1, 2)
        errs = np.zeros(len(joint))  # how each row errs with what the look tells
        for i in range(len(rows)):
            errs += (same[i] + middle * grows[i]) * joint[rows[i]]
        variance = LOOK_SD_M**2
        for i in range(len(rows)):
            variance += (same[i] + middle * grows[i]) * errs[rows[i]]
        gain = 0.0
        for e in which:
            gain += errs[row_of(e)] ** 2
        told[k, 2] = math.sqrt(max(before - gain / variance / len(which), 0.0))
        k += 1
    return told[:k]
