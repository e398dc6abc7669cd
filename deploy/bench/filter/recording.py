"""What one robot saw on a whole run, to be replayed into other filters, and the truth in the robot's own frame."""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from agent.config import AgentConfig
from agent.corner_scan import CornerScan
from agent.mapping.particle_filter import WireframeFilter
from agent.perception.perceive import perceive
from agent.robot import Robot, Step
from deploy.bench.explored import explore
from deploy.metrics import Truth
from protocol.arrays import Floats
from protocol.geometry import Pose, apply, relative
from protocol.messages import Observation, RobotSpec

HERE: Pose = (0.0, 0.0, 0.0)  # pose of the frame of a recording's truth, for a score: it is the robot's own


class ScanRecording(NamedTuple):
    """One run of one robot with exact odometry. Metres, robot's own frame."""

    spec: RobotSpec
    seed: int
    ranges: Floats  # (t, beams), inf where nothing came back
    poses: list[Pose]  # True, and what the odometry says
    scans: list[CornerScan]  # the ranges, perceived by default settings
    truth: Truth

    def new_filter(self, particles: int | None = None) -> WireframeFilter:
        """A filter as the robot's mind makes it; by default with as many particles."""
        config = AgentConfig.model_validate({"filter": {} if particles is None else {"particles": particles}})
        return Robot("r1", self.spec, config, self.seed).filter


@lru_cache(maxsize=2)
def record(world: str, seed: int, noise_m: float | None = None, limit_s: float = 7200.0) -> ScanRecording:
    """Let a robot with default settings explore a layout and keep what it sees."""
    ranges: list[Floats] = []
    poses: list[Pose] = []

    def watch(robot: Robot, observation: Observation, step: Step) -> None:
        ranges.append(observation.scan())
        poses.append(observation.odometry)

    lidar = {} if noise_m is None else {"noise_m": noise_m}
    settings = {"world": world, "robots": 1, "seed": seed, "spec": {"lidar": lidar}, "max_time_s": limit_s}
    run = explore(settings, {}, watch)
    spec = run.episode.config.spec
    scans = [perceive(row, spec) for row in ranges]
    return ScanRecording(spec, seed, np.stack(ranges), poses, scans, _moved(run.truth(), run.frame()))


def _moved(truth: Truth, frame: Pose) -> Truth:
    """The truth in the frame of this pose."""
    back = relative(frame, HERE)
    points = {name: apply(back, getattr(truth, name)) for name in ("corners", "seen_points", "seen_corners")}
    outline = apply(back, truth.outline.reshape(-1, 2)).reshape(-1, 4)
    return replace(truth, outline=outline, seen_directions=apply((0.0, 0.0, back[2]), truth.seen_directions), **points)
