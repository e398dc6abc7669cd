"""One whole run in this process, and what it shows: scores against the truth, times and bytes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from agent.config import AgentConfig
from agent.robot import Robot, Step
from deploy import inprocess
from deploy.bench.cases import Figures
from deploy.bench.layouts import path_of
from deploy.metrics import Truth, score, truth_of
from protocol.geometry import Pose
from protocol.messages import Heard, Observation, RobotSpec
from world.config import WorldConfig
from world.episode import Episode

Watch = Callable[[Robot, Observation, Step], None]
"""Called with every step of every robot."""


class Driven:
    """Metres driven by each robot until its beams had hit 90 and 99 % of the visible wall; follows an episode."""

    SHARES = (0.90, 0.99)

    def __init__(self) -> None:
        self.until: dict[str, dict[float, float]] = {}

    def __call__(self, episode: Episode) -> None:
        """Look at the episode after a tick."""
        paths = None
        for robot, coverage in episode.coverage.items():
            reached = self.until.setdefault(robot, {})
            for share in self.SHARES:
                if share not in reached and coverage >= share - 1e-9:
                    paths = paths or episode.paths
                    reached[share] = round(paths[robot], 4)

    def figures(self, robot: str = "r1") -> Figures:
        """path_90_m and path_99_m; None where never reached."""
        reached = self.until.get(robot, {})
        return {f"path_{round(100 * share)}_m": reached.get(share) for share in self.SHARES}


class Explored(NamedTuple):
    """A run that has ended."""

    episode: Episode
    robots: dict[str, Robot]
    summary: dict[str, Any]
    driven: Driven

    def truth(self, robot: str = "r1") -> Truth:
        """What the robot could have mapped."""
        spec = self.episode.config.spec
        start = self.episode.starts[self.episode.robots.index(robot)]
        place = float(start[0]), float(start[1])
        return truth_of(self.episode.world, place, spec.radius_m, spec.lidar.range_max_m, self.episode.config.coverage)

    def frame(self, robot: str = "r1") -> Pose:
        """Pose of the robot's own frame in the world."""
        x, y, theta = self.episode.starts[self.episode.robots.index(robot)].tolist()
        return x, y, theta

    def figures(self, robot: str = "r1") -> Figures:
        """Score of a robot's map, its fields of summary.json, and how the run ended."""
        mind = self.robots[robot]
        scored = score(mind.wireframe, self.frame(robot), self.truth(robot))
        return {
            **scored._asdict(),
            **self.summary["robots"][robot],
            **self.driven.figures(robot),
            "ended_at": self.episode.t,
            "vertices": len(mind.wireframe.points),
        }


class _Watched:
    """A robot whose steps are seen from outside."""

    def __init__(self, robot: Robot, watch: Watch) -> None:
        self._robot, self._watch = robot, watch

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
        step = self._robot.step(observation, heard)
        self._watch(self._robot, observation, step)
        return step


def explore(
    world: Mapping[str, Any],
    agent: Mapping[str, Any],
    watch: Watch | None = None,
    out: Path | None = None,
    enough: Callable[[Episode], bool] | None = None,
) -> Explored:
    """Run to the end. world: settings of WorldConfig, its world a layout's name; agent: of AgentConfig.

    out: the run directory, None to write nothing. enough: asked after every tick; true ends the run there, because
    what it is for is known.
    """
    config = WorldConfig.model_validate({**world, "world": path_of(world["world"])})
    robots: dict[str, Robot] = {}
    episodes: list[Episode] = []
    driven = Driven()

    def make(name: str, spec: RobotSpec, settings: AgentConfig, seed: int) -> inprocess.Mind:
        robots[name] = Robot(name, spec, settings, seed)
        return robots[name] if watch is None else _Watched(robots[name], watch)

    def keep(episode: Episode) -> None:
        if not episodes:
            episodes.append(episode)
        driven(episode)
        if enough is not None and episode.ended is None and enough(episode):
            episode.ended = "time"

    summary = inprocess.run(config, AgentConfig.model_validate(agent), out, keep, make)
    return Explored(episodes[0], robots, summary, driven)
