"""A robot that keeps a wall on its right: `wireswarm run --mind examples.wall_follower:WallFollower --until 300`.

It maps nothing. Once a second it says where it is, by the odometry in its own frame, in 24 bytes.
"""

import math
import struct
from collections.abc import Sequence

import numpy as np

from agent.shell.mind import OwnMind
from protocol.messages import Heard, Observation

NEAR_M = 0.35  # from the lidar to the wall
AHEAD_M = 0.45  # a wall nearer than this ahead is turned away from


class WallFollower(OwnMind):
    """Turns left at what is ahead, and steers by the distance and the direction of what is on its right."""

    def drive(self, observation: Observation, heard: Sequence[Heard]) -> tuple[float, float]:
        """One tick: see how far it is to the sides, say where it is, drive."""
        if observation.tick % round(self.spec.lidar.rate_hz) == 0:
            self.send("hello", struct.pack("<3d", *observation.odometry))
        ranges = np.nan_to_num(observation.scan(), nan=np.inf)
        ahead = self.nearest(ranges, 0, 25)
        right, behind = self.nearest(ranges, -70, 20), self.nearest(ranges, -110, 20)
        if ahead < AHEAD_M:
            return 0.0, 1.2
        if min(right, behind) > 3 * NEAR_M:
            return self.spec.max_speed_mps, -0.6  # round the end of a wall, or on to the next one
        error = np.clip(NEAR_M - min(right, behind), -0.3, 0.3)
        turned = np.clip(behind - right, -0.3, 0.3)  # positive where the robot heads for the wall
        return 0.8 * self.spec.max_speed_mps, float(2.0 * error + 2.0 * turned)

    def nearest(self, ranges: np.ndarray, middle_deg: float, half_deg: float) -> float:
        """Metres to the nearest thing in a sector `middle_deg` counter-clockwise from ahead; inf without one."""
        off = np.abs(np.mod(self.spec.lidar.bearings() - math.radians(middle_deg) + math.pi, math.tau) - math.pi)
        return float(ranges[off < math.radians(half_deg)].min(initial=np.inf))
