"""What a robot sees while it stands where its frame begins: all scans as one, the median of each beam (ours).

Far faces show a few beams, and noise hides which of them met the next face. Of scans one by one, every second fits one
line over two faces of a column, turned by 30 degrees, and all err alike. The median of fifty shows both faces. How the
map lies in its frame is known from these walls alone.
"""

import math

import numpy as np

from agent.corner_scan import CUT_SIGMAS, at_start, noise_at
from protocol.arrays import Floats
from protocol.messages import LidarSpec

MOST_SCANS = 64
"""At 5 Hz a robot looks for 50, at higher rates until it has as many, and longer where they tell little. Who stands on
sees scan by scan from then on: a median of so many shows nobody who comes."""
UNEVEN_M = 0.0015
"""Least standard deviation of a median from the wall: finished walls may be off by 3 mm within 0.1 m (DIN 18202). With
the floor of a single scan, twice as much, 40 faces of columns in `hall` were turned by half of their deviation, and
where a robot had begun beside a lone column its map was turned by 0.4 degrees (two runs: recall 0.80, 0.85; now 1)."""
MEDIAN_WORTH = 0.64  # what a scan is worth in a median, beside one in a mean: 2 / pi where noise is normal


class MedianScan:
    """The first scans of a robot that has not moved yet."""

    def __init__(self, lidar: LidarSpec) -> None:
        """Begin without any."""
        self._lidar, self._scans = lidar, list[Floats]()
        self.most = MOST_SCANS
        self.ended = False
        """Whether the robot has left, or has all scans that it needs: from then on none is taken."""

    @property
    def number(self) -> int:
        """How many scans there are; 0 once it has ended."""
        return len(self._scans)

    def add(self, ranges: Floats, odometry: Floats, touching: bool) -> None:
        """Take a scan's ranges (beams,), metres, as long as the robot stands. odometry: (3,) its pose by that.

        A robot that touches something may be pushed, of which odometry tells nothing.
        """
        self.ended |= touching or not at_start(odometry) or len(self._scans) >= self.most
        if self.ended:
            self._scans.clear()
        else:
            self._scans.append(ranges)

    def median(self) -> Floats:
        """Ranges (beams,) as in a scan: of each beam what most scans have, not measured, nothing, or a range."""
        scans, spec = np.sort(self._scans, 0), self._lidar  # of each beam ranges, then inf, then NaN
        measured, back = (~np.isnan(scans)).sum(0), np.isfinite(scans).sum(0)
        known = 2 * measured > len(scans)
        told = known & (2 * back > measured)
        out = np.where(known, np.inf, np.nan)
        middle = np.array(((back[told] - 1) // 2, back[told] // 2))
        out[told] = np.take_along_axis(scans[:, told], middle, 0).mean(0)
        cut = spec.range_max_m - CUT_SIGMAS * noise_at(spec, np.array(spec.range_max_m))
        out[np.isfinite(out) & (out > cut)] = np.nan
        return out


def noise_of(one: Floats, number: int) -> Floats:
    """Standard deviation of medians of so many ranges, of which one has that of (n,), metres."""
    return np.maximum(one / math.sqrt(max(MEDIAN_WORTH * number, 1.0)), UNEVEN_M)
