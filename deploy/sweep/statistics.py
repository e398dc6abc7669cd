"""Medians and differences of runs, with intervals that suppose no distribution. No input or output.

A time that was not reached (`t_90`, `t_99`) counts as infinite: longer than any, and as long as another such.
"""

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np

from deploy.sweep.work import OK, Row

LEVEL = 0.95
"""Probability with which intervals hold what they estimate; of medians at least this."""
Z = NormalDist().inv_cdf((1 + LEVEL) / 2)
FAR = 1e300  # stands for an infinite time, so that the mean of two is one, or zero where their signs differ
MORE = ("coverage", "recall", "precision", "real_time_factor", "proposed", "accepted")
"""Ends of the names of measures that are better when they are more; all others are when they are less."""


class Estimate(NamedTuple):
    """A figure and the interval that holds it with a probability of LEVEL; None where too few values tell none."""

    value: float
    low: float | None
    high: float | None


class Difference(NamedTuple):
    """What one half of pairs of runs has more than the other."""

    median: Estimate
    better: Estimate
    """Probability that the first of a pair is better than the second; pairs without a difference count half."""


def is_time(measure: str) -> bool:
    """Whether it is a time that a run may never reach, and then has none."""
    return measure.rpartition(".")[2].startswith("t_")


def time_of(told: float | None) -> float:
    """A time, of which a run that did not reach it tells None: it is infinite then."""
    return math.inf if told is None else told


def told_of(time: float | None) -> float | None:
    """The other way round, of ratios of times, too."""
    return None if time is None or math.isinf(time) else time


def value_of(row: Row, measure: str) -> float | None:
    """A measure of a run; None where the run failed or has none."""
    if row["status"] != OK or measure not in row:
        return None
    value: Any = row[measure]
    if is_time(measure):
        value = time_of(value)
    return value if isinstance(value, float) and not math.isnan(value) else None


def median(values: Sequence[float]) -> Estimate | None:
    """Median of a measure; None without values. Its interval needs six."""
    if not values:
        return None
    middle = float(np.median(np.clip(values, -FAR, FAR)))
    if abs(middle) > FAR / 4:
        middle = math.copysign(math.inf, middle)
    if not (rank := _rank(len(values))):
        return Estimate(middle, None, None)
    ordered = sorted(values)
    return Estimate(middle, ordered[rank - 1], ordered[-rank])


def _rank(count: int) -> int:
    """Which of so many ordered values, from 1 on and from either end, are the ends of the median's interval; 0: none.

    Whatever their distribution, as many values are below its median as so many coins show heads.
    """
    heads = np.arange(count // 2)
    ways = np.concatenate([[0.0], np.cumsum(np.log((count - heads) / (heads + 1)))])  # logarithms of the binomials
    at_most = np.cumsum(np.exp(ways - count * math.log(2)))
    return int(np.searchsorted(at_most, (1 - LEVEL) / 2, side="right"))


def difference(pairs: Sequence[tuple[float, float]], measure: str) -> Difference | None:
    """Of pairs (n, 2) of a measure, first less second; None without pairs."""
    if not pairs:
        return None
    first, second = np.array(pairs).T
    same = first == second  # infinite ones, too
    off = np.where(same, 0.0, np.subtract(first, second, where=~same, out=np.zeros(len(first))))
    sign = 1 if measure.endswith(MORE) else -1
    better = float((np.sign(off) * sign + 1).sum() / 2)
    middle = median(off.tolist())
    assert middle is not None
    return Difference(middle, Estimate(better / len(off), *wilson(better, len(off))))


def wilson(count: float, of: int) -> tuple[float, float]:
    """Wilson score interval of a share, at LEVEL."""

    def low(count: float) -> float:
        spread = Z * math.sqrt(count * (of - count) / of + Z * Z / 4)
        return (count + Z * Z / 2 - spread) / (of + Z * Z)

    return (low(count), 1 - low(of - count)) if of else (0.0, 1.0)
