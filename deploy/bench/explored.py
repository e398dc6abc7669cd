"""One whole run in this process, and what it shows: scores against the truth, times and bytes."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from agent.config import AgentConfig
from agent.robot import Robot, Step
from agent.shell.mind import Mind
from deploy import inprocess
from deploy.bench.cases import Figures
from deploy.bench.layouts import path_of
from deploy.config import RunConfig
from deploy.launcher import launch
from deploy.metrics import Truth, score, truth_of
from protocol.geometry import Pose
from protocol.messages import Event, Heard, Observation, RobotSpec
from protocol.wireframe import Label
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
    events: list[tuple[float, str, Event]]
    """Simulated seconds, robot and event, in order."""

    def truth(self, robot: str = "r1") -> Truth:
        """What the robot could have mapped."""
        spec = self.episode.config.spec
        start = self.episode.starts[self.episode.robots.index(robot)]
        place = float(start[0]), float(start[1])
        return truth_of(self.episode.world, place, spec.radius_m, spec.lidar.range_max_m)

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

    def told(self, robot: str = "r1") -> Figures:
        """What a robot's events and its last map say.

        `silent`: frontier or occlusion ends that it neither resolved nor recorded as given up with a reason.
        """
        mind, explorer = self.robots[robot], self.robots[robot].explorer
        events = [event for _, who, event in self.events if who == robot]
        reasons = explorer.goals.reasons
        completes = [event.data for event in events if event.event == "complete"]
        return {
            "reason": completes[-1]["reason"] if completes and explorer.complete else "",
            "frontiers": int((mind.wireframe.labels == Label.FRONTIER).sum()),
            "unreachable": sum(map(bool, reasons)),
            "silent": reasons.count("") if explorer.complete else None,
            "stuck": sum(event.event == "stuck" for event in events),
            "goals": sum(event.event == "frontier" and event.data["what"] == "chosen" for event in events),
            "resumed": sum(event.event == "resumed" for event in events),
        }


class _Watched:
    """A robot whose steps are seen from outside."""

    def __init__(self, robot: Robot, watches: Sequence[Watch]) -> None:
        self._robot, self._watches = robot, watches

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
        step = self._robot.step(observation, heard)
        for watch in self._watches:
            watch(self._robot, observation, step)
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
    events: list[tuple[float, str, Event]] = []

    def listen(robot: Robot, observation: Observation, step: Step) -> None:
        t = observation.tick / robot.spec.lidar.rate_hz
        events.extend((t, robot.robot, event) for event in step.action.events)

    def make(name: str, spec: RobotSpec, settings: AgentConfig, seed: int) -> Mind:
        robots[name] = Robot(name, spec, settings, seed)
        return _Watched(robots[name], [listen, *([watch] if watch else [])])

    def keep(episode: Episode) -> None:
        if not episodes:
            episodes.append(episode)
        driven(episode)
        if enough is not None and episode.ended is None and enough(episode):
            episode.ended = "time"

    summary = inprocess.run(config, AgentConfig.model_validate(agent), out, keep, make)
    return Explored(episodes[0], robots, summary, driven, events)


def measure_run(
    world: str,
    seed: int,
    limit_s: float,
    starts: str = "file",
    spec: Mapping[str, Any] | None = None,
    agent: Mapping[str, Any] | None = None,
) -> Figures:
    """Figures of one robot's whole run: score, times, paths, contacts, and what it said of its frontiers and its end.

    starts: of the world's `file`, or `random` from the seed; spec and agent: settings of the robot and of its mind.
    """
    settings = {"world": world, "robots": 1, "seed": seed, "starts": starts, "spec": spec or {}, "max_time_s": limit_s}
    run = explore(settings, agent or {})
    return run.figures() | run.told()


@contextmanager
def launched(settings: Mapping[str, Any], make_mind: Callable[..., Any] | None = None) -> Iterator[tuple[Path, str]]:
    """Run directory of a run with processes, and how it ended; it is gone afterwards. Raises RuntimeError."""
    with TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        result = launch(RunConfig.model_validate(dict(settings)), out, command_line=[], make_mind=make_mind)
        if result.errors:
            raise RuntimeError("; ".join(result.errors))
        yield out, result.ended


def read_json(path: Path) -> Any:
    """A JSON file of a run directory."""
    return json.loads(path.read_text(encoding="utf-8"))
