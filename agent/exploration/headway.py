"""Whether the robot gets on along its path, waits for a teammate, or is stuck (ours)."""

import math
from typing import Literal

import numpy as np

from agent.exploration.driving import SLOW_SHARE
from protocol.messages import RobotSpec

LEAST_M = 0.06  # a path that got shorter by less is no progress: one tick and a half of driving
STUCK_S = 4.0  # without progress for this long a robot is stuck, if it can turn about and get on slowly in the time
WAIT_S = 4.0  # mean wait for a teammate to clear the way; half to one and a half of it is drawn, so that one gives way

Pace = Literal["free", "impatient", "stuck"]  # impatient: a teammate has barred the way for longer than the patience


class Headway:
    """The shortest that the path ahead has been, and how long nothing has come of driving."""

    def __init__(self, rng: np.random.Generator, spec: RobotSpec) -> None:
        self.rng, self.rate_hz = rng, spec.lidar.rate_hz
        self.stuck_s = max(STUCK_S, math.pi / spec.max_turn_rps + LEAST_M / (SLOW_SHARE * spec.max_speed_mps))
        self.patience = 0  # ticks that the robot waits for a teammate
        self._least_left_m, self._tick, self._blocked = math.inf, 0, 0  # the tick of that; ticks barred since then

    def restart(self, tick: int) -> None:
        """Begin anew, with new patience."""
        self._least_left_m, self._tick, self._blocked = math.inf, tick, 0
        self.patience = round(WAIT_S * (0.5 + self.rng.random()) * self.rate_hz)

    def allow(self, left_m: float) -> None:
        """A new path to the same target may be longer."""
        self._least_left_m = max(self._least_left_m, left_m)

    def judge(self, tick: int, left_m: float, blocked: bool) -> Pace:
        """How the robot gets on with left_m (metres) to go; blocked: whether a teammate holds it back."""
        if left_m < self._least_left_m - LEAST_M:
            self._least_left_m, self._tick, self._blocked = left_m, tick, 0
        elif blocked:
            self._tick = tick
            self._blocked += 1
            if self._blocked > self.patience:
                return "impatient"
        elif tick - self._tick > self.stuck_s * self.rate_hz:
            return "stuck"
        return "free"
