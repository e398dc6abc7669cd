"""Walls that share corners as arrays of vertices and edges (paper III-A)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def chained(
    tips: Floats, labels: NDArray[np.uint8], following: NDArray[np.int64]
) -> tuple[Floats, NDArray[np.uint8], NDArray[np.int32]]:
    """Vertices (n, 2), their labels (n,) and edges (m, 2) of m walls.

    tips (m, 2, 2): tail and head of each wall, metres; labels (m, 2) theirs; following (m,): the wall whose tail is
    this one's head, or -1. A shared corner is the head.
    """
    joined = np.flatnonzero(following >= 0)
    tails = 2 * following[joined]
    used = np.ones(2 * len(tips), np.bool_)
    used[tails] = False
    index = np.cumsum(used, dtype=np.int32) - 1
    index[tails] = index[2 * joined + 1]
    return tips.reshape(-1, 2)[used], labels.reshape(-1)[used], index.reshape(-1, 2)
