"""How far off a transform between two robots' frames is."""

import math
from collections.abc import Sequence

import numpy as np

from agent.geometry.transform import distance
from protocol.arrays import Floats
from protocol.geometry import Pose, relative

RIGHT_M, RIGHT_DEG = 0.25, 5.0  # farther off than either is wrong (the scorer's)


def off_by(found: Sequence[float] | Floats, truth: Sequence[float] | Floats, centre: Floats) -> tuple[float, float]:
    """Metres at a point (2,) of the peer's frame, and degrees, between two transforms (3,)."""
    metres, radians = distance(np.asarray(found), np.asarray(truth), centre)
    return metres, math.degrees(radians)


def errors(transform: Sequence[float] | Floats, mine: Pose, theirs: Pose, centre: Floats) -> tuple[float, float]:
    """`off_by` at the centre (2,) of the peer's map. mine and theirs: poses of the two frames in the world."""
    return off_by(transform, relative(mine, theirs), centre)


def right(metres: float, degrees: float) -> bool:
    """Whether an alignment counts as right."""
    return metres <= RIGHT_M and degrees <= RIGHT_DEG
