"""The scans of a finished run once more: poses are on record, and the noise of the lidar comes from the seed.

So a run pays nothing for baselines that it does not send. Where a lidar turns, its places between two ticks are taken
from the straight line: 4 mm off at most for a TurtleBot3 that turns or starts, which no size of a message depends on.
Over half a turn from tick to tick, for which its lidar must be slower than 0.9 Hz, is taken for a turn the other way.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deploy import manifest
from deploy.bandwidth.books import NoRunError, check_has, check_simulated
from deploy.config import RunConfig
from deploy.report.rundir import BROKEN, read_trajectory, read_truth
from protocol.arrays import Floats
from protocol.configuration import ConfigError, validated
from protocol.document import read_lines, read_text
from protocol.errors import InputError
from protocol.geometry import relative
from protocol.messages import LidarSpec
from protocol.settings import RAN
from world.config import WorldConfig
from world.draws import generator
from world.lidar.lidar import Lidar
from world.people import People
from world.worldfile import load


@dataclass(frozen=True)
class Seen:
    """What one robot saw, tick by tick, while it lived, and would have seen from where it stood at the end."""

    lidar: LidarSpec
    poses: Floats  # (t, 3) true poses in the robot's own frame: metres, radians
    ranges: NDArray[np.float32]  # (t, beams) metres, as in an observation
    begin: int  # tick of the first scan that it had joined to read; len(ranges) where it never joined

    def rays(self, ticks: slice) -> Floats:
        """(n, beams, 3) how the beams of these ticks began and pointed, in the robot's own frame."""
        tick = np.arange(len(self.poses))[ticks]
        return Lidar(np.zeros((0, 4)), self.lidar).rays(self.poses[np.stack([np.maximum(tick - 1, 0), tick])])


def config_of(run: Path) -> RunConfig:
    """The configuration of a run directory. Raises NoRunError."""
    check_simulated(run)
    try:
        settings = manifest.read(run)["config"]
    except (OSError, InputError, KeyError):
        settings = None
    if not isinstance(settings, dict):
        raise NoRunError(f"{run} is no run directory: it has no manifest.json with its configuration")
    try:
        return validated(RunConfig, settings, RAN)
    except ConfigError as error:
        raise NoRunError(f"{run}: its settings are of another version: {error}") from None


def seen_again(run: Path, config: WorldConfig) -> dict[str, Seen]:
    """What each robot of a run directory saw. Raises NoRunError."""
    check_has(run, "world.yaml", "truth.json", "events.jsonl", "summary.json")
    try:
        world = load(str(run / "world.yaml"))
        frames = {robot: frame.tolist() for robot, frame in read_truth(run / "truth.json")[0].items()}
        if not frames or not frames.keys() <= set(config.robot_ids):
            raise ValueError("truth.json names other robots than manifest.json")
        tracks = {robot: read_track(run / "trajectories" / f"{robot}.tum") for robot in frames}
        begins, ends = _lives(run / "events.jsonl")
        figures = json.loads(read_text(run / "summary.json"))["robots"]
        came_of = {robot: [figures[robot][key] for key in ("coverage", "bytes_sent", "path_m")] for robot in frames}
        never = {robot for robot, values in came_of.items() if not any(values)}  # joined, as no event tells
    except BROKEN as error:
        raise NoRunError(f"{run} is no finished run: {error}") from None
    lidar = Lidar(world.segments, config.spec.lidar, one_sided=True)
    ticks = {robot: min(len(track), ends.get(robot, len(track))) for robot, track in tracks.items()}
    noise = {robot: generator(config.seed, "lidar", robot) for robot in tracks}
    scans = {robot: np.empty((count, config.spec.lidar.beams), np.float32) for robot, count in ticks.items()}
    starts, rng = np.array([tracks[robot][0] for robot in tracks]), generator(config.seed, "people")
    period_s = 1 / config.spec.lidar.rate_hz
    people = People(config.people, world, starts, config.spec.radius_m, period_s, rng)
    for tick in range(max(ticks.values())):  # as world.episode looks
        live = [robot for robot in tracks if tick < ticks[robot]]
        ways = np.stack([track[np.clip((tick - 1, tick), 0, len(track) - 1)] for track in tracks.values()], 1)
        bodies = ways.copy()
        bodies[..., 2] = config.spec.radius_m
        if tick:
            people.advance(ways[0, :, :2])
        mine = ways[:, [row for row, robot in enumerate(tracks) if robot in live]]
        true, met = lidar.trace(mine, np.concatenate([bodies, people.bodies(len(bodies))], 1))
        measured = lidar.measured(true, [noise[robot] for robot in live], met, lidar.rays(mine))
        for robot, ranges in zip(live, measured, strict=True):
            scans[robot][tick] = ranges
    found = {}
    for robot, count in ticks.items():
        begin = count if robot in never else min(begins.get(robot, 0), count)
        own = [relative(frames[robot], pose) for pose in tracks[robot][:count].tolist()]
        poses = np.array(own).reshape(-1, 3)
        poses[:, 2] = np.unwrap(poses[:, 2])
        found[robot] = Seen(config.spec.lidar, poses, scans[robot], begin)
    return found


def read_track(file: Path) -> Floats:
    """(t, 3) poses of a TUM file, world frame. Raises one of BROKEN."""
    if not file.exists():
        raise ValueError(f"it has no trajectories/{file.name}")
    poses = read_trajectory(file)
    if poses is None:
        raise ValueError(f"{file.name} holds no pose")
    return np.column_stack([poses[:, 1:3], np.unwrap(poses[:, 3])])


def _lives(file: Path) -> tuple[dict[str, int], dict[str, int]]:
    """The tick at which each robot that was late joined, and at which each dead one died. Raises one of BROKEN."""
    lives: dict[str, dict[str, int]] = {"joined": {}, "dead": {}}
    for event in map(json.loads, read_lines(file)):
        if event["event"] in lives:
            lives[event["event"]].setdefault(str(event["robot"]), event["tick"])
    if not all(type(tick) is int and tick >= 0 for ticks in lives.values() for tick in ticks.values()):
        raise ValueError(f"{file.name}: a robot joined or died at no tick")
    return lives["joined"], lives["dead"]
