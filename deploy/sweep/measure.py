"""One run of a sweep, and all its figures."""

import json
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from agent.robot import Step
from agent.shell.mind import minds_of
from deploy import inprocess
from deploy.bench.errors import false_of
from deploy.config import RunConfig
from deploy.metrics import score, truth_of
from deploy.sweep.plan import Job, minds_hash
from deploy.sweep.work import OtherSourcesError, Row, WorkerTask
from protocol.errors import InputError
from protocol.geometry import Pose, pose_of
from protocol.temporary import temporary_folder
from protocol.wireframe import Wireframe, decode_wireframe, encode_wireframe
from world.episode import Episode
from world.worldfile import WorldFileError, to_yaml

ALIGNMENT = ("attempt", "proposed", "accepted", "rejected", "unmerged")
EMPTY = encode_wireframe(Wireframe())


def task_of(job: Job) -> WorkerTask:
    """The run of a job, as a task."""
    settings, config = (json.dumps(part, sort_keys=True) for part in (job.settings, job.config))
    return WorkerTask(job.key, {"settings": settings, "config": config, **job.hashes}, measure, (job,))


def measure(job: Job) -> Row:
    """Run a job in this process; its figures. Raises OtherSourcesError where it has other minds than the job's."""
    minds = job.config["mind"]
    try:
        found = minds_hash(minds, loaded=True)
    except InputError as error:
        raise OtherSourcesError(f"{socket.gethostname()} lacks what the sweep runs: {error}") from None
    if found != job.hashes["mind.hash"]:
        raise OtherSourcesError(
            f"{socket.gethostname()} has another version of {', '.join(sorted(set(minds.values())))}, or has loaded it "
            "before it was changed: bring the same file there, and start workers and sweep again"
        )
    with temporary_folder() as folder:
        kept = folder / "world.yaml"
        try:
            return _figures(job, kept)
        except WorldFileError as error:  # it names the file that is kept here
            raise WorldFileError(str(error).replace(str(kept), job.settings["world"])) from None


def _figures(job: Job, kept: Path) -> Row:
    config, seen = RunConfig.model_validate(job.config), _Seen()
    if job.world is not None:
        kept.write_text(to_yaml(job.world), encoding="utf-8")
        config = config.model_copy(update={"world": str(kept)})
    summary = inprocess.run(config, config.agent, None, seen.look, minds_of(config.mind), seen.watch)
    episode, robots = seen.episode, summary["robots"]
    frames = {robot: pose_of(start) for robot, start in zip(episode.robots, episode.starts, strict=True)}
    machine = {name: summary.pop(name) for name in ("real_time_factor", "late_ticks", "links_lost")}
    for robot, figures in robots.items():
        machine[f"step_ms_median.{robot}"] = figures.pop("step_ms_median")
        truth = truth_of(episode.world, frames[robot][:2], config.spec.radius_m, config.spec.lidar.range_max_m)
        figures |= score(decode_wireframe(seen.maps.get(robot, EMPTY)), frames[robot], truth)._asdict()
    numbers = [name for name, value in robots["r1"].items() if not isinstance(value, str)]
    tree = {
        **summary,
        "mean": {name: _mean([figures[name] for figures in robots.values()]) for name in numbers},
        "worst": {
            name: min(figures[name] for figures in robots.values()) for name in ("wall_recall", "wall_precision")
        },
        "alignments": seen.alignments(frames),
        "ended": episode.ended,
        "ended_s": episode.t,
        "machine": machine,
    }
    return _flat(tree)


class _Seen:
    """A run's episode, and what robots said of their maps in it."""

    episode: Episode

    def __init__(self) -> None:
        self.maps: dict[str, bytes] = {}
        """The last one of each robot."""
        self.counts = dict.fromkeys(ALIGNMENT, 0)
        self.accepted: list[tuple[str, dict[str, Any]]] = []

    def look(self, episode: Episode) -> None:
        """Take the episode after a tick."""
        self.episode = episode

    def watch(self, robot: str, step: Step) -> None:
        """Take a robot's step."""
        if step.map is not None:
            self.maps[robot] = step.map.wireframe
        for event in step.action.events:
            if event.event in ALIGNMENT:
                self.counts[event.event] += 1
            if event.event == "accepted":
                self.accepted.append((robot, event.data))

    def alignments(self, frames: Mapping[str, Pose]) -> Row:
        """How many there were of each kind, and how many of the accepted ones are false."""
        return {**self.counts, "false": false_of(self.accepted, frames)}


def _mean(values: list[Any]) -> float | None:
    """None where a robot has no such figure: the mean of the others would be better than the team."""
    return None if None in values else float(np.mean(values))


def _flat(tree: dict[str, Any], prefix: str = "") -> Row:
    """Leaves by dotted key; numbers as float, so that a column has one type in all rows."""
    row: Row = {}
    for name, value in tree.items():
        if isinstance(value, dict):
            row |= _flat(value, f"{prefix}{name}.")
        else:
            row[prefix + name] = value if isinstance(value, str) or value is None else float(value)
    return row
