"""A recorded log as scans with odometry, whatever its format, and what in it could not be used."""

import math
from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median
from typing import NamedTuple

import numpy as np

from protocol.arrays import Floats
from protocol.geometry import Pose
from protocol.messages import LidarSpec
from protocol.settings import MAX_NUMBER

GAP_S = 0.4  # a pause between two scans is a gap from here, if it is GAP_TIMES the usual one
GAP_TIMES = 2.2


class Scan(NamedTuple):
    """One scan of a log."""

    number: int  # counts the log's scans from 0, those that are skipped, too
    time_s: float
    ranges: Floats  # (beams,) m; inf where nothing came back, NaN where nothing was measured
    odometry: Pose  # of the lidar, by the wheels


@dataclass
class LidarLog:
    """All scans of one log that can be used."""

    lidar: LidarSpec
    scans: list[Scan] = field(default_factory=list)
    skipped: Counter[str] = field(default_factory=Counter)  # records that were not used, by reason
    notes: list[str] = field(default_factory=list)  # what else is odd

    def add(self, scan: Scan) -> None:
        """Take a scan, or count why it cannot be used."""
        if reason := self._unusable(scan):
            self.skipped[reason] += 1
        else:
            self.scans.append(scan)

    def _unusable(self, scan: Scan) -> str | None:
        if len(scan.ranges) != self.lidar.beams:
            return f"scans without {self.lidar.beams} readings, as the first had"
        if not all(abs(value) <= MAX_NUMBER for value in scan.odometry):  # NaN is not
            return "scans whose odometry is no number"
        if not math.isfinite(scan.time_s) or (self.scans and scan.time_s < self.scans[-1].time_s):
            return "scans whose time jumps back"
        return None

    def note_gaps(self) -> None:
        """Say how often the log pauses."""
        times = [scan.time_s for scan in self.scans]
        steps = [b - a for a, b in pairwise(times)]
        usual = median(steps) if steps else 0.0
        gaps = [step for step in steps if step > max(GAP_S, GAP_TIMES * usual)]
        if gaps:
            self.notes.append(f"{len(gaps)} gaps of {min(gaps):.1f} to {max(gaps):.1f} s between scans")


def cleaned(readings: Floats, lidar: LidarSpec) -> Floats:
    """Readings (beams,), m, as ranges: inf from the lidar's range on, NaN for no number, 0 and what is too near."""
    with np.errstate(invalid="ignore"):
        ranges = np.where(readings >= lidar.range_max_m, np.inf, readings)
        return np.where(ranges >= lidar.range_min_m, ranges, np.nan)
