"""Beams as numbers: which of them an interval of bearings holds, and what is nearest on each."""

import math

import numpy as np

from protocol.arrays import Floats, Ints
from protocol.walls import repeated

_ROUNDING_BEAMS = 1e-9
"""Intervals are widened by this share of a beam, so that rounding leaves no gap between walls that share a corner."""


def beams_within(begin: Floats, sweep: Floats, step: float | Floats, beams: int) -> tuple[Ints, Ints]:
    """All (row, beam) with the beam's bearing in [begin, begin + sweep]; a pair may come twice.

    begin, sweep: (n,) radians, counted from beam 0, begin in [0, 2 pi). step: between two beams, radians, one for all
    or (n,). Where the beams make more than a full revolution, two of them have the same bearing.
    """
    low, high, around = begin / step, (begin + sweep) / step, np.full(begin.shape, 2 * math.pi / step)
    first, last = np.ceil(low - _ROUNDING_BEAMS), np.floor(high + _ROUNDING_BEAMS)
    counts = np.minimum(last, beams - 1) - first + 1
    counts, first = np.maximum(counts, 0).astype(np.intp), first.astype(np.intp)
    row = np.repeat(np.arange(len(counts)), counts)
    beam = np.arange(len(row)) + np.repeat(first - np.cumsum(counts) + counts, counts)
    over, again = np.flatnonzero(high >= around - _ROUNDING_BEAMS), np.flatnonzero(low < beams - around)
    if len(over) or len(again):
        part, shift = np.concatenate([over, again]), np.concatenate([-around[over], around[again]])
        begins = np.maximum(np.ceil(low[part] + shift - _ROUNDING_BEAMS), 0).astype(np.intp)
        ends = np.minimum(np.floor(high[part] + shift + _ROUNDING_BEAMS), beams - 1).astype(np.intp)
        more, nth = repeated(np.maximum(ends - begins + 1, 0))
        row, beam = np.concatenate([row, part[more]]), np.concatenate([beam, begins[more] + nth])
    return row, beam


def keep_nearest(ray: Ints, found: Floats, what: Ints, nearness: Floats, met: Ints) -> None:
    """Raise `nearness` (1 / range) of rays to the largest value found on each, and note in `met` what stood there.

    ray, found, what: (n,) rows of the two, values 1 / range, and what each is of.
    """
    np.maximum.at(nearness, ray, found)
    won = np.flatnonzero(found == nearness.take(ray))  # a mask of booleans takes three times as long
    met[ray.take(won)] = what.take(won)
