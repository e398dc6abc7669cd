"""What the wheels say: each robot's pose in its own frame, which is its start pose."""

import math

import numpy as np

from protocol.arrays import Floats
from protocol.geometry import Pose, compose, relative
from protocol.messages import OdometrySpec
from world.checkpoint import State, luck_state, restore_luck


class Odometry:
    """Dead reckoning of one robot: exact (paper III), or with errors that add up as a random walk."""

    def __init__(self, start: Floats, config: OdometrySpec, rng: np.random.Generator) -> None:
        """`start` is (3,), the pose in the world that becomes the origin of the robot's own frame."""
        self._start = self._true = _pose(start)
        self._config, self._rng = config, rng
        self.pose: Pose = (0.0, 0.0, 0.0)
        """Where the robot believes to be, in its own frame; theta in (-pi, pi]."""

    def update(self, true: Floats) -> Pose:
        """The believed pose after the robot moved to `true`, (3,) in the world."""
        before, self._true = self._true, _pose(true)
        config = self._config
        if not config.noisy:
            self.pose = relative(self._start, self._true)
            return self.pose
        dx, dy, turn = relative(before, self._true)
        distance = math.hypot(dx, dy)
        along, spin = self._rng.standard_normal(2).tolist()
        # variances, not deviations, add up over steps: the walk is the same however time is cut
        scale = 1 + along * config.distance_sd / math.sqrt(distance) if distance > 1e-9 else 1.0
        turn += spin * math.sqrt(math.radians(config.heading_sd_deg) ** 2 * distance + config.turn_sd**2 * abs(turn))
        self.pose = compose(self.pose, (scale * dx, scale * dy, turn))
        return self.pose

    def state(self) -> State:
        """For a checkpoint."""
        return {"true": self._true, "pose": self.pose, "rng": luck_state(self._rng)}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        self._true, self.pose = (_pose(np.array(state[name], np.float64)) for name in ("true", "pose"))
        restore_luck(self._rng, state["rng"])


def _pose(row: Floats) -> Pose:
    x, y, theta = row.tolist()
    return x, y, theta
