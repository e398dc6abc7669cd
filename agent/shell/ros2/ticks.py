"""Ticks of a robot of ROS 2: one for each scan, counted from a moment that robots whose clocks agree have in common."""

import math
from collections.abc import Callable

from protocol.messages import MAX_TICK

SLIP_TICKS = 2  # ticks counted by scans are fewer than so many off those of the clock, as no lidar is exactly on time
EPOCH_S = 1_767_225_600.0
"""Ticks count from 2026, so that those of robots of one rate whose clocks agree are alike, and rise over restarts."""
SPAN_S = 1e7
"""Where neither those since then nor those since 1970 can be counted, ticks count from the last multiple of these four
months, so that they are alike on such clocks, too."""
NEAR = 0.05  # share by which a lidar may be off a rate and count by it: one tick of twenty is left out or one too many
IMPOSSIBLE = "scans of a time that cannot be"


def nominal_hz(measured_hz: float, told_hz: float) -> float:
    """Ticks a second for a lidar: the first that it is near of those told, whole and half hertz, else two digits.

    No two lidars turn equally fast: a robot that counted by 5.0001 Hz would be 5 min ahead of others after half a year.
    Whole hertz come first, as a few scans of a lidar of 10 Hz that err by 2 % may be nearer to 10.5.
    """
    candidates = (told_hz, round(measured_hz), round(2 * measured_hz) / 2)
    near = (float(hz) for hz in candidates if abs(measured_hz - hz) <= NEAR * hz)
    return next(near, float(f"{measured_hz:.2g}"))


class Ticks:
    """Counts ticks. They follow the scans, so that none is missed or doubled by jitter, and the clock over a while."""

    def __init__(self, rate_hz: float, begin_s: float, skip: Callable[[str], None]) -> None:
        """rate_hz: ticks a second. begin_s: the first scan's. skip: is told why a scan has no tick."""
        self._rate_hz, self._skip = rate_hz, skip
        self._tick, self._end_s = -1, -math.inf
        self._zero_s = self._zero_of(begin_s)

    def _counts(self, time_s: float, zero_s: float) -> bool:
        """Whether a time has a tick, where ticks count from zero_s."""
        return 0 <= (time_s - zero_s) * self._rate_hz <= MAX_TICK

    def _zero_of(self, time_s: float) -> float:
        """From when ticks count by a clock that shows a time."""
        return next((zero_s for zero_s in (EPOCH_S, 0.0) if self._counts(time_s, zero_s)), time_s - time_s % SPAN_S)

    def objection(self, end_s: float, before_s: float) -> str:
        """Why a scan that ends then cannot follow one that ends at before_s; empty where it can."""
        if end_s <= max(self._end_s, before_s):
            return "scans whose time jumps back"
        woke_late = self._zero_s < EPOCH_S and (end_s - EPOCH_S) * self._rate_hz > max(self._tick, 0)
        return IMPOSSIBLE if woke_late or not self._counts(end_s, self._zero_s) else ""

    def set_clock(self, end_s: float) -> None:
        """Believe that it is end_s after all. Ticks become those of other robots if they rise so, else go on."""
        before_s = end_s - 1 / self._rate_hz
        zero_s = min(self._zero_of(before_s), before_s - (self._end_s - self._zero_s))
        self._end_s += zero_s - self._zero_s
        self._zero_s = zero_s

    def next(self, end_s: float) -> int | None:
        """The tick of a scan that ends then; None where it is one too many."""
        by_clock = round((end_s - self._zero_s) * self._rate_hz)
        tick = by_clock if self._tick < 0 else self._tick + max(1, round((end_s - self._end_s) * self._rate_hz))
        if by_clock - tick >= SLIP_TICKS:
            tick += 1
        elif tick - by_clock >= SLIP_TICKS:
            self._skip(f"scans beyond {self._rate_hz:g} a second")
            self._end_s = end_s
            return None
        if tick > MAX_TICK:
            self._skip(IMPOSSIBLE)
            return None
        self._end_s, self._tick = end_s, tick
        return tick
