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
from protocol.geometry import relative, wrapped
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
    distances = np.where(np.isnan(ranges), np.inf, ranges)
    if shift > 0:
        ends = origins + np.where(np.isfinite(ranges), ranges, lidar.range_max_m)[:, None] * directions
        angles = angles + wrapped(np.arctan2(ends[:, 1], ends[:, 0]) - angles)
        distances = np.where(np.isfinite(ranges), np.hypot(*ends.T), np.inf)
    return Beams(ranges, origins, directions, moments, distances, angles, step, shift)


def _ring(lidar: LidarSpec, way: Floats | None) -> _Ring:
    """The ring of a revolution on a way (k + 1, 3) as of `ring_of`, or of one without motion."""
    bearings, moments = lidar.bearings(), lidar.moments()
    places = np.zeros((lidar.beams, 3)) if way is None else _places_at(moments, way)
    step = abs(float(bearings[1] - bearings[0]))
    c, s = np.cos(places[:, 2]), np.sin(places[:, 2])
    x, y = lidar.mount_x_m, lidar.mount_y_m
    origins = places[:, :2] + np.column_stack((c * x - s * y, s * x + c * y))
    angles = places[:, 2] + bearings
    once = np.abs(angles - angles[-1]) < 2 * math.pi - 0.5 * step  # a robot that turns along sees some directions twice
    order = np.flatnonzero(once)[:: -1 if lidar.clockwise else 1]
    origins, moments, angles = origins[order], moments[order], angles[order]
    left_out = 2 * math.pi - (angles[-1] - angles[0])
    if lidar.turning or left_out > SEAM_BEAMS * step:
        fill = max(1, round(left_out / step) - 1)
        origins, moments = np.vstack((origins, np.zeros((fill, 2)))), np.concatenate((moments, np.ones(fill)))
        angles = np.concatenate((angles, angles[-1] + np.arange(1, fill + 1) / (fill + 1) * left_out))
    directions = np.column_stack((np.cos(angles), np.sin(angles)))
    return _Ring(order, origins, directions, moments, angles, step, float(np.hypot(*origins.T).max()))


@lru_cache
def _ring_at_rest(lidar: LidarSpec) -> _Ring:
    """The ring of a robot that stands, or whose beams are all taken at once."""
    return _ring(lidar, None)


def _places_at(moments: Floats, way: Floats) -> Floats:
    """(n, 3) poses of the robot at its beams' moments, in the frame of the last pose of its way (k + 1, 3)."""
    last = (float(way[-1, 0]), float(way[-1, 1]), float(way[-1, 2]))
    knots = np.array([relative(last, (x, y, theta)) for x, y, theta in way.tolist()])
    knots[:, 2] = np.unwrap(knots[:, 2])
    knots[:, 2] -= knots[-1, 2]
    at = np.linspace(0.0, 1.0, len(knots))
    return np.column_stack([np.interp(moments, at, column) for column in knots.T])


@kernel
def width_of(beams: Beams, first: int, last: int) -> float:
    """Angle from beam `first` counter-clockwise to beam `last`; negative where parallax turns it round."""
    n, expected = len(beams.bearings), (last - first) * beams.step
    return float(expected + wrapped(beams.bearings[last % n] - beams.bearings[first % n] - expected))
