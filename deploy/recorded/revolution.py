"""Scans of a log as a lidar that turns has taken them: each beam from where the robot was at its moment (ours).

CARMEN logs do not tell how long a scan takes, nor do bags whose drivers leave `time_increment` out. A SICK's is over in
13 ms. A small lidar of all directions turns for 0.1 to 0.2 s, in which its robot turns by up to 30 degrees. Mapped as
if they were of one moment, such scans bend a path by decimetres to metres (docs/mapping.md).
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from statistics import median

import numpy as np
from numpy.typing import NDArray

from agent.shell.ros2.laser_scan import ALL_ROUND_DEG
from deploy.recorded.lidar_log import LidarLog, Scan
from protocol.arrays import Floats
from protocol.errors import InputError
from protocol.geometry import pose_of
from protocol.messages import LidarSpec

KNOTS = 6  # poses along a revolution: every 40 ms for one of 0.2 s
APART_S = 0.2  # between two scans that are compared, at least, so that the robot may turn otherwise in each
TELLING_RAD = math.radians(3.0)
"""Difference of the turns in two scans from which their shapes differ: by as much at one end of the scan."""
PAIRS = 100  # of scans that are compared, at most: the first ones that tell
LEAST_PAIRS = 5
MOST_BEAMS = 400  # of a scan that are compared, about: all pairs of so many take 2 ms
LONGEST = 1.1  # revolutions that a lidar makes from scan to scan, at most: its speed, and stamps, err a little
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

    def __str__(self) -> str:
        order = ", against the order of its readings" if self.backwards else ""
        return f"for {self.seconds:.2f} s {'from' if self.after_s else 'up to'} each stamp{order}"


ONE_MOMENT = Revolution(0.0)


def unroll(log: LidarLog, told: Revolution | None, given_s: float | None, from_stamp: bool = False) -> None:
    """Give each scan of a log the way of the lidar's revolution: as the log tells it, or else as the scans show it.

    given_s: its seconds by the user, whatever the log tells. from_stamp: whether stamps of this kind of log should be
    those of the begins of scans, where the scans do not show which. Raises InputError where a revolution would take
    longer than it is from scan to scan.
    """
    period_s = _period_s(log.scans)
    if given_s is not None and period_s is not None and given_s > LONGEST * period_s:
        raise InputError(f"--revolution {given_s:g}: scans are {period_s:.3g} s apart; give at most that")
    if told is None:
        revolution = _shown(log, given_s, from_stamp)
    else:
        revolution = told if given_s is None else replace(told, seconds=given_s)
    if revolution.seconds <= 0 or not log.scans:
        return
    ways = _ways(log.scans, revolution)
    if alike := int(_of_one_stamp(log.scans).sum()):
        log.notes.append(f"{alike} scans share their stamp with another, and are taken as of one moment")
    for k, scan in enumerate(log.scans):
        if revolution.after_s:
            scan = scan._replace(time_s=scan.time_s + revolution.after_s, odometry=pose_of(ways[k, -1]))
        ranges = scan.ranges[::-1] if revolution.backwards else scan.ranges
        log.scans[k] = scan._replace(ranges=ranges, way=ways[k])
    log.lidar = _turning(log.lidar, revolution.backwards)
    if told is None:
        log.notes.append(f"its lidar is taken to turn {revolution} (--revolution tells for how long)")


def _shown(log: LidarLog, given_s: float | None, from_stamp: bool) -> Revolution:
    """The revolution of a lidar of all directions, as far as its scans show it.

    It makes a scan in each revolution. Whether its beams are of one moment shows where the robot begins or ends to
    turn: two scans lie on each other only if they are drawn as they were taken.
    """
    period_s = _period_s(log.scans)
    seconds = given_s if given_s is not None else period_s or 0.0
    looks_s = seconds * (log.lidar.field_of_view_deg / 360)  # from its first beam on: it need not look all round
    usual = ONE_MOMENT if given_s is None else Revolution(seconds, looks_s if from_stamp else 0.0)
    if log.lidar.field_of_view_deg < ALL_ROUND_DEG or period_s is None or seconds <= 0:
        return usual
    tried = [Revolution(seconds, after_s, backwards) for backwards in (False, True) for after_s in (0.0, looks_s)]
    ways = _ways(log.scans, tried[0])
    turns, between = ways[:, -1, 2] - ways[:, 0, 2], max(1, round(APART_S / period_s))
    tells = np.abs(turns[between:] - turns[:-between]) > TELLING_RAD
    first = np.flatnonzero(tells | np.append(tells[1:], False))[:PAIRS].tolist()  # up to stamps, or from them on
    if len(first) < LEAST_PAIRS:
        return usual
    pairs = [(k, k + between) for k in first]
    apart = {one: _apart(log, one, pairs) for one in tried}
    best = min(tried, key=lambda one: apart[one])
    return best if given_s is not None or apart[best] < SHARPER * _apart(log, ONE_MOMENT, pairs) else ONE_MOMENT


def _period_s(scans: list[Scan]) -> float | None:
    """The median time from scan to scan; None where no time passes."""
    steps = [b.time_s - a.time_s for a, b in pairwise(scans) if b.time_s > a.time_s]
    return median(steps) if steps else None


def _ways(scans: list[Scan], revolution: Revolution) -> Floats:
    """(n, KNOTS, 3) poses of the lidar by odometry, at equal steps along each scan's revolution.

    Scans of one stamp stay where odometry has them: nothing tells how the robot moved.
    """
    times, poses = np.array([scan.time_s for scan in scans]), np.array([scan.odometry for scan in scans])
    poses[:, 2] = np.unwrap(poses[:, 2])
    moments = times[:, None] + revolution.after_s - revolution.seconds * np.linspace(1.0, 0.0, KNOTS)
    ways = np.stack([np.interp(moments, times, column) for column in poses.T], -1)
    alike = _of_one_stamp(scans)
    ways[alike] = poses[alike, None]
    return ways


def _of_one_stamp(scans: list[Scan]) -> NDArray[np.bool_]:
    """Which scans have the stamp of the one before or after them."""
    alike = np.append(False, np.diff([scan.time_s for scan in scans]) <= 0)
    alike[:-1] |= alike[1:]
    return alike


def _turning(lidar: LidarSpec, backwards: bool = False) -> LidarSpec:
    told: dict[str, object] = {"turning": True}
    if backwards:
        last = math.degrees(float(lidar.bearings()[-1]))
        told |= {"first_beam_deg": math.remainder(last, 360.0), "clockwise": not lidar.clockwise}
    return lidar.model_copy(update=told)


def _apart(log: LidarLog, revolution: Revolution, pairs: list[tuple[int, int]]) -> float:
    """Metres from the places of one scan to those of another, for pairs of scans: a median each, their sum."""
    moments = _turning(log.lidar).moments() if revolution.seconds else np.ones(log.lidar.beams)
    moments = moments[::-1] if revolution.backwards else moments
    ways, bearings, total = _ways(log.scans, revolution), log.lidar.bearings(), 0.0
    for pair in pairs:
        one, other = (_hits(log.scans[k].ranges, ways[k], bearings, moments) for k in pair)
        if len(one) and len(other):
            total += float(np.median(np.hypot(*(one[:, None] - other[None]).transpose(2, 0, 1)).min(1)))
    return total


def _hits(ranges: Floats, way: Floats, bearings: Floats, moments: Floats) -> Floats:
    """(n, 2) where beams (b,) of a scan have hit something, in the frame of odometry; of many beams some."""
    hit = np.flatnonzero(np.isfinite(ranges) & (ranges > 0.0))[:: 1 + len(ranges) // MOST_BEAMS]
    x, y, heading = (np.interp(moments[hit], np.linspace(0.0, 1.0, len(way)), column) for column in way.T)
    angle = heading + bearings[hit]
    return np.column_stack((x + ranges[hit] * np.cos(angle), y + ranges[hit] * np.sin(angle)))
