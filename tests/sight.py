"""What is seen, by looking at all walls: the answer that faster ways must give."""

import numpy as np

from agent.geometry.visibility import hidden_by
from protocol.arrays import Bools, Floats


def all_seen(eyes: Floats, targets: Floats, walls: Floats) -> Bools:
    """(n,) whether each of targets (n, 2) is seen from the eye (n, 2) of the same row, past walls (m, 4)."""
    return np.array([hidden_by(*eye, *target, walls) < 0 for eye, target in zip(eyes, targets, strict=True)])
