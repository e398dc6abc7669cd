"""What one robot saw on a whole run, to be replayed into other filters, and the truth in the robot's own frame."""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from agent.config import AgentConfig
from agent.corner_scan import CornerScan
from agent.mapping.particle_filter import WireframeFilter
from agent.mapping.wheels import moves_of, way_from
from agent.perception.perceive import perceive
from agent.robot import Robot, Step
from deploy.bench.explored import explore
from deploy.metrics import Truth
from deploy.sensing import IDEAL, REAL
from protocol.arrays import Floats
from protocol.geometry import Pose, apply, inverted, pose_of, relative
from protocol.messages import Observation, RobotSpec

HERE: Pose = (0.0, 0.0, 0.0)  # pose of the frame of a recording's truth, for a score: it is the robot's own


class ScanRecording(NamedTuple):
    """One run of one robot. Metres, robot's own frame."""

    spec: RobotSpec
    seed: int
    ranges: Floats  # (t, beams), inf where nothing came back
    poses: list[Pose]  # true ones
    ways: list[Floats]  # (k, 3) each: the odometry's poses since the last scan
    scans: list[CornerScan]  # the ranges, perceived by default settings
    truth: Truth

    def new_filter(self, particles: int | None = None) -> WireframeFilter:
        """A filter as the robot's mind makes it; by default with as many particles."""
        config = AgentConfig.model_validate({"filter": {} if particles is None else {"particles": particles}})
        return Robot("r1", self.spec, config, self.seed).filter

    def at(self, tick: int) -> int:
        """Which scan is seen at a tick: all in order, then back to the first, and so on.

        So a filter that was lost nowhere finds its way, whatever the odometry says of it: it never jumps.
        """
        last = len(self.scans) - 1
        return last - abs(last - tick % (2 * last))

    def show(self, mind: WireframeFilter, tick: int) -> None:
        """Let a filter see the scan of a tick; all earlier ticks must have been shown."""
        k = self.at(tick)
        way = self.ways[k]
        if tick and self.at(tick - 1) > k:
            way = np.vstack((self.ways[k + 1][-2::-1], way[-1:]))
        mind.update(self.scans[k], way)


@lru_cache(maxsize=2)
def record(
    world: str, seed: int, noise_m: float | None = None, limit_s: float = 7200.0, *, real: bool = False
) -> ScanRecording:
    """Let a robot with ideal, or with real sensing, explore a layout and keep what it sees."""
    ranges: list[Floats] = []
    ways: list[Floats] = []
    turns: list[Floats] = []  # the same in the frame of the last pose, as the robot knows its wheels

    def watch(robot: Robot, observation: Observation, step: Step) -> None:
        ranges.append(observation.scan())
        turn = way_from(pose_of(ways[-1][-1]) if ways else HERE, observation.poses())
        if observation.tick and robot.spec.odometry.noisy:
            turn = robot.filter.wheels.way(moves_of(turn), robot.filter.best)
        ways.append(observation.poses())
        turns.append(turn)

    spec = REAL if real else IDEAL
    spec = {**spec, "lidar": spec["lidar"] | ({} if noise_m is None else {"noise_m": noise_m})}
    settings = {"world": world, "robots": 1, "seed": seed, "spec": spec, "max_time_s": limit_s}
    run = explore(settings, {}, watch)
    body, frame = run.episode.config.spec, run.frame()
    # the robot heard nobody, so no disc was a teammate to it and hid the wall behind
    scans = [perceive(row, body, way=turn, alone=True, company=False) for row, turn in zip(ranges, turns, strict=True)]
    poses = [relative(frame, pose_of(true[0])) for true in run.tracks.true[: len(scans)]]
    return ScanRecording(body, seed, np.stack(ranges), poses, ways, scans, _moved(run.truth(), frame))


def _moved(truth: Truth, frame: Pose) -> Truth:
    """The truth in the frame of this pose."""
    back = inverted(frame)
    points = {name: apply(back, getattr(truth, name)) for name in ("corners", "seen_points", "seen_corners")}
    outline = apply(back, truth.outline.reshape(-1, 2)).reshape(-1, 4)
    return replace(truth, outline=outline, seen_directions=apply((0.0, 0.0, back[2]), truth.seen_directions), **points)
