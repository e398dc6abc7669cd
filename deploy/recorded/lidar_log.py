"""A recorded log as scans with odometry, whatever its format, and what in it could not be used."""

import math
from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from protocol.arrays import Floats
from protocol.errors import InputError
from protocol.geometry import Pose
from protocol.messages import LidarSpec
from protocol.settings import MAX_NUMBER
from protocol.wireframe import MAX_COORDINATE_M

GAP_S = 0.4  # a pause between two scans is a gap from here, if it is GAP_TIMES the usual one
GAP_TIMES = 2.2
CHANGE_M = 0.1  # of half of the beams: a robot that stands sees that much of nothing but crowds
FAR_M = 0.49 * MAX_COORDINATE_M  # from the first scan: no two are out of reach, so a part may begin with any
MAX_STAMP_S = 1e10  # from the epoch: in the year 2286
MAX_DAYS = 200  # of one log: at 100 scans a second, two that overlap have fewer ticks than a beacon can tell (2**32)
WILD_S = 10.0  # a stamp that is farther ahead than this of the two that follow is wrong, else these are late
CLOCK_SCANS = 10  # in a row by another clock, after which that one counts
WILD = "scans whose time or place the next two contradict"
OUT_OF_REACH = f"scans whose odometry is farther than {FAR_M:g} m from the first"
MAX_SCANS = 200_000  # the longest of public logs has 60,000
MAX_READINGS = 80_000_000  # 640 MB: as many scans of 361 readings and more
OF_LOGS: dict[str, Any] = {"turning": False, "noise_m": 0.01, "noise_share": 0.0}
"""Settings of the lidar of a log that does not tell: the SICK of most public logs, which by its data sheet errs by the
same near and far, and whose scans are stamped as one."""


class Given(NamedTuple):
    """What a log may not tell, told by the user."""

    field_of_view_deg: float | None = None  # of FLASER lines: 180 degrees from right to left
    range_max_m: float | None = None
    scan_topic: str | None = None  # of bags
    odometry_topic: str | None = None
    mount: Pose | None = None  # m, m, rad: the lidar's on the robot
    revolution_s: float | None = None  # of the lidar; 0 where its scans are of one moment
    upside_down: bool | None = None  # whether the lidar of a bag is, where tf does not tell


class Scan(NamedTuple):
    """One scan of a log."""

    number: int  # counts the log's scans from 0, those that are skipped, too
    time_s: float
    ranges: Floats  # (beams,) m; inf where nothing came back, NaN where nothing was measured
    odometry: Pose  # of the lidar, by the wheels
    way: Floats | None = None  # (k + 1, 3) the same at equal steps from the begin to the end of the revolution

    @property
    def poses(self) -> Floats:
        """(3,) or (k + 1, 3) all that the wheels tell."""
        return np.array(self.odometry) if self.way is None else self.way


def check_amount(scans: int, readings: int) -> None:
    """Raise InputError where a log has more than memory holds."""
    if scans > MAX_SCANS:
        raise InputError(f"more than {MAX_SCANS} scans; split it")
    if readings > MAX_READINGS:
        raise InputError(f"more than {MAX_READINGS // 1_000_000} million readings; split it")


def gap_of(steps_s: Floats) -> float:
    """Seconds from one to the next of what comes in such steps (n,): more than that is a pause."""
    return max(GAP_S, GAP_TIMES * float(np.median(steps_s))) if len(steps_s) else GAP_S


@dataclass
class LidarLog:
    """All scans of one log that can be used."""

    lidar: LidarSpec
    source: str  # the file, and what in it
    scans: list[Scan] = field(default_factory=list)
    skipped: Counter[str] = field(default_factory=Counter)  # records that were not used, by reason
    notes: list[str] = field(default_factory=list)  # what else is odd
    reference: dict[int, tuple[float, float]] = field(default_factory=dict)  # m, by scans' numbers: where it was
    mount: Pose | None = None  # the lidar's on the robot, of which odometry tells; None where nothing tells it
    _added: int = 0
    _shift_s: float = 0.0  # from the stamps to the clock by which the log began
    _other_clock: list[tuple[Scan, str]] = field(default_factory=list)  # the last scans, by another one, and the reason
    _doubt: tuple[Scan, str] | None = None  # the scan before, if it says that the last one used is wild, and its reason

    def part(self, begin: int, end: int, name: str) -> "LidarLog":
        """Scans from one to before another, as a log of its own. What was skipped and noted is told with the first."""
        first = begin == 0
        return LidarLog(
            self.lidar,
            f"{self.source}, {name}",
            self.scans[begin:end],
            self.skipped if first else Counter(),
            self.notes if first else [],
            self.reference,
        )

    def places(self) -> Floats:
        """(scans, 2) where each scan was by the reference, or between scans that it names; NaN where it names none."""
        known = self.reference
        named = [(scan.time_s, *known[scan.number]) for scan in self.scans if scan.number in known]
        if not named:
            return np.full((len(self.scans), 2), np.nan)
        times, (t, x, y) = [scan.time_s for scan in self.scans], np.array(named).T
        return np.column_stack((np.interp(times, t, x), np.interp(times, t, y)))

    def add(self, scan: Scan) -> None:
        """Take a scan, or count why it cannot be used.

        Where the next two agree that the last one is wild, it is the one that is not used: else nothing would be that
        follows one wrong stamp or a wrong first pose.
        """
        self._added += 1
        scan = scan._replace(time_s=scan.time_s + self._shift_s)
        doubt, self._doubt = self._doubt, None
        reason = self._damaged(scan) or _contradicted(scan, *self._ends())
        if reason is None:
            self.scans.append(scan)
            self._other_clock.clear()
        elif not self._makes_wild(scan):
            self.skipped[reason] += 1
            self._follow_clock(scan, reason)
        elif doubt is None or _contradicted(scan, self._ends(1)[0] or doubt[0], doubt[0]):
            self.skipped[reason] += 1
            self._doubt = scan, reason
        else:
            self.skipped -= Counter([doubt[1]])
            self.skipped[WILD] += 1
            self.scans[-1:] = doubt[0], scan

    def _follow_clock(self, scan: Scan, reason: str) -> None:
        """Go on by another clock, where ten scans in a row have its times: before the log's begin, or far too late.

        Who sets the clock of a robot while it records would lose all that follows.
        """
        ahead_s = scan.time_s - self.scans[0].time_s if self.scans else 0.0
        before = self._other_clock[-1][0].time_s if self._other_clock else -math.inf
        in_time = 0 <= ahead_s <= MAX_DAYS * 86_400
        if self._damaged(scan) or in_time or scan.time_s < before or _is_far(scan, self.scans[0]):
            self._other_clock.clear()
            return
        self._other_clock.append((scan, reason))
        if len(self._other_clock) < CLOCK_SCANS:
            return
        others = [other for other, _ in self._other_clock]
        step_s = (others[-1].time_s - others[0].time_s) / (CLOCK_SCANS - 1)
        shift_s = self.scans[-1].time_s + step_s - others[0].time_s
        self.notes.append(
            f"its clock jumps by {-shift_s:.3f} s before scan {others[0].number}, and counts from there on"
        )
        self.skipped -= Counter(why for _, why in self._other_clock)
        self.scans += [other._replace(time_s=other.time_s + shift_s) for other in others]
        self._shift_s += shift_s
        self._other_clock.clear()

    def _damaged(self, scan: Scan) -> str | None:
        if len(scan.ranges) != self.lidar.beams:
            return f"scans without {self.lidar.beams} readings, as the first had"
        if not (np.abs(scan.poses) <= MAX_NUMBER).all():  # NaN is not
            return "scans whose odometry is no number"
        if not abs(scan.time_s) <= MAX_STAMP_S:  # NaN is not
            return "scans whose time is none"
        return None

    def _ends(self, less: int = 0) -> tuple[Scan | None, Scan | None]:
        """The first and the last scan, or how these were so many scans ago."""
        count = len(self.scans) - less
        return (self.scans[0], self.scans[count - 1]) if count > 0 else (None, None)

    def _makes_wild(self, scan: Scan) -> bool:
        """Whether a sound scan contradicts the last one alone, and not by seconds that are soon over."""
        if not self.scans or self._damaged(scan) or 0 < self.scans[-1].time_s - scan.time_s <= WILD_S:
            return False
        return _contradicted(scan, *self._ends(1)) is None

    def skip_far(self) -> None:
        """Skip scans out of reach of the first: a way that was put together may lead farther than its parts."""
        near = [scan for scan in self.scans if not _is_far(scan, self.scans[0])]
        self.skipped += Counter({OUT_OF_REACH: len(self.scans) - len(near)})
        self.scans = near

    def gap_s(self) -> float:
        """Seconds from scan to scan up to which the log does not pause."""
        return gap_of(np.array(self._steps_s()))

    def _steps_s(self) -> list[float]:
        return [b.time_s - a.time_s for a, b in pairwise(self.scans)]

    def note_odd(self) -> None:
        """Say how often the log pauses, whether it stands, and whether most of its scans are of no use."""
        if 2 * len(self.scans) < self._added:
            self.notes.append(f"only {len(self.scans)} of {self._added} scans are used")
        steps, gap_s = self._steps_s(), self.gap_s()
        gaps = [step for step in steps if step > gap_s]
        if gaps:
            self.notes.append(f"{len(gaps)} gaps of {min(gaps):.1f} to {max(gaps):.1f} s between scans")
        if len({scan.odometry for scan in self.scans}) == 1 and self._sees_change():
            self.notes.append("its odometry never moves, but what it sees does")
        if not any(np.isfinite(scan.ranges).any() for scan in self.scans):
            self.notes.append("no scan hits anything")

    def _sees_change(self) -> bool:
        """Whether half of the beams of any scan differ from those of the first by more than noise."""
        first, *rest = (np.nan_to_num(scan.ranges, posinf=self.lidar.range_max_m) for scan in self.scans)
        return any(np.median(np.abs(ranges - first)) > CHANGE_M for ranges in rest)


def _contradicted(scan: Scan, first: Scan | None, last: Scan | None) -> str | None:
    """Why a scan cannot follow these; None where it can."""
    if first is None or last is None:
        return None
    if _is_far(scan, first):
        return OUT_OF_REACH
    if scan.time_s < last.time_s:
        return "scans whose time jumps back"
    if scan.time_s - first.time_s > MAX_DAYS * 86_400:
        return f"scans more than {MAX_DAYS} days after the first"
    return None


def _is_far(scan: Scan, first: Scan) -> bool:
    x, y = (scan.poses[..., :2] - first.odometry[:2]).T
    return bool((np.hypot(x, y) > FAR_M).any())
