"""The transform of a peer fitted on all walls that both saw, with what it is worth (ours).

Alignment fits matched corners, few and far apart in young maps. Walls say more: each holds the transform across its
line by all of its length.
"""

import math
from typing import NamedTuple

import numpy as np

from agent.geometry.matrix3 import inverse
from agent.geometry.transform import apart, compose
from agent.mapping.submaps.matching import SAMPLE_SD_M, refine, tiles_of
from agent.mapping.submaps.segments import SEGMENT, every, samples_along
from protocol.arrays import Floats, Records
from protocol.geometry import apply
from protocol.walls import directions, lengths
from protocol.wireframe import Wireframe

GATES_M = np.array((0.2, 0.1, 0.05))
"""Metres off a wall from which a sample counts little. By the first, accepted alignments err far from their corners."""
ROUNDS = 3
MOST_SAMPLES = 300
"""Samples of the peer's walls: a fit takes 1 ms then, and 300 hold a transform to millimetres."""
WALL_SD_M = 0.02
"""Standard deviation of a sample's distance from its wall: of two maps that robots have made, rounded for the radio."""
SD_RATIO = SAMPLE_SD_M / WALL_SD_M
"""`refine` takes a sample to err by SAMPLE_SD_M; here it errs by WALL_SD_M. The prior is given to it in its units, and
what it finds is taken back from them."""
PRIOR_SD = np.array((0.1, 0.1, 0.01))
"""m, m, rad: what the alignment by corners is trusted with where walls do not tell, as along a corridor."""
MOVED_M, MOVED_RAD = 0.2, 0.05
"""A fit farther from where it began has found other walls."""


class WallFit(NamedTuple):
    """A transform, and how well it is known."""

    transform: Floats
    """(3,) the peer's frame in the robot's own."""
    centre: Floats
    """(2,) of the peer's walls, in its frame."""
    covariance: Floats
    """(3, 3) of where that centre comes to lie, and of the turn: m2, m rad, rad2."""

    def sd_at(self, place: Floats) -> float:
        """Standard deviation in metres of a place (2,) of the peer's frame once it is moved, in the worse direction."""
        x, y = apply(self.transform, place[None])[0] - apply(self.transform, self.centre[None])[0]
        slope = np.array([[1.0, 0.0, -y], [0.0, 1.0, x]])
        return math.sqrt(float(np.linalg.eigvalsh(slope @ self.covariance @ slope.T)[-1]))


def fit_on_walls(mine: Wireframe, theirs: Wireframe, start: Floats) -> WallFit:
    """The transform near `start` (3,) that lays the peer's walls on the robot's; `start` itself where that is far off.

    mine and theirs: each in its own frame; only walls that their owner saw itself count.
    """
    samples = np.asarray(samples_along(_segments(theirs)))
    samples = every(samples, 1 + len(samples) // MOST_SAMPLES)
    samples[:, 4] = 0.0  # the radio's grid turns short walls: their ends alone count
    centre = np.append(samples[:, :2].mean(0) if len(samples) else np.zeros(2), 0.0)
    # about the middle of the walls, where shift and turn are nearly independent
    prior = np.diag((PRIOR_SD * SD_RATIO) ** -2.0)
    samples[:, :2] -= centre[:2]
    found = refine(samples, tiles_of(_segments(mine)), compose(start, centre), prior, GATES_M, ROUNDS)
    transform = compose(found.pose, -centre)
    if apart(transform, start, centre[:2], MOVED_M, MOVED_RAD):
        return WallFit(start, centre[:2], np.diag(PRIOR_SD**2))
    return WallFit(transform, centre[:2], inverse(found.information) / SD_RATIO**2)


def _segments(wireframe: Wireframe) -> Records:
    """(n,) of SEGMENT: the walls that its owner saw itself."""
    walls = wireframe.segments()[wireframe.own]
    walls = walls[lengths(walls) > 1e-6]
    out = np.zeros(len(walls), SEGMENT)
    out["x"], out["y"] = (0.5 * (walls[:, :2] + walls[:, 2:])).T
    out["ux"], out["uy"] = directions(walls).T
    out["high"] = 0.5 * lengths(walls)
    out["low"] = -out["high"]
    return out
