"""The run directory (docs/formats.md): everything that a run leaves behind, byte for byte the same for the same run.

Only `real_time_factor`, `step_ms_median`, `late_ticks` and `links_lost` of summary.json depend on the machine.
"""

import csv
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Floats, Ints
from protocol.files import LineFile, UnwritableError, write_all, write_whole
from protocol.wireframe import Label, Wireframe
from world.checkpoint import CheckpointError
from world.radio.gate import Passage
from world.worldfile import World, to_yaml

TEAM = "team"
"""The name of the union of all robots in metrics.csv."""
REPLACED = "another process took its place"
"""The reason of a `rejoined` after which a robot holds nothing more of others: its mind meets them anew."""
PLACE_DIGITS = 6
"""Decimals of places in maps: micrometres, as wireframes travel as float32."""


LEAST_BYTES = 20
"""Of each vertex of a map as JSON: its place and its label."""


class MetricsRow(NamedTuple):
    """A line of metrics.csv: one robot, or the team, at one simulated second."""

    t: float
    robot: str
    coverage: float
    path_m: float
    vertices: int | None
    """Of the robot's newest map; None without one."""
    bytes_sent: int
    bytes_received: int


class Recorder:
    """Writes one run directory."""

    def __init__(
        self,
        out: Path,
        world: World,
        robots: Sequence[str],
        starts: Floats,
        radius_m: float,
        range_m: float,
        kept: Mapping[str, int],
        scans: bool = False,
    ) -> None:
        """Makes the directory; raises OSError where that cannot be done. `starts` is (k, 3), world frame.

        kept: how many bytes of each file that grows stay, where a run goes on; CheckpointError where it has fewer.
        scans: whether scans are kept, too.
        """
        self._out, self._kept = out, kept
        for folder in ("maps", "snapshots", "trajectories", *(["scans"] if scans else [])):
            (out / folder).mkdir(parents=True, exist_ok=True)
        write_whole(out / "world.yaml", to_yaml(world.document))
        frames = {robot: start.tolist() for robot, start in zip(robots, starts, strict=True)}
        self._json("truth.json", {"frames": frames, "robot_radius": radius_m, "lidar_range": range_m})
        self._files: dict[str, LineFile] = {}
        self._events = self._open("events.jsonl")
        self._metrics, self._radio = (
            csv.writer(self._open(name), lineterminator="\n") for name in ("metrics.csv", "radio.csv")
        )
        if not kept:
            self._metrics.writerow(MetricsRow._fields)
            self._radio.writerow(Passage._fields)
        self._updates = self._open("updates.jsonl")
        self._snapshots = {robot: self._open(f"snapshots/{robot}.jsonl") for robot in robots}
        self._trajectories = [self._open(f"trajectories/{robot}.tum") for robot in robots]
        self._scans = [self._open(f"scans/{robot}.jsonl") for robot in robots] if scans else []

    # Of what a robot says, a line that has more than `most` bytes is left out. Each returns how many it has, or None.

    def event(
        self, t: float, tick: int, robot: str, event: str, data: Mapping[str, Any], most: float = math.inf
    ) -> int | None:
        """One line of events.jsonl.

        Keys of `data` cannot replace time, tick, robot and event.
        """
        head = {"t": seconds(t), "tick": tick, "robot": robot, "event": event}
        return _line(self._events, head | {key: value for key, value in data.items() if key not in head}, most)

    def trajectories(self, t: float, poses: Floats) -> None:
        """A line of each trajectories/ID.tum: time, position, quaternion of the true pose (k, 3) in the world."""
        for file, (x, y, theta) in zip(self._trajectories, poses.tolist(), strict=True):
            spin = f"{math.sin(theta / 2):.9f} {math.cos(theta / 2):.9f}"
            file.write(f"{t:.3f} {x:.9f} {y:.9f} 0 0 0 {spin}\n")

    def scans(self, t: float, tick: int, robots: Ints, odometry: Floats, ranges: NDArray[np.float32]) -> None:
        """A line of scans/ID.jsonl for each row of robots (r,): its odometry (r, 3) and ranges (r, beams)."""
        if not self._scans:
            return
        for row, pose, scan in zip(robots.tolist(), odometry.tolist(), ranges.tolist(), strict=True):
            told = [
                None if math.isnan(reading) else -1 if math.isinf(reading) else round(reading, 4) for reading in scan
            ]
            fields = {"t": seconds(t), "tick": tick, "odometry": pose, "ranges": told}
            _line(self._scans[row], fields, math.inf)

    def radio(self, passages: Iterable[Passage]) -> None:
        """Lines of radio.csv."""
        self._radio.writerows(passages)

    def metrics(self, rows: Iterable[MetricsRow]) -> None:
        """Lines of metrics.csv."""
        for row in rows:
            self._metrics.writerow(
                {**row._asdict(), "coverage": f"{row.coverage:.6f}", "path_m": f"{row.path_m:.4f}"}.values()
            )

    def snapshot(self, t: float, robot: str, wireframe: Wireframe, most: float = math.inf) -> int | None:
        """One line of snapshots/ID.jsonl."""
        if LEAST_BYTES * len(wireframe.points) > most:
            return None
        heard = np.flatnonzero(~wireframe.own).tolist()
        line = {"t": seconds(t), "map": map_fields(robot, wireframe), "heard": heard}
        return _line(self._snapshots[robot], line, most)

    def update(
        self, t: float, tick: int, robot: str, told: Sequence[str], wireframe: Wireframe, most: float
    ) -> int | None:
        """One line of updates.jsonl."""
        if LEAST_BYTES * len(wireframe.points) > most:
            return None
        head = {"t": seconds(t), "tick": tick, "robot": robot, "told": told}
        return _line(self._updates, {**head, "map": map_fields(robot, wireframe)}, most)

    def sizes(self) -> dict[str, int]:
        """Bytes of each file that grows. They are handed to the system: a killed process loses nothing of them."""
        for file in self._files.values():
            file.flush()
        return {name: file.size for name, file in self._files.items()}

    def check(self) -> None:
        """Raise UnwritableError where lines could not be written."""
        write_all(*(file.check for file in self._files.values()))

    def close(self, maps: Mapping[str, Wireframe], summary: Mapping[str, Any], bandwidth: Mapping[str, Any]) -> None:
        """Write the final maps, the summary and the radio's books, and close all files.

        Each is tried; UnwritableError names those that could not be written.
        """
        documents = {"summary.json": summary, "bandwidth.json": bandwidth}
        for robot, wireframe in maps.items():
            documents[f"maps/{robot}.json"] = map_fields(robot, wireframe)
            documents[f"maps/{robot}.own.json"] = map_fields(robot, own_part(wireframe))
        made = (partial(self._json, name, document) for name, document in documents.items())
        write_all(*made, *(file.close for file in self._files.values()))

    def _open(self, name: str) -> LineFile:
        file, size = self._out / name, self._kept.get(name, 0)
        if size and not (file.is_file() and 0 <= size <= file.stat().st_size):
            raise CheckpointError(f"{file} is missing, or has less than the {size} bytes that its run had written")
        self._files[name] = LineFile(file, size)
        return self._files[name]

    def _json(self, name: str, value: Mapping[str, Any]) -> None:
        file = self._out / name
        try:
            text = json.dumps(value, indent=1, allow_nan=False)
        except ValueError as error:
            raise UnwritableError((file, str(error))) from error
        write_whole(file, text + "\n")


def map_fields(robot: str, wireframe: Wireframe) -> dict[str, Any]:
    """A map as in maps/ID.json."""
    return {
        "robot": robot,
        "vertices": wireframe.points.round(PLACE_DIGITS).tolist(),
        "labels": [Label(label).word for label in wireframe.labels.tolist()],
        "edges": wireframe.edges.tolist(),
        "edge_likelihood": wireframe.likelihood.astype(np.float64).round(4).tolist(),
    }


def own_part(wireframe: Wireframe) -> Wireframe:
    """The map without walls that only others saw, and without the vertices of only such walls."""
    own = wireframe.own
    kept = np.ones(len(wireframe.points), np.bool_)
    kept[wireframe.edges[~own]] = False
    kept[wireframe.edges[own]] = True
    edges = (np.cumsum(kept) - 1)[wireframe.edges[own]].astype(np.int32)
    return Wireframe(wireframe.points[kept], wireframe.labels[kept], edges, wireframe.likelihood[own], own[own])


def seconds(t: float) -> float:
    """A simulated time as it is printed."""
    return round(t, 3)


def _line(file: LineFile, fields: Mapping[str, Any], most: float) -> int | None:
    line = json.dumps(fields, separators=(", ", ": "), allow_nan=False) + "\n"
    if len(line) > most:
        return None
    file.write(line)
    return len(line)
