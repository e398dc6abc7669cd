"""Poses, points and angles in the plane, and turns in space, for robots, world and deployment alike.

A pose x, y, theta (metres, radians counter-clockwise) says how one frame lies in another. It is also the rigid
transform that takes points of the first frame into the second: no scale, no mirror.
"""

import math
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from protocol.arrays import Floats

Pose = tuple[float, float, float]

Angle = TypeVar("Angle", float, Floats)


def wrapped(angle: Angle, period: float = 2.0 * math.pi) -> Angle:
    """Angles, radians, in (-period / 2, period / 2]."""
    half: float = 0.5 * period
    return half - (half - angle) % period


def compose(a: Pose, b: Pose) -> Pose:
    """Pose b, given in the frame a, in the frame in which a is given."""
    c, s = math.cos(a[2]), math.sin(a[2])
    return a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], wrapped(a[2] + b[2])


def relative(a: Pose, b: Pose) -> Pose:
    """Pose b in the frame a; both are given in one frame."""
    c, s = math.cos(a[2]), math.sin(a[2])
    dx, dy = b[0] - a[0], b[1] - a[1]
    return c * dx + s * dy, c * dy - s * dx, wrapped(b[2] - a[2])


def inverted(pose: Pose) -> Pose:
    """How the frame in which a pose is given lies in the pose's own."""
    return relative(pose, (0.0, 0.0, 0.0))


def pose_of(row: Floats) -> Pose:
    """A row (3,) as a pose."""
    x, y, theta = row.tolist()
    return x, y, theta


def apply(transform: Sequence[float] | Floats, points: Floats) -> Floats:
    """Points (n, 2) of a frame moved by a transform (3,), which is the frame's pose."""
    if not len(points):
        return np.zeros((0, 2))  # most scans have no disc
    return np.asarray(points @ _axes(transform) + np.asarray(transform)[:2], np.float64)


def seen_from(pose: Sequence[float] | Floats, points: Floats) -> Floats:
    """Points (n, 2) in the frame of a pose (3,): the inverse of `apply`."""
    if not len(points):
        return np.zeros((0, 2))
    return np.asarray((points - np.asarray(pose)[:2]) @ _axes(pose).T, np.float64)


def rotations(quaternions: Floats) -> Floats:
    """(n, 3, 3) of quaternions (n, 4) x, y, z, w of any length; NaN of none."""
    with np.errstate(invalid="ignore", divide="ignore"):
        x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    return np.stack(
        (
            np.stack((1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)), -1),
            np.stack((2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)), -1),
            np.stack((2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)), -1),
        ),
        1,
    )


def _axes(pose: Sequence[float] | Floats) -> Floats:
    """(2, 2) the axes of a pose as rows."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.array(((c, s), (-s, c)))
