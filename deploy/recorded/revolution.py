"""Scans of a log as a lidar that turns has taken them: each beam from where the robot was at its moment (ours).

CARMEN logs do not tell how long a scan takes. A SICK's is over in 13 ms. A small lidar of all directions turns for 0.1
to 0.2 s, in which its robot turns by up to 30 degrees: mapped as if they were of one moment, the scans of our own runs
gave paths that were off by 0.2 to 1.3 m, and 0.01 to 0.03 m with each beam in its place.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

import numpy as np

from deploy.recorded.lidar_log import LidarLog, Scan
from protocol.arrays import Floats
from protocol.messages import LidarSpec

KNOTS = 6  # poses along a revolution: every 40 ms for one of 0.2 s
ALL_ROUND_DEG = 350.0  # who looks at so much must turn; what looks at less is asked for nothing
TELLING_RAD = math.radians(3.0)
"""Difference of the turns in two scans in a row from which their shapes differ: by as much at one end of the scan."""
PAIRS = 100  # of scans that are compared, at most: the first ones that tell
LEAST_PAIRS = 5
SHARPER = 0.8
"""Share of the distance between such scans that must be left where each beam is given its moment. Of 13 runs in 11
layouts whose lidar turns 0.34 to 0.50 are left, of 5 whose lidar does not, 2.3 to 2.8."""


@dataclass(frozen=True)
class Revolution:
    """How a lidar takes a scan."""

    seconds: float
    """That a revolution takes; 0 for scans of one moment."""
    backwards: bool = False
    """Whether readings are told in the opposite order of that in which they were taken."""


def unrolled(log: LidarLog, revolution: Revolution) -> None:
    """Give each scan of a log the way of the lidar's revolution that ends at its stamp."""
    ways = _ways(log.scans, revolution.seconds)
    for k, scan in enumerate(log.scans):
        ranges = scan.ranges[::-1] if revolution.backwards else scan.ranges
        log.scans[k] = scan._replace(ranges=ranges, way=ways[k])
    log.lidar = _turning(log.lidar, revolution.backwards)


def seconds_of(log: LidarLog) -> float:
    """Seconds that a lidar of all directions takes for a revolution, as far as its scans show it; else 0.

    It makes a scan in each revolution. Whether its beams are of one moment shows where the robot begins or ends to
    turn: two scans in a row lie on each other only if they are drawn as they were taken.
    """
    steps = [b.time_s - a.time_s for a, b in pairwise(log.scans) if b.time_s > a.time_s]
    if log.lidar.field_of_view_deg < ALL_ROUND_DEG or not steps:
        return 0.0
    seconds = median(steps)
    ways, lidar = _ways(log.scans, seconds), _turning(log.lidar)
    turns = ways[:, -1, 2] - ways[:, 0, 2]
    pairs = np.flatnonzero(np.abs(np.diff(turns)) > TELLING_RAD)[:PAIRS].tolist()
    apart = np.zeros(2)
    for k in pairs:
        for row, turning in enumerate((False, True)):
            one, other = (_hits(log.scans[n], ways[n], lidar, turning) for n in (k, k + 1))
            apart[row] += _apart(one, other)
    return seconds if len(pairs) >= LEAST_PAIRS and apart[1] < SHARPER * apart[0] else 0.0


def _ways(scans: list[Scan], seconds: float) -> Floats:
    """(n, KNOTS, 3) poses of the lidar by odometry, at equal steps up to each scan's stamp."""
    times, poses = np.array([scan.time_s for scan in scans]), np.array([scan.odometry for scan in scans])
    poses[:, 2] = np.unwrap(poses[:, 2])
    moments = times[:, None] - seconds * np.linspace(1.0, 0.0, KNOTS)
    return np.stack([np.interp(moments, times, column) for column in poses.T], -1)


def _turning(lidar: LidarSpec, backwards: bool = False) -> LidarSpec:
    told: dict[str, object] = {"turning": True}
    if backwards:
        last = math.degrees(float(lidar.bearings()[-1]))
        told |= {"first_beam_deg": math.remainder(last, 360.0), "clockwise": not lidar.clockwise}
    return lidar.model_copy(update=told)


def _hits(scan: Scan, way: Floats, lidar: LidarSpec, turning: bool) -> Floats:
    """(n, 2) where a scan's beams have hit something, in the frame of odometry."""
    hit = np.flatnonzero(np.isfinite(scan.ranges))
    at = lidar.moments()[hit] if turning else np.ones(len(hit))
    x, y, heading = (np.interp(at, np.linspace(0.0, 1.0, len(way)), column) for column in way.T)
    angle, ranges = heading + lidar.bearings()[hit], scan.ranges[hit]
    return np.column_stack((x + ranges * np.cos(angle), y + ranges * np.sin(angle)))


def _apart(one: Floats, other: Floats) -> float:
    """Median distance, metres, from a place of one scan to the nearest of the other; 0 where one has none."""
    if not len(one) or not len(other):
        return 0.0
    return float(np.median(np.hypot(*(one[:, None] - other[None]).transpose(2, 0, 1)).min(1)))
