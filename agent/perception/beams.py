"""The beams of one revolution of the lidar, in the robot's frame at the scan's stamp (ours).

A lidar that turns takes its beams one after the other, each from where the robot was at that moment. Odometry says
where that was: every beam has its own origin, and what it met is a point in the one frame of the stamp.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from agent.kernels import kernel
from protocol.arrays import Floats, Ints
from protocol.geometry import wrapped
from protocol.messages import LidarSpec

SEAM_BEAMS = 1.5  # neighbours farther apart than so many beams have a part between them that was not measured


class Beams(NamedTuple):
    """A closed ring of n beams by rising bearing. Metres and radians in the robot's frame at the stamp.

    What was not measured (a limited field of view, what a robot that turns back left out, the seam between the first
    and the last beam of a revolution) is filled with beams of range NaN, so that neighbours in the ring are neighbours.
    """

    ranges: Floats  # (n,) from each beam's origin; inf where nothing came back, NaN where nothing was measured
    origins: Floats  # (n, 2) where the lidar was
    directions: Floats  # (n, 2) unit vectors
    moments: Floats  # (n,) when they were taken: 0 at the start of the revolution, 1 at the stamp
    distances: Floats  # (n,) from the robot at the stamp to what was met; inf where nothing was
    bearings: Floats  # (n,) of what was met, or of the beam's end at the lidar's range; rising but for parallax
    step: float  # angle between neighbours while the robot does not turn
    shift: float  # greatest distance of an origin from the robot at the stamp


class _Ring(NamedTuple):
    """A ring of n beams whatever they meet: fields of `Beams`, and which of a scan's ranges they have."""

    order: Ints  # (m,) places in the scan; what follows in the ring was not measured
    origins: Floats
    directions: Floats
    moments: Floats
    angles: Floats  # (n,) of the directions, rad, rising
    step: float
    shift: float


def ring_of(ranges: Floats, lidar: LidarSpec, way: Floats | None = None) -> Beams:
    """The beams of a scan (beams,), metres, in the order in which an observation has them.

    way: (k + 1, 3) odometry poses at equal steps from the revolution's start to its stamp; None: the robot stood still.
    """
    order, origins, directions, moments, angles, step, shift = (
        _ring(lidar, way) if way is not None and lidar.turning else _ring_at_rest(lidar)
    )
    ranges = np.concatenate((ranges[order], np.full(len(angles) - len(order), np.nan)))
    if shift > 0:
        distances, angles = _from_the_stamp(ranges, origins, directions, angles, lidar.range_max_m)
    else:
        distances = np.where(np.isnan(ranges), np.inf, ranges)
    return Beams(ranges, origins, directions, moments, distances, angles, step, shift)


def _ring(lidar: LidarSpec, way: Floats) -> _Ring:
    """The ring of a revolution on a way (k + 1, 3) as of `ring_of`."""
    bearings, moments = _looks(lidar)
    origins, angles = _beams_on(way, bearings, moments, lidar.mount_x_m, lidar.mount_y_m)
    step = abs(float(bearings[1] - bearings[0]))
    order, origins, moments, angles, shift = _closed(origins, moments, angles, step, lidar.clockwise, lidar.turning)
    return _Ring(order, origins, np.column_stack((np.cos(angles), np.sin(angles))), moments, angles, step, shift)


@lru_cache
def _looks(lidar: LidarSpec) -> tuple[Floats, Floats]:
    """Where and when each beam looks; not to be changed."""
    return lidar.bearings(), lidar.moments()


@lru_cache
def _ring_at_rest(lidar: LidarSpec) -> _Ring:
    """The ring of a robot that stands, or whose beams are all taken at once."""
    return _ring(lidar, np.zeros((1, 3)))


@kernel
def _from_the_stamp(
    ranges: Floats, origins: Floats, directions: Floats, angles: Floats, range_max_m: float
) -> tuple[Floats, Floats]:
    """Distances and bearings (n,) of beams, as of `Beams`, of which the origins are elsewhere than the robot."""
    distances, bearings = np.empty(len(ranges)), np.empty(len(ranges))
    for j in range(len(ranges)):
        met = math.isfinite(ranges[j])
        reach = ranges[j] if met else range_max_m
        x, y = origins[j, 0] + reach * directions[j, 0], origins[j, 1] + reach * directions[j, 1]
        distances[j] = math.hypot(x, y) if met else math.inf
        bearings[j] = angles[j] + wrapped(math.atan2(y, x) - angles[j])
    return distances, bearings


@kernel
def _beams_on(way: Floats, bearings: Floats, moments: Floats, mount_x: float, mount_y: float) -> tuple[Floats, Floats]:
    """Origins (n, 2) and angles (n,) of beams taken on a way (k + 1, 3), in the frame of its last pose.

    bearings, moments: (n,) of the beams. mount_x, mount_y: metres, where the lidar is on the robot.
    """
    last = len(way) - 1
    x, y, theta = way[last]
    c, s = math.cos(theta), math.sin(theta)
    knots = np.zeros((last + 1, 3))
    for i in range(last - 1, -1, -1):
        dx, dy = way[i, 0] - x, way[i, 1] - y
        knots[i, 0], knots[i, 1] = c * dx + s * dy, c * dy - s * dx
        knots[i, 2] = knots[i + 1, 2] + wrapped(way[i, 2] - way[i + 1, 2])
    origins, angles = np.empty((len(moments), 2)), np.empty(len(moments))
    for j in range(len(moments)):
        before = max(min(int(moments[j] * last), last - 1), 0)
        after = min(before + 1, last)
        share = moments[j] * last - before
        turned = knots[before, 2] + share * (knots[after, 2] - knots[before, 2])
        c, s = math.cos(turned), math.sin(turned)
        origins[j, 0] = knots[before, 0] + share * (knots[after, 0] - knots[before, 0]) + c * mount_x - s * mount_y
        origins[j, 1] = knots[before, 1] + share * (knots[after, 1] - knots[before, 1]) + s * mount_x + c * mount_y
        angles[j] = turned + bearings[j]
    return origins, angles


@kernel
def _closed(
    origins: Floats, moments: Floats, angles: Floats, step: float, clockwise: bool, turning: bool
) -> tuple[Ints, Floats, Floats, Floats, float]:
    """Beams (n,) as a ring, in which each direction is once: order, origins, moments, angles and shift of a `_Ring`."""
    n, once = len(angles), np.empty(len(angles), np.int64)
    m = 0
    for k in range(n - 1, -1, -1) if clockwise else range(n):
        if abs(angles[k] - angles[n - 1]) < 2 * math.pi - 0.5 * step:  # who turns along sees some directions twice
            once[m] = k
            m += 1
    order = once[:m]
    left_out = 2 * math.pi - (angles[order[m - 1]] - angles[order[0]])
    fill = max(1, round(left_out / step) - 1) if turning or left_out > SEAM_BEAMS * step else 0
    ring_origins, ring_moments, ring_angles = np.zeros((m + fill, 2)), np.ones(m + fill), np.empty(m + fill)
    shift = 0.0
    for j in range(m):
        ring_origins[j], ring_moments[j], ring_angles[j] = origins[order[j]], moments[order[j]], angles[order[j]]
        shift = max(shift, math.hypot(origins[order[j], 0], origins[order[j], 1]))
    for j in range(fill):
        ring_angles[m + j] = ring_angles[m - 1] + (j + 1) / (fill + 1) * left_out
    return order, ring_origins, ring_moments, ring_angles, shift


@kernel
def width_of(beams: Beams, first: int, last: int) -> float:
    """Angle from beam `first` counter-clockwise to beam `last`; negative where parallax turns it round."""
    n, expected = len(beams.bearings), (last - first) * beams.step
    return float(expected + wrapped(beams.bearings[last % n] - beams.bearings[first % n] - expected))
