"""The way of bodies in one period, as values at equal steps of it: between two, they move straight and turn evenly.

That is exact for robots, which pymunk moves at one velocity and one turn rate in each step.
"""

import numpy as np

from protocol.arrays import Floats, Ints


def along(way: Floats, moments: Floats) -> Floats:
    """What `way` (s, ...), of which the first is the begin and the last the end of a period, is at moments (n,).

    Moments are shares of the period from 0 to 1. Returns (n, ...). Of one value only, all is that value.
    """
    step, after, share = _steps(len(way), moments)
    share = share.reshape(-1, *[1] * (way.ndim - 1))
    return np.asarray(way[step] * (1 - share) + way[after] * share, np.float64)


def between(way: Floats, moments: Floats, column: Ints) -> Floats:
    """The same of one column (n,) of `way` (s, m) at each moment (n,)."""
    step, after, share = _steps(len(way), moments)
    return np.asarray(way[step, column] * (1 - share) + way[after, column] * share, np.float64)


def _steps(steps: int, moments: Floats) -> tuple[Ints, Ints, Floats]:
    """Of each moment: the values before and after it, and the share of the way between them."""
    at = moments * (steps - 1)
    before = np.minimum(at.astype(np.intp), max(steps - 2, 0))
    return before, np.minimum(before + 1, steps - 1), at - before
