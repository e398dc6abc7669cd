"""The scans of a finished run once more: poses are on record, and the noise of the lidar comes from the seed.

So a run pays nothing for baselines that it does not send.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deploy.bandwidth.books import NoRunError
from deploy.config import RunConfig
from protocol.arrays import Floats
from protocol.geometry import relative
from world.config import WorldConfig
from world.draws import generator
from world.lidar import Lidar
from world.worldfile import load


@dataclass(frozen=True)
class Seen:
    """What one robot saw, tick by tick, while it lived, and would have seen from where it stood at the end."""

    poses: Floats  # (t, 3) true poses in the robot's own frame: metres, radians
    ranges: NDArray[np.float32]  # (t, beams) metres, inf where nothing came back


def config_of(run: Path) -> RunConfig:
    """The configuration of a run directory. Raises NoRunError."""
    try:
        return RunConfig.model_validate(json.loads((run / "manifest.json").read_text(encoding="utf-8"))["config"])
    except (OSError, ValueError, LookupError, TypeError):
        raise NoRunError(f"{run} is no finished run: it has no manifest.json with its configuration") from None


def seen_again(run: Path, config: WorldConfig) -> dict[str, Seen]:
    """What each robot of a run directory saw. Raises NoRunError."""
    try:
        world = load(str(run / "world.yaml"))
        frames = json.loads((run / "truth.json").read_text(encoding="utf-8"))["frames"]
        tracks = {robot: _track(run / "trajectories" / f"{robot}.tum") for robot in frames}
        ends = _deaths(run / "events.jsonl")
    except (OSError, ValueError, LookupError) as error:
        raise NoRunError(f"{run} is no finished run: {error}") from None
    lidar = Lidar(world.segments, config.spec.lidar, one_sided=True)
    ticks = {robot: min(len(track), ends.get(robot, len(track))) for robot, track in tracks.items()}
    noise = {robot: generator(config.seed, "lidar", robot) for robot in tracks}
    scans = {robot: np.empty((count, config.spec.lidar.beams), np.float32) for robot, count in ticks.items()}
    radius = np.full((len(tracks), 1), config.spec.radius_m)
    for tick in range(max(ticks.values())):  # as world.episode looks
        live = [robot for robot in tracks if tick < ticks[robot]]
        places = np.array([track[min(tick, len(track) - 1), :2] for track in tracks.values()])
        true = lidar.cast(np.array([tracks[robot][tick] for robot in live]), np.hstack([places, radius]))
        for robot, ranges in zip(live, lidar.measured(true, [noise[robot] for robot in live]), strict=True):
            scans[robot][tick] = ranges
    found = {}
    for robot, count in ticks.items():
        own = [relative(frames[robot], pose) for pose in tracks[robot][:count].tolist()]
        found[robot] = Seen(np.array(own).reshape(-1, 3), scans[robot])
    return found


def _track(file: Path) -> Floats:
    """(t, 3) poses of a TUM file, world frame."""
    rows = np.loadtxt(file, ndmin=2)
    return np.column_stack([rows[:, 1:3], 2 * np.arctan2(rows[:, 6], rows[:, 7])])


def _deaths(file: Path) -> dict[str, int]:
    """The tick at which each dead robot died."""
    events = map(json.loads, file.read_text(encoding="utf-8").splitlines())
    return {event["robot"]: event["tick"] for event in events if event["event"] == "dead"}
