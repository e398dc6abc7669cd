"""The way of bodies in one period, as values at equal steps of it: between two, they move straight and turn evenly.

That is exact for robots, which pymunk moves at one velocity and one turn rate in each step.
"""

import numpy as np

from protocol.arrays import Complexes, Floats, Ints

Steps = tuple[Ints, Ints, Floats]
"""Of each of some moments: the values before and after it (n,), and the share of the way between them (n,)."""


def along(way: Floats, moments: Floats) -> Floats:
    """What `way` (s, ...), of which the first is the begin and the last the end of a period, is at moments (n,).

    Moments are shares of the period from 0 to 1. Returns (n, ...). Of one value only, all is that value.
    """
    before, after, share = steps(len(way), moments)
    share = share.reshape(-1, *[1] * (way.ndim - 1))
    return np.asarray(way[before] * (1 - share) + way[after] * share, np.float64)


def between(way: Complexes, steps: Steps, column: Ints, moment: Ints) -> Complexes:
    """The same of one column (n,) of `way` (s, m) each, at one (n,) of the moments that `steps` are of."""
    before, after, share = steps
    begin, end = (way.take(step.take(moment) * way.shape[1] + column) for step in (before, after))
    return np.asarray(begin + share.take(moment) * (end - begin))


def steps(count: int, moments: Floats) -> Steps:
    """Where moments (n,) are among so many values."""
    at = moments * (count - 1)
    before = np.minimum(at.astype(np.intp), max(count - 2, 0))
    return before, np.minimum(before + 1, count - 1), at - before
