"""The way of bodies in one period, as values at equal steps of it: between two, they move straight and turn evenly.

That is exact for robots, which pymunk moves at one velocity and one turn rate in each step.
"""

import numpy as np

from protocol.arrays import Complexes, Floats, Ints

Steps = tuple[Ints, Ints, Floats]
"""Of each of some moments: the values before and after it (n,), and the share of the way between them (n,)."""


def interpolated(way: Floats, moments: Floats) -> Floats:
    """Values (n, ...) of a `way` (s, ...) at moments (n,), shares of its period from 0 to 1.

    The first value is at the begin of the period, the last one at its end. A way of one value has it all the time.
    """
    before, after, share = steps(len(way), moments)
    share = share.reshape(-1, *[1] * (way.ndim - 1))
    return np.asarray(way[before] * (1 - share) + way[after] * share, np.float64)


def between(way: Complexes, steps: Steps, column: Ints, moment: Ints) -> Complexes:
    """Values (n,) of `way` (s, m), each of one column (n,) at one moment (n,): a row of what `steps` were made of."""
    before, after, share = steps
    begin, end = (way.take(step.take(moment) * way.shape[1] + column) for step in (before, after))
    return np.asarray(begin + share.take(moment) * (end - begin))


def steps(count: int, moments: Floats) -> Steps:
    """Where moments (n,) are among so many values."""
    at = moments * (count - 1)
    before = np.minimum(at.astype(np.intp), max(count - 2, 0))
    return before, np.minimum(before + 1, count - 1), at - before
