"""What the wheels say: each robot's pose in its own frame, which is its start pose."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from protocol.messages import OdometrySpec

Pose = tuple[float, float, float]


class Odometry:
    """Dead reckoning of one robot: exact (paper III), or with errors that add up as a random walk."""

    def __init__(self, start: NDArray[np.float64], config: OdometrySpec, rng: np.random.Generator) -> None:
        """`start` is (3,), the pose in the world that becomes the origin of the robot's own frame."""
        self._start: Pose = _pose(start)
        self._config = config
        self._rng = rng
        self._true: Pose = self._start
        self.pose: Pose = (0.0, 0.0, 0.0)
        """Where the robot believes to be, in its own frame; theta in (-pi, pi]."""

    def update(self, true: NDArray[np.float64]) -> Pose:
        """The believed pose after the robot moved to `true`, (3,) in the world."""
        before, self._true = self._true, _pose(true)
        if not self._config.noisy:
            self.pose = _wrapped(relative(self._start, self._true))
            return self.pose
        dx, dy, turn = relative(before, self._true)
        distance = math.hypot(dx, dy)
        along, spin = self._rng.standard_normal(2).tolist()
        # variances, not deviations, add up over steps: the walk is the same however time is cut
        scale = 1 + along * self._config.distance_sd / math.sqrt(distance) if distance > 1e-9 else 1.0
        turn += spin * math.sqrt(
            math.radians(self._config.heading_sd_deg) ** 2 * distance + self._config.turn_sd**2 * abs(turn)
        )
        self.pose = _wrapped(compose(self.pose, (scale * dx, scale * dy, turn)))
        return self.pose


def compose(a: Pose, b: Pose) -> Pose:
    """Pose b, given in the frame a, in the frame that a is given in."""
    c, s = math.cos(a[2]), math.sin(a[2])
    return a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], a[2] + b[2]


def relative(a: Pose, b: Pose) -> Pose:
    """Pose b in the frame a; both are given in one frame."""
    c, s = math.cos(a[2]), math.sin(a[2])
    dx, dy = b[0] - a[0], b[1] - a[1]
    return c * dx + s * dy, c * dy - s * dx, b[2] - a[2]


def _pose(row: NDArray[np.float64]) -> Pose:
    x, y, theta = row.tolist()
    return x, y, theta


def _wrapped(pose: Pose) -> Pose:
    return pose[0], pose[1], math.pi - (math.pi - pose[2]) % (2 * math.pi)
