"""The only reader of ranges (paper I, "strictly sparse"): each scan becomes a corner scan, with what is remembered."""

import numpy as np

from agent.corner_scan import CornerScan
from agent.perception.config import PerceptionConfig
from agent.perception.disc_memory import Posts, SeenDiscs
from agent.perception.perceive import perceive
from protocol.arrays import Floats
from protocol.geometry import Pose, apply, seen_from
from protocol.messages import Observation, RobotSpec
from protocol.walls import lengths
from protocol.wireframe import Wireframe

WALL_M = 0.3
"""No teammate stands in a mapped wall, unless the wall is shorter than this: it may be a teammate's own front."""


class Perception:
    """Turns observations into corner scans, and remembers teammates of the last scans and posts."""

    def __init__(self, config: PerceptionConfig, spec: RobotSpec) -> None:
        self._method, self._spec = config.method, spec
        self._seen_discs, self._posts = SeenDiscs(spec), Posts(spec)
        self._map = Wireframe()
        self._walls = np.zeros((0, 4))
        """(m, 4) walls of that map in which no teammate stands, metres."""

    def see(self, observation: Observation, predicted: Pose, own: Wireframe) -> CornerScan:
        """Corner scan of an observation. predicted: the robot's pose in the frame of its own map, before correction."""
        scan = perceive(
            observation.scan(),
            self._spec,
            self._method,
            expected=self._seen_discs.expected(observation.odometry),
            known=seen_from(predicted, self._long_walls(own).reshape(-1, 2)).reshape(-1, 4),
            posts=self._posts.seen_from(predicted),
        )
        self._seen_discs.add(observation.odometry, scan.discs)
        return scan

    def remember(self, tick: int, pose: Pose, scan: CornerScan, heard: bool) -> None:
        """Note where a scan's discs are, once the pose is corrected; heard: whether any message came in this tick."""
        self._posts.add(tick, pose, apply(pose, scan.discs), heard)

    def _long_walls(self, own: Wireframe) -> Floats:
        if own is not self._map:
            walls = own.segments()
            self._map = own
            self._walls = walls[lengths(walls) >= WALL_M]
        return self._walls
