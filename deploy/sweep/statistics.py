"""Medians and differences of runs, with intervals by the bootstrap. No input or output.

A time that was not reached (`t_90`, `t_99`) counts as infinite: longer than any, and as long as another such.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from deploy.sweep.work import OK, Row
from protocol.arrays import Floats

RESAMPLES = 2000  # more do not change the second digit of an interval
LEVEL = 0.95  # share of the resamples within an interval
FAR = 1e300  # stands for an infinite time, so that the mean of two is one, or zero where their signs differ
LESS = (
    "t_90", "t_99", "ended_s", "path_m", "contacts", "bytes_sent", "bytes_received", "bytes", "rmse_m", "repeated",
    "false", "overlap", "cpu_s", "wall_s", "attempt", "rejected", "unmerged",
)  # fmt: skip
"""Ends of the names of measures that are better when they are less."""


class Estimate(NamedTuple):
    """A figure and the interval that holds it with a probability of LEVEL."""

    value: float
    low: float
    high: float


class Difference(NamedTuple):
    """What one half of pairs of runs has more than the other."""

    median: Estimate
    better: Estimate
    """Probability that the first of a pair is better than the second; pairs without a difference count half."""


def value_of(row: Row, measure: str) -> float | None:
    """A measure of a run; None where the run failed or has none. Raises KeyError where no such run has it."""
    if row["status"] != OK:
        return None
    value: Any = row[measure]
    if value is None and measure.rpartition(".")[2].startswith("t_"):
        return math.inf
    return value if isinstance(value, float) and not math.isnan(value) else None


def median(values: Sequence[float]) -> Estimate | None:
    """Median of a measure; None without values."""
    return _estimate(np.array(values), np.median) if values else None


def difference(pairs: Sequence[tuple[float, float]], measure: str) -> Difference | None:
    """Of pairs (n, 2) of a measure, first less second; None without pairs."""
    if not pairs:
        return None
    first, second = np.array(pairs).T
    same = first == second  # infinite ones, too
    off = np.where(same, 0.0, np.subtract(first, second, where=~same, out=np.zeros(len(first))))
    sign = -1 if measure.endswith(LESS) else 1
    return Difference(_estimate(off, np.median), _estimate((np.sign(off) * sign + 1) / 2, np.mean))


def _estimate(values: Floats, of: Any) -> Estimate:
    values = np.nan_to_num(values, posinf=FAR, neginf=-FAR)
    drawn = np.random.default_rng(0).integers(len(values), size=(RESAMPLES, len(values)))
    low, high = np.quantile(of(values[drawn], axis=1), [(1 - LEVEL) / 2, (1 + LEVEL) / 2], method="inverted_cdf")
    ends = (math.copysign(math.inf, one) if abs(one) > FAR / 4 else float(one) for one in (of(values), low, high))
    return Estimate(*ends)
