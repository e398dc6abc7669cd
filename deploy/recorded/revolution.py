"""Scans of a log as a lidar that turns has taken them: each beam from where the robot was at its moment (ours).

CARMEN logs do not tell how long a scan takes, nor do bags whose drivers leave `time_increment` out. A SICK's is over in
13 ms. A small lidar of all directions turns for 0.1 to 0.2 s, in which its robot turns by up to 30 degrees: mapped as
if they were of one moment, the scans of our own runs gave paths that were off by 0.2 to 1.3 m, and 0.01 to 0.03 m with
each beam in its place.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

import numpy as np

from deploy.recorded.lidar_log import LidarLog, Scan
from protocol.arrays import Floats
from protocol.geometry import pose_of
from protocol.messages import LidarSpec

KNOTS = 6  # poses along a revolution: every 40 ms for one of 0.2 s
ALL_ROUND_DEG = 350.0  # who looks at so much must turn; what looks at less is asked for nothing
TELLING_RAD = math.radians(3.0)
"""Difference of the turns in two scans in a row from which their shapes differ: by as much at one end of the scan."""
PAIRS = 100  # of scans that are compared, at most: the first ones that tell
LEAST_PAIRS = 5
MOST_BEAMS = 1000  # that are compared, about: all pairs of so many take 20 ms
SHARPER = 0.8
"""Share of the distance between such scans that must be left where each beam is given its moment. Of 13 runs in 11
layouts whose lidar turns 0.41 to 0.60 are left, and 1.4 to 1.9 with stamps taken for the begins of scans; of 5 runs
whose lidar does not turn, 1.7 to 2.5."""


@dataclass(frozen=True)
class Revolution:
    """How a lidar takes a scan."""

    seconds: float
    """That a revolution takes; 0 for scans of one moment."""
    after_s: float = 0.0
    """Seconds from a scan's stamp to the end of its revolution."""
    backwards: bool = False
    """Whether readings are told in the opposite order of that in which they were taken."""


ONE_MOMENT = Revolution(0.0)


def unroll(log: LidarLog, told: Revolution | None) -> None:
    """Give each scan of a log the way of the lidar's revolution: as it was told, or else as the scans show it."""
    revolution = _shown(log) if told is None else told
    if revolution.seconds <= 0:
        return
    ways = _ways(log.scans, revolution)
    for k, scan in enumerate(log.scans):
        if revolution.after_s:
            scan = scan._replace(time_s=scan.time_s + revolution.after_s, odometry=pose_of(ways[k, -1]))
        ranges = scan.ranges[::-1] if revolution.backwards else scan.ranges
        log.scans[k] = scan._replace(ranges=ranges, way=ways[k])
    log.lidar = _turning(log.lidar, revolution.backwards)
    if told is None:
        where = "from" if revolution.after_s else "up to"
        log.notes.append(
            f"its lidar is taken to turn for {revolution.seconds:.2f} s, {where} each stamp (--revolution tells it)"
        )


def _shown(log: LidarLog) -> Revolution:
    """The revolution of a lidar of all directions, as far as its scans show it.

    It makes a scan in each revolution. Whether its beams are of one moment shows where the robot begins or ends to
    turn: two scans in a row lie on each other only if they are drawn as they were taken.
    """
    steps = [b.time_s - a.time_s for a, b in pairwise(log.scans) if b.time_s > a.time_s]
    if log.lidar.field_of_view_deg < ALL_ROUND_DEG or not steps:
        return ONE_MOMENT
    seconds = median(steps)
    to_stamp, from_stamp = Revolution(seconds), Revolution(seconds, after_s=seconds)
    ways, lidar = _ways(log.scans, to_stamp), _turning(log.lidar)
    tells = np.abs(np.diff(ways[:, -1, 2] - ways[:, 0, 2])) > TELLING_RAD
    pairs = np.flatnonzero(tells | np.append(tells[1:], False))[:PAIRS].tolist()  # up to stamps, or from them on
    if len(pairs) < LEAST_PAIRS:
        return ONE_MOMENT
    apart = {
        ONE_MOMENT: _apart(log.scans, ways, lidar, pairs, turning=False),
        to_stamp: _apart(log.scans, ways, lidar, pairs),
        from_stamp: _apart(log.scans, _ways(log.scans, from_stamp), lidar, pairs),
    }
    best = min((to_stamp, from_stamp), key=lambda one: apart[one])
    return best if apart[best] < SHARPER * apart[ONE_MOMENT] else ONE_MOMENT


def _ways(scans: list[Scan], revolution: Revolution) -> Floats:
    """(n, KNOTS, 3) poses of the lidar by odometry, at equal steps along each scan's revolution."""
    times, poses = np.array([scan.time_s for scan in scans]), np.array([scan.odometry for scan in scans])
    poses[:, 2] = np.unwrap(poses[:, 2])
    moments = times[:, None] + revolution.after_s - revolution.seconds * np.linspace(1.0, 0.0, KNOTS)
    return np.stack([np.interp(moments, times, column) for column in poses.T], -1)


def _turning(lidar: LidarSpec, backwards: bool = False) -> LidarSpec:
    told: dict[str, object] = {"turning": True}
    if backwards:
        last = math.degrees(float(lidar.bearings()[-1]))
        told |= {"first_beam_deg": math.remainder(last, 360.0), "clockwise": not lidar.clockwise}
    return lidar.model_copy(update=told)


def _hits(scan: Scan, way: Floats, lidar: LidarSpec, turning: bool) -> Floats:
    """(n, 2) where a scan's beams have hit something, in the frame of odometry; of many beams some."""
    hit = np.flatnonzero(np.isfinite(scan.ranges))[:: 1 + len(scan.ranges) // MOST_BEAMS]
    at = lidar.moments()[hit] if turning else np.ones(len(hit))
    x, y, heading = (np.interp(at, np.linspace(0.0, 1.0, len(way)), column) for column in way.T)
    angle, ranges = heading + lidar.bearings()[hit], scan.ranges[hit]
    return np.column_stack((x + ranges * np.cos(angle), y + ranges * np.sin(angle)))


def _apart(scans: list[Scan], ways: Floats, lidar: LidarSpec, pairs: list[int], turning: bool = True) -> float:
    """Metres from the places of one scan to those of the next, for so many first ones: a median each, their sum."""
    total = 0.0
    for k in pairs:
        one, other = (_hits(scans[n], ways[n], lidar, turning) for n in (k, k + 1))
        if len(one) and len(other):
            total += float(np.median(np.hypot(*(one[:, None] - other[None]).transpose(2, 0, 1)).min(1)))
    return total
