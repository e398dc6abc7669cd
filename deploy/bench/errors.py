"""How far off a transform between two robots' frames is."""

import math
from collections.abc import Sequence

import numpy as np

from agent.geometry.transform import compose, distance, inverse
from protocol.arrays import Floats

RIGHT_M, RIGHT_DEG = 0.25, 5.0  # farther off than either is wrong (the scorer's)
Poses = Sequence[float] | Floats


def true_transform(mine: Poses, theirs: Poses) -> Floats:
    """(3,) frame of a peer in that of a robot, from both frames' poses (3,) in the world."""
    return compose(inverse(np.asarray(mine)), np.asarray(theirs))


def off_by(found: Poses, truth: Floats, centre: Floats) -> tuple[float, float]:
    """Metres at a point (2,) of the peer's frame, and degrees, between two transforms (3,)."""
    metres, radians = distance(np.asarray(found), truth, centre)
    return metres, math.degrees(radians)


def errors(transform: Poses, mine: Poses, theirs: Poses, centre: Floats) -> tuple[float, float]:
    """Metres at the centre (2,) of the peer's map, and degrees, that a transform is off.

    mine and theirs: poses (3,) of the two frames in the world.
    """
    return off_by(transform, true_transform(mine, theirs), centre)


def right(metres: float, degrees: float) -> bool:
    """Whether an alignment counts as right."""
    return metres <= RIGHT_M and degrees <= RIGHT_DEG
