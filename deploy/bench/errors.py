"""How far off a transform between two robots' frames is."""

import math
from collections.abc import Sequence

import numpy as np

from agent.geometry.transform import distance
from protocol.arrays import Floats
from protocol.geometry import Pose, relative

RIGHT_M, RIGHT_DEG = 0.25, 5.0  # farther off than either is wrong (the scorer's)


def errors(transform: Sequence[float] | Floats, mine: Pose, theirs: Pose, centre: Floats) -> tuple[float, float]:
    """Metres at the centre (2,) of the peer's map, and degrees, that a transform (3,) is off; mine, theirs: frames."""
    metres, radians = distance(np.asarray(transform), np.array(relative(mine, theirs)), centre)
    return metres, math.degrees(radians)


def right(metres: float, degrees: float) -> bool:
    """Whether an alignment counts as right."""
    return metres <= RIGHT_M and degrees <= RIGHT_DEG
