"""What the wheels say: each robot's pose in its own frame, which is its start pose."""

import math

import numpy as np

from protocol.arrays import Floats
from protocol.geometry import Pose, compose, pose_of, relative, wrapped
from protocol.messages import OdometrySpec
from protocol.wireframe import MAX_COORDINATE_M
from world.checkpoint import State, restore_rng, rng_state


class Odometry:
    """Dead reckoning of one robot: exact (paper III), or by wheels.

    Wheels err in two ways: by a random walk, and by what is wrong with this robot all the time, its two wheels' sizes
    and the length of its axle (Borenstein and Feng, "Measurement and correction of systematic odometry errors in mobile
    robots", 1996). Where the robot touches something, they slip.
    """

    def __init__(self, start: Floats, config: OdometrySpec, rng: np.random.Generator) -> None:
        """`start` is (3,), the pose in the world that becomes the origin of the robot's own frame."""
        self._start = self._true = pose_of(start)
        self._config, self._rng = config, rng
        left, right, axle = (1 + rng.standard_normal(3) * (config.wheel_sd, config.wheel_sd, config.axle_sd)).tolist()
        self._size, self._axle = (left + right) / 2, axle
        self._bend = (right - left) / config.axle_m  # rad that a straight drive seems to turn in each metre
        self.pose: Pose = (0.0, 0.0, 0.0)
        """Where the robot believes to be, in its own frame; theta in (-pi, pi]."""

    def update(self, way: Floats, turned: Floats | None = None) -> Floats:
        """The believed poses (n, 3) after the robot moved along true ones, (n, 3) in the world.

        turned (2,): metres and radians by which its wheels turned in each of the n moves, where they slip; None where
        they roll with the body.
        """
        if not self._config.noisy:
            believed = _all_relative(self._start, way)
            self._true, self.pose = pose_of(way[-1]), pose_of(believed[-1])
            return believed
        told = []
        for true in map(pose_of, way):
            before, self._true = self._true, true
            x, y, theta = compose(self.pose, self._read(*(_rolled(before, true) if turned is None else turned)))
            self.pose = _within(x), _within(y), theta
            told.append(self.pose)
        return np.array(told).reshape(-1, 3)

    def _read(self, distance: float, turn: float) -> Pose:
        """The move that the wheels tell of one by so many metres and radians."""
        config, length = self._config, abs(distance)
        along, spin = self._rng.standard_normal(2).tolist()
        # variances, not deviations, add up over steps: the walk is the same however time is cut
        spin *= math.sqrt(math.radians(config.heading_sd_deg) ** 2 * length + config.turn_sd**2 * abs(turn))
        told = self._size * distance + self._bend * turn * config.axle_m**2 / 4
        told += along * config.distance_sd * math.sqrt(length)
        turned = (self._size * turn + self._bend * distance) / self._axle + spin
        return told * math.cos(turned / 2), told * math.sin(turned / 2), turned

    def state(self) -> State:
        """For a checkpoint."""
        return {"true": self._true, "pose": self.pose, "rng": rng_state(self._rng)}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        self._true, self.pose = (pose_of(np.array(state[name], np.float64)) for name in ("true", "pose"))
        restore_rng(self._rng, state["rng"])


def _within(coordinate: float) -> float:
    """The nearest that an observation may tell. Wheels that slip for hours or err by all that is allowed get there."""
    return min(max(coordinate, -MAX_COORDINATE_M), MAX_COORDINATE_M)


def _all_relative(a: Pose, poses: Floats) -> Floats:
    """(n, 3) poses (n, 3) in the frame of pose a, as `relative` has each."""
    c, s = math.cos(a[2]), math.sin(a[2])
    dx, dy = poses[:, 0] - a[0], poses[:, 1] - a[1]
    return np.stack((c * dx + s * dy, c * dy - s * dx, wrapped(poses[:, 2] - a[2])), 1)


def _rolled(before: Pose, after: Pose) -> tuple[float, float]:
    """Metres ahead and radians by which wheels that roll with the body turn; they feel no push from the side."""
    dx, dy, turn = relative(before, after)
    return dx * math.cos(turn / 2) + dy * math.sin(turn / 2), turn
