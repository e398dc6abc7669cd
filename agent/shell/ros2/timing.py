"""When a lidar takes its readings, where its driver does not tell it right, and what shows that it does not."""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from agent.shell.ros2.laser_scan import ALL_ROUND_DEG, Bearings, LaserScan, stamp_of

IN_A_ROW = 10  # scans that show one thing before it is said: one that came late, or after a pause, shows nothing
TOO_LATE = 0.5, 1.5  # revolutions by which a scan ends after it came; by more it does where odometry has ceased
TOO_FAR = 3.0  # revolutions from one scan to the next: of some lidars not each is passed on
OTHER_PERIOD = 0.15  # share by which a revolution differs from the believed one: more than a motor does
LATE = "scans that end after they came: if they are stamped at their ends, set ros2.stamp to end"
ONE_MOMENT = "scans of all around and one moment: set ros2.revolution_s to the seconds that they take, or to 0"
FAR = "scans more than three of their revolutions apart: if the lidar turns slower than it says, set ros2.revolution_s"
OTHER = "scans of another revolution than the first ones: if the lidar goes on so, start this again"


class Timing(NamedTuple):
    """What the user says of it."""

    revolution_s: float | None = None  # negative where the first reading was taken last; None: as the scan tells
    at_end: bool = False  # whether the stamp is that of the reading that was taken last

    def taken(self, message: Any, arrived_s: float) -> LaserScan:
        """A LaserScan message as its lidar took it. One without a stamp arrives, in seconds, once it is over."""
        stamp_s = stamp_of(message, 0.0)
        timing = self if stamp_s else self._replace(at_end=True)
        return timing.mended(LaserScan.told(message, stamp_s or arrived_s))

    def mended(self, scan: LaserScan) -> LaserScan:
        """A scan as its lidar took it, its readings in the order of their moments."""
        begin_s, between_s, bearings, readings = scan
        count, first, step = bearings
        if self.revolution_s is not None:
            between_s = abs(self.revolution_s * step) / (2 * math.pi)
            if self.revolution_s < 0:
                bearings, readings = Bearings(count, first + step * (count - 1), -step), readings[::-1]
        return LaserScan(begin_s - self.at_end * between_s * (count - 1), between_s, bearings, readings)


AS_TOLD = Timing()


class TimingWatch:
    """Says, once each, what speaks against the times of scans, and what to set."""

    def __init__(self, timing: Timing, say: Callable[[str], None]) -> None:
        self._timing, self._say = timing, say
        self._end_s = math.inf
        self._shown = dict[str, int]()
        """How many scans in a row have shown something."""

    def look(self, scan: LaserScan, period_s: float, now_s: float) -> None:
        """Look at a scan as it comes. period_s: of the revolution that is believed. now_s: by the clock of stamps."""
        self._shown = {what: self._shown.get(what, 0) + 1 for what in self._doubts(scan, period_s, now_s)}
        for what, times in self._shown.items():
            if times == IN_A_ROW:
                self._say(what)
        self._end_s = scan.end_s

    def _doubts(self, scan: LaserScan, period_s: float, now_s: float) -> Iterator[str]:
        least_s, most_s = (share * scan.period_s for share in TOO_LATE)
        if not self._timing.at_end and least_s < scan.end_s - now_s < most_s:
            yield LATE
        if self._timing.revolution_s is not None:
            return
        if not scan.period_s:
            if math.degrees(scan.bearings.view) >= ALL_ROUND_DEG:
                yield ONE_MOMENT
            return
        if scan.end_s - self._end_s > TOO_FAR * scan.period_s:
            yield FAR
        if abs(scan.period_s / period_s - 1) > OTHER_PERIOD:
            yield OTHER
