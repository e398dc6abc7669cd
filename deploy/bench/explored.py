"""One whole run in this process, and what it shows: scores against the truth, times and bytes."""

import json
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agent.config import AgentConfig
from agent.exploration.explorer import Explorer
from agent.geometry.transform import fit_on_points
from agent.robot import Robot, Step
from agent.shell.mind import MakeMind, Mind
from deploy import inprocess
from deploy.bench.cases import Figures
from deploy.bench.layouts import path_of
from deploy.config import RunConfig
from deploy.launch.launcher import launch
from deploy.metrics import Truth, score, truth_of
from deploy.sensing import of_benchmark
from protocol.arrays import Floats
from protocol.geometry import Pose, apply, seen_from
from protocol.messages import Action, Event, Heard, Observation, PoseReport, RobotSpec, ScanReport
from protocol.temporary import temporary_folder
from protocol.wireframe import Wireframe, encode_wireframe
from world.config import WorldConfig
from world.episode import Episode

Fields = Mapping[str, Any]  # fields of a configuration, as in a file
Watch = Callable[[Robot, Observation, Step], None]  # called with every step of every robot


class Stopwatch:
    """Seconds spent in timed calls, by name."""

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)

    def timed(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """The call, whose time counts under a name."""

        def run(*arguments: Any, **named: Any) -> Any:
            begin = time.perf_counter()
            try:
                return call(*arguments, **named)
            finally:
                self.seconds[name] += time.perf_counter() - begin

        return run


class Driven:
    """Metres driven by each robot until its beams had hit 90 and 99 % of the visible wall; follows an episode."""

    def __init__(self) -> None:
        self.until: defaultdict[str, Figures] = defaultdict(lambda: {"path_90_m": None, "path_99_m": None})

    def __call__(self, episode: Episode) -> None:
        """Look at the episode after a tick."""
        for robot, coverage in episode.coverage.items():
            for key, share in (("path_90_m", 0.90), ("path_99_m", 0.99)):
                if self.until[robot][key] is None and coverage >= share - 1e-9:
                    self.until[robot][key] = round(episode.paths[robot], 4)


class Tracks:
    """Poses at every tick: where robots were, in the world; where they believed to be and what their odometry said."""

    def __init__(self) -> None:
        self.true: list[Floats] = []  # (k, 3) of all robots
        self.believed: defaultdict[str, list[Pose]] = defaultdict(list)
        self.odometry: defaultdict[str, list[Pose]] = defaultdict(list)

    def errors(self, row: int, robot: str, frame: Pose) -> Figures:
        """Of a robot with this row and frame: rms and greatest distance from its true path, metres.

        After the best rigid fit, as paths of SLAM are judged; `frame`: without it, in the robot's own frame.
        """
        believed, odometry = (np.array(poses)[:, :2] for poses in (self.believed[robot], self.odometry[robot]))
        true = seen_from(frame, np.array([poses[row, :2] for poses in self.true[: len(believed)]]))
        paths = {
            "path": apply(fit_on_points(believed, true, len(true)), believed),
            "frame": believed,
            "odometry": odometry,
        }
        off = {name: np.hypot(*(path - true).T) for name, path in paths.items()}
        found = {f"{name}_rms_m": round(float(np.sqrt((far**2).mean())), 5) for name, far in off.items()}
        return found | {"path_max_m": round(float(off["path"].max()), 5)}


class Explored(NamedTuple):
    """A run that has ended."""

    episode: Episode
    robots: dict[str, Any]  # their minds
    summary: dict[str, Any]
    driven: Driven
    events: list[tuple[float, str, Event]]  # simulated seconds, robot and event, in order
    tracks: Tracks

    def path_errors(self, robot: str = "r1") -> Figures:
        """How far the robot was from where it believed to be (`Tracks.errors`)."""
        return self.tracks.errors(self.episode.robots.index(robot), robot, self.frame(robot))

    def truth(self, robot: str = "r1") -> Truth:
        """What the robot could have mapped."""
        spec = self.episode.config.spec
        return truth_of(self.episode.world, self.frame(robot)[:2], spec.radius_m, spec.lidar.range_max_m)

    def frame(self, robot: str = "r1") -> Pose:
        """Pose of the robot's own frame in the world."""
        x, y, theta = self.episode.starts[self.episode.robots.index(robot)].tolist()
        return x, y, theta

    def figures(self, robot: str = "r1") -> Figures:
        """Score of a robot's map, its fields of summary.json, and how the run ended."""
        wireframe: Wireframe = self.robots[robot].wireframe
        scored = score(wireframe, self.frame(robot), self.truth(robot))
        found = scored._asdict() | self.summary["robots"][robot] | self.driven.until[robot]
        return {**found, "ended_at": self.episode.t, "vertices": len(wireframe.points)}

    def told(self, robot: str = "r1") -> Figures:
        """What a robot's events and open goals say; `silent`: ends neither resolved nor given up with a reason."""
        explorer: Explorer = self.robots[robot].explorer
        reasons = explorer.goals.reasons
        events = [event for _, who, event in self.events if who == robot]
        completes = [event.data for event in events if event.event == "complete"]
        return {
            "reason": completes[-1]["reason"] if completes and explorer.complete else "",
            "unreachable": sum(map(bool, reasons)),
            "silent": reasons.count("") if explorer.complete else None,
            "stuck": sum(event.event == "stuck" for event in events),
        }


Enough = Callable[[Explored], bool]
"""Asked after every tick of a run that has no summary yet; true ends it, because what it is for is known."""


def explore(
    world: Fields,
    agent: Fields,
    watch: Watch | None = None,
    out: Path | None = None,
    enough: Enough | None = None,
    make_mind: MakeMind = Robot,
) -> Explored:
    """Run to the end. world: settings of WorldConfig, its world a layout's name; agent: of AgentConfig.

    out: the run directory, None to write nothing.
    """
    config = WorldConfig.model_validate({**of_benchmark(world), "world": path_of(world["world"])})
    runs: list[Explored] = []
    robots: dict[str, Any] = {}
    driven = Driven()
    events: list[tuple[float, str, Event]] = []
    tracks = Tracks()

    class Watched(NamedTuple):
        name: str
        mind: Mind

        def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
            step = self.mind.step(observation, heard)
            t = observation.tick / config.spec.lidar.rate_hz
            events.extend((t, self.name, event) for event in step.action.events)
            tracks.believed[self.name].append(step.pose.pose)
            tracks.odometry[self.name].append(observation.odometry)
            if watch is not None:
                watch(robots[self.name], observation, step)
            return step

    def make(name: str, spec: RobotSpec, settings: AgentConfig, seed: int) -> Mind:
        robots[name] = make_mind(name, spec, settings, seed)
        return Watched(name, robots[name])

    def keep(episode: Episode) -> None:
        driven(episode)
        tracks.true += [episode.poses.copy()] if tracks.true else [episode.starts, episode.poses.copy()]
        runs[:] = [Explored(episode, robots, {}, driven, events, tracks)]
        if enough is not None and episode.ended is None and enough(runs[0]):
            episode.ended = "time"

    summary = inprocess.run(config, AgentConfig.model_validate(agent), out, keep, make)
    return runs[0]._replace(summary=summary)


def measure_run(
    world: str, seed: int, limit_s: float, starts: str = "file", spec: Fields | None = None, agent: Fields | None = None
) -> Figures:
    """Figures of one robot's whole run: score, times, paths, contacts, and what it said of its frontiers and its end.

    starts: of the world's `file`, or `random` from the seed; spec and agent: settings of the robot and of its mind.
    """
    settings = {"world": world, "robots": 1, "seed": seed, "starts": starts, "spec": spec or {}, "max_time_s": limit_s}
    run = explore(settings, agent or {})
    return run.figures() | run.told()


def mute_step(action: Action, pose: Pose) -> Step:
    """A step of a mind without a map that tells nobody anything."""
    scan = ScanReport(tick=action.tick, wireframe=encode_wireframe(Wireframe()))
    return Step(action, [], None, lambda: (scan, PoseReport(tick=action.tick, pose=pose)))


@contextmanager
def launched(settings: Fields, make_mind: Callable[..., Any] | None = None) -> Iterator[tuple[Path, str]]:
    """Run directory of a run with processes, and how it ended; it is gone afterwards. Raises RuntimeError."""
    with temporary_folder() as folder:
        out = folder / "run"
        result = launch(RunConfig.model_validate(of_benchmark(settings)), out, make_mind=make_mind)
        if result.errors:
            raise RuntimeError("; ".join(result.errors))
        yield out, result.ended


def read_json(path: Path) -> Any:
    """A JSON file of a run directory."""
    return json.loads(path.read_text(encoding="utf-8"))
