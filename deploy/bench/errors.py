"""How far off a transform between two robots' frames is, and whether a merge is false."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from protocol.arrays import Floats
from protocol.geometry import Pose, apply, relative, wrapped

RIGHT_M, RIGHT_DEG = 0.25, 5.0  # farther off than either is wrong (the scorer's)
ORIGIN = np.zeros(2)


def distance(a: Floats, b: Floats, centre: Floats) -> tuple[float, float]:
    """How far two transforms (3,) are apart: metres at `centre` (2,) of the map that they move, and radians."""
    gap = apply(a, centre[None])[0] - apply(b, centre[None])[0]
    return math.hypot(gap[0], gap[1]), abs(float(wrapped(a[2] - b[2])))


def errors(transform: Sequence[float] | Floats, mine: Pose, theirs: Pose, centre: Floats) -> tuple[float, float]:
    """Metres at the centre (2,) of the peer's map, and degrees, that a transform (3,) is off; mine, theirs: frames."""
    metres, radians = distance(np.asarray(transform), np.array(relative(mine, theirs)), centre)
    return metres, math.degrees(radians)


def right(metres: float, degrees: float) -> bool:
    """Whether an alignment counts as right."""
    return metres <= RIGHT_M and degrees <= RIGHT_DEG


def is_false(transform: Sequence[float] | Floats, mine: Pose, theirs: Pose) -> bool:
    """Whether a merge by a transform (3,) is false: by its errors at the origin of the peer's frame (the scorer's)."""
    return not right(*errors(transform, mine, theirs, ORIGIN))


def false_of(accepted: Iterable[tuple[str, Mapping[str, Any]]], frames: Mapping[str, Pose]) -> int:
    """How many merges are false, of robots and what their events `accepted` tell; frames: of all, in the world."""
    return sum(is_false(data["transform"], frames[robot], frames[data["peer"]]) for robot, data in accepted)
