"""Walls that no scan shows, such as panes of glass: found by pushing against them (ours)."""

import math

import numpy as np

from agent.exploration.config import DrivingConfig
from agent.exploration.planning import GIVE_M, NODE_SHARE, circle
from protocol.arrays import Floats
from protocol.geometry import Pose
from protocol.messages import RobotSpec

PUSHING_SHARE = 0.3
"""A robot that gets on by less than this share of what was commanded pushes against something."""
PUSHING_S = 1.0
"""A robot that has pushed for so long pushes against an unseen wall."""
MOST_WALLS = 50
"""Most unseen walls kept in memory (32 bytes each): 12 m of glass."""


class Touch:
    """Whether the robot pushes against something, and the unseen walls that it met so."""

    def __init__(self, spec: RobotSpec, driving: DrivingConfig) -> None:
        self.spec = spec
        self.walls = np.zeros((0, 4))
        """(b, 4) as wide as the body with its air, frame of the map."""
        self._half_m = spec.radius_m + driving.wall_air_m
        self._commanded_m = 0.0
        """Metres that the last command was to drive."""
        self._pushing = 0
        """Commands in a row that moved the robot by too little."""
        self._last = np.full(2, math.inf)

    @property
    def pushes(self) -> bool:
        """Whether the robot has pushed against something for a while."""
        return self._pushing >= round(PUSHING_S * self.spec.lidar.rate_hz)

    def feel(self, here: Floats) -> None:
        """Compare how far the robot got with its last command; here: (2,) metres."""
        went = math.hypot(here[0] - self._last[0], here[1] - self._last[1])
        self._pushing = self._pushing + 1 if went < PUSHING_SHARE * self._commanded_m else 0
        self._last = here

    def command(self, speed_mps: float) -> None:
        """Note the command for this tick."""
        self._commanded_m = speed_mps / self.spec.lidar.rate_hz

    def remember(self, pose: Pose) -> None:
        """Remember an unseen wall across the way just before the robot."""
        c, s = math.cos(pose[2]), math.sin(pose[2])
        off, half = self.spec.radius_m + GIVE_M, self._half_m
        x, y = pose[0] + off * c, pose[1] + off * s
        self.walls = np.vstack((self.walls, [x - half * s, y + half * c, x + half * s, y - half * c]))[-MOST_WALLS:]

    def nodes(self, clearance_m: float) -> Floats:
        """(j, 2) places where paths that keep the clearance bend around these walls: eight around each end."""
        return (self.walls.reshape(-1, 1, 2) + NODE_SHARE * clearance_m * circle(8)).reshape(-1, 2)
