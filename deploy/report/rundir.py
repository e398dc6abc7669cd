"""A run directory as arrays. Files may be missing or broken, because a killed run has a report, too."""

from __future__ import annotations

import csv
import json
import math
import reprlib
from collections import defaultdict
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from protocol.arrays import Floats
from protocol.document import MAX_RESULT_BYTES, read_lines, read_text
from protocol.errors import InputError
from protocol.geometry import apply
from protocol.messages import LidarSpec
from protocol.text import all_printable, printable
from protocol.walls import directions
from protocol.wireframe import LABELS
from world.recorder import TEAM
from world.worldfile import World, load

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BROKEN = (OSError, ValueError, LookupError, TypeError, ArithmeticError, RecursionError, csv.Error)
"""What parsing a file of any content may raise."""

PARTS = (
    "manifest.json", "summary.json", "bandwidth.json", "world.yaml", "truth.json", "maps", "snapshots", "trajectories",
    "metrics.csv", "events.jsonl",
)  # fmt: skip
"""What is read of a run directory."""
OF_LOGS = "is a directory of `wireswarm map`: recorded logs have no world, radio or settings of a run"
"""What to say where it needs these."""

MAX_TIME_S = 1e9  # of a simulated time in a file
MAX_M = 1e6  # of a coordinate (or a second of a path) in a file: neither pictures nor pages can show more

T = TypeVar("T")


class NoDirectoryError(InputError, NotADirectoryError):
    """There is no such run directory."""


@dataclass(frozen=True)
class Map:
    """A robot's map in its own frame, metres."""

    vertices: Floats  # (n, 2)
    labels: NDArray[np.uint8]  # (n,) of Label
    edges: NDArray[np.int64]  # (m, 2) vertex indices, free space on the left of the way from the first to the second
    heard: frozenset[int] = frozenset()  # rows of `edges` that only others saw

    def moved(self, frame: Floats | None) -> Map:
        """The map in the frame in which the pose `frame` is given; unchanged where that is None."""
        return self if frame is None else replace(self, vertices=apply(frame, self.vertices))

    def inset(self, distance: float) -> Map:
        """The map with all walls moved by `distance` metres to their free side (the left), corners kept closed.

        So maps of several robots can be drawn side by side. A vertex moves along the mitre of its walls, but at most
        by twice the distance.
        """
        along = directions(self.vertices[self.edges].reshape(-1, 4))
        left = np.column_stack((-along[:, 1], along[:, 0]))
        total = np.zeros_like(self.vertices)
        np.add.at(total, self.edges, left[:, None])
        walls = np.bincount(self.edges.reshape(-1), minlength=len(self.vertices))[:, None]
        square = np.maximum((total**2).sum(axis=1, keepdims=True), 1e-9)
        shift = total * np.minimum(walls / square, 2 / np.sqrt(square))
        return replace(self, vertices=self.vertices + distance * shift)


@dataclass(frozen=True)
class Series:
    """One robot's rows of metrics.csv, or the team's: columns by name, one value a simulated second."""

    t: Floats
    columns: dict[str, Floats]

    def at(self, column: str, t: float) -> float | None:
        """The last value at or before t; None where there is none."""
        values = self.columns.get(column)
        k = int(np.searchsorted(self.t, t, "right")) - 1
        return None if values is None or k < 0 or not math.isfinite(values[k]) else float(values[k])


@dataclass(repr=False)
class Run:
    """What a run directory holds. A field is empty where its file is missing or cannot be read, and `notes` say so.

    docs/formats.md describes the fields of manifest, summary, bandwidth, metrics and events.
    """

    path: Path
    notes: list[str] = field(default_factory=list)
    manifest: dict[str, Any] = field(default_factory=dict)
    summary: dict[str, Any] = field(default_factory=dict)
    bandwidth: dict[str, Any] = field(default_factory=dict)
    world: World | None = None
    frames: dict[str, Floats] = field(default_factory=dict)
    """By robot, (3,) x, y, theta: the pose of its own frame in the world."""
    radius: float = 0.105
    maps: dict[str, Map] = field(default_factory=dict)  # robot to its final map, in its own frame
    snapshots: dict[str, list[tuple[float, Map]]] = field(default_factory=dict)
    """Robot to its maps as the run went on, each with its time."""
    poses: dict[str, Floats] = field(default_factory=dict)  # by robot, (n, 4) t, x, y, theta in the world frame
    metrics: dict[str, Series] = field(default_factory=dict)
    events: list[dict[str, Any]] = field(default_factory=list)

    def __repr__(self) -> str:
        until = f"up to scan {self.duration:g}" if self.of_logs else f"{self.duration:g} s"
        return f"Run({str(self.path)!r}: {len(self.robots)} robots, {until})"

    @property
    def robots(self) -> list[str]:
        """All robots that any file names, r2 before r10."""
        told = mapping(self.summary.get("robots"))
        names = {*self.frames, *self.maps, *self.snapshots, *self.poses, *self.metrics, *told} - {TEAM}
        return sorted(names, key=lambda name: (len(name), name))

    @property
    def paths(self) -> dict[str, Floats]:
        """By robot, (n, 3) t, x, y in the world frame."""
        return {robot: poses[:, :3] for robot, poses in self.poses.items()}

    @property
    def lidar(self) -> LidarSpec:
        """The robots' lidar; the default where the run does not say."""
        try:
            return LidarSpec.model_validate(self.manifest["config"]["spec"]["lidar"])
        except (ValidationError, LookupError, TypeError):
            return LidarSpec()

    @property
    def of_logs(self) -> bool:
        """Whether recorded logs were mapped: there is no world then, and a map alone is drawn in its own frame."""
        return "logs" in self.manifest

    @property
    def placed(self) -> list[str]:
        """The robots whose frame in the world is known."""
        return [robot for robot in self.robots if robot in self.frames]

    @property
    def has_plan(self) -> bool:
        """Whether all can be drawn in one frame; of several logs nobody knows how their frames lie to each other."""
        return bool(self.frames) or not self.of_logs

    @property
    def duration(self) -> float:
        """Simulated seconds, of logs the number of the last scan: the last time that any file gives."""
        times = [series.t[-1] for series in self.metrics.values()]
        times += [poses[-1, 0] for poses in self.poses.values()]
        times += [frames[-1][0] for frames in self.snapshots.values()]
        return float(max(times, default=0.0))

    def note(self, text: str) -> None:
        """Tell of a file that is missing or broken; its name may be anything."""
        self.notes.append(printable(text))

    def map(self, robot: str, frame: Literal["own", "world"] = "own") -> Map:
        """The final map of a robot in its own frame or in the world's.

        Raises KeyError where the run lacks it, InputError for another frame.
        """
        if frame not in ("own", "world"):
            raise InputError(f"frame: 'own' or 'world', not {reprlib.repr(frame)}")
        return self.maps[robot].moved(None if frame == "own" else self.frames[robot])

    def plot(self, robot: str | None = None, axes: Axes | None = None) -> Axes:
        """Draw one robot's map, or those of all, over the true world; without axes, on those of a new figure."""
        from matplotlib import pyplot

        from deploy.report.picture import draw_overview, draw_scale, draw_single

        drawn: Axes = axes or pyplot.subplots(figsize=(8, 8), layout="constrained")[1]
        if robot is None:
            draw_overview(drawn, self)
        else:
            draw_single(drawn, self, robot)
            draw_scale(drawn)
        return drawn


def parse_map(text: str) -> Map:
    """The map that a file of a run directory holds. Raises what parsing any text may: see BROKEN."""
    return as_map(_as_object(text))


def mapping(value: Any) -> dict[str, Any]:
    """A value of a file that ought to be a mapping; an empty one where it is none."""
    return value if isinstance(value, dict) else {}


def read_run(directory: str | Path) -> Run:
    """What a run directory holds; `notes` of the result name the files that are missing or broken.

    Raises NoDirectoryError where there is no such directory, or nothing of a run in it.
    """
    path = Path(directory)
    if not path.is_dir():
        raise NoDirectoryError(f"{path} is no run directory")
    if not any((path / name).exists() for name in PARTS):
        raise NoDirectoryError(f"{path} is no run directory: it has no manifest.json, and nothing else of a run")
    run = Run(path)

    def part(name: str, read: Callable[[Path], T], otherwise: T) -> T:
        try:
            if (file := path / name).exists():
                return read(file)
            run.note(f"{name} is missing")
        except BROKEN as error:
            run.note(f"{name} cannot be read: {(str(error) or repr(error)).splitlines()[0]}")
        return otherwise

    def each(folder: str, suffix: str, read: Callable[[Path], T | None]) -> dict[str, T]:
        files = [file for file in sorted((path / folder).glob(f"*{suffix}")) if file.name.count(".") == 1]
        if not files:
            run.note(f"{folder}/ is missing or empty")
        made = {printable(file.name.removesuffix(suffix)): part(f"{folder}/{file.name}", read, None) for file in files}
        return {robot: item for robot, item in made.items() if item is not None}

    run.manifest = part("manifest.json", _object, {})
    run.summary = part("summary.json", _object, {})
    if run.of_logs:
        run.maps = each("maps", ".json", lambda file: parse_map(_text(file)))
        run.poses = each("estimate", ".tum", read_trajectory)
        run.frames = {robot: np.zeros(3) for robot in run.maps if len(run.maps) == 1}
        return run
    run.bandwidth = part("bandwidth.json", _object, {})
    run.world = part("world.yaml", load, None)
    run.frames, run.radius = part("truth.json", read_truth, (run.frames, run.radius))
    run.maps = each("maps", ".json", lambda file: parse_map(_text(file)))
    for robot, drawn in run.maps.items():
        if (path / (name := f"maps/{robot}.own.json")).exists():
            run.maps[robot] = part(name, partial(_compared, drawn), drawn)
    run.snapshots = each("snapshots", ".jsonl", lambda file: _snapshots(_lines(file, run)))
    run.poses = each("trajectories", ".tum", read_trajectory)
    run.metrics = part("metrics.csv", read_metrics, {})
    run.events = part("events.jsonl", lambda file: _events(_lines(file, run), run), [])
    return run


def read_drawable(path: Path) -> tuple[Run, World]:
    """A run directory with the world and the paths of robots, without which there is nothing to draw.

    Raises InputError.
    """
    run = read_run(path)
    if run.of_logs:
        raise InputError(f"{path} {OF_LOGS}")
    if run.world is None or not run.poses:
        why = "; ".join(run.notes) or "no file in trajectories/ holds a pose"
        raise InputError(f"{path} has no world or no paths to be drawn: {why}"[:400])
    return run, run.world


def _text(file: Path) -> str:
    return read_text(file, MAX_RESULT_BYTES)


def _object(file: Path) -> dict[str, Any]:
    return _as_object(_text(file))


def _as_object(text: str) -> dict[str, Any]:
    value = all_printable(json.loads(text))
    if not isinstance(value, dict):
        raise ValueError("it holds no JSON object")
    return value


def _lines(file: Path, run: Run) -> list[dict[str, Any]]:
    """The objects of a JSON lines file, whose last line may be cut where its writer was killed."""
    objects, count = [], 0
    for line in read_lines(file):
        count += 1
        with suppress(ValueError, RecursionError):
            objects.append(_as_object(line))
    if bad := count - len(objects):
        run.note(f"{file.relative_to(run.path)}: {bad} of {count} lines are no JSON objects")
    return objects


def read_truth(file: Path) -> tuple[dict[str, Floats], float]:
    """By robot (3,) the pose of its own frame in the world, and the radius of all. Raises one of BROKEN."""
    truth = _object(file)
    frames = {robot: _array(pose, (3,)) for robot, pose in dict(truth["frames"]).items()}
    radius = float(_array(truth.get("robot_radius", 0.105), ()))
    if radius <= 0:
        raise ValueError("the robots' radius is not positive")
    return frames, radius


def as_map(value: Mapping[str, Any]) -> Map:
    """The map that an object of JSON describes. Raises one of BROKEN."""
    points = _array(value["vertices"], (-1, 2))
    labels = np.array([LABELS[label] for label in value["labels"]], np.uint8)
    told = _array(value["edges"], (-1, 2))
    edges = told.astype(np.int64)
    if (edges != told).any():
        raise ValueError("an edge names a vertex by a fraction")
    if len(labels) != len(points):
        raise ValueError(f"{len(points)} vertices, but {len(labels)} labels")
    if len(edges) and (edges.min() < 0 or edges.max() >= len(points)):
        raise ValueError("an edge names a vertex that is not there")
    return Map(points, labels, edges)


def _compared(whole: Map, file: Path) -> Map:
    """The map, knowing which of its walls the same robot's map of its own walls lacks."""
    own = parse_map(_text(file))
    seen = {tuple(wall) for wall in own.vertices[own.edges].reshape(-1, 4).tolist()}
    walls = whole.vertices[whole.edges].reshape(-1, 4).tolist()
    return replace(whole, heard=frozenset(row for row, wall in enumerate(walls) if tuple(wall) not in seen))


def _snapshots(lines: list[dict[str, Any]]) -> list[tuple[float, Map]] | None:
    heard = (frozenset(map(int, line.get("heard", ()))) for line in lines)  # runs of older versions do not tell it
    maps = (replace(as_map(line["map"]), heard=rows) for line, rows in zip(lines, heard, strict=True))
    times = _times([line["t"] for line in lines]).tolist()
    return sorted(zip(times, maps, strict=True), key=lambda frame: frame[0]) or None


def _events(lines: list[dict[str, Any]], run: Run) -> list[dict[str, Any]]:
    """Those that have a time and a name; whatever else is in them."""
    events = [line for line in lines if isinstance(line.get("event"), str) and _is_time(line.get("t"))]
    if bad := len(lines) - len(events):
        run.note(f"events.jsonl: {bad} of {len(lines)} events have no time or no name")
    return [{**event, "t": float(event["t"]), "robot": str(event.get("robot", ""))} for event in events]


def _is_time(value: Any) -> bool:
    return isinstance(value, int | float) and 0 <= value < MAX_TIME_S


def read_trajectory(file: Path) -> Floats | None:
    """(n, 4) t, x, y, theta of a TUM file; None where it holds no pose. Raises one of BROKEN."""
    lines = _text(file).splitlines()
    rows = [words for line in lines if (words := line.split()) and line[0] != "#"]
    if not rows:
        return None
    t, x, y, _, _, _, qz, qw = _array(rows, (-1, 8)).T
    return np.column_stack((_times(t), x, y, 2 * np.arctan2(qz, qw)))


def read_metrics(file: Path) -> dict[str, Series]:
    """metrics.csv by robot and for the team. Raises OSError, ValueError or LookupError."""
    by_robot: defaultdict[str, list[dict[str, str]]] = defaultdict(list)
    for row in csv.DictReader(_text(file).splitlines()):
        by_robot[printable(row["robot"])].append(row)
    made = {}
    for robot, own in by_robot.items():
        names = [name for name in own[0] if name not in ("t", "tick", "robot")]
        columns = {name: _column([row[name] for row in own]) for name in names}
        made[robot] = Series(_times([row["t"] for row in own]), columns)
    return made


def _column(texts: list[str]) -> Floats:
    """Numbers of a table; NaN where a field is empty."""
    numbers = np.array([float(text or math.nan) for text in texts])
    if np.isinf(numbers).any() or (numbers < 0).any():
        raise ValueError("a number in it is negative or not finite")
    return numbers


def _times(values: Any) -> Floats:
    """(n,) simulated seconds."""
    times = _array([float(value) for value in values], (-1,))
    if (times < 0).any():
        raise ValueError("a time in it is negative")
    return times


def _array(value: Any, shape: tuple[int, ...]) -> Floats:
    array = np.array(value, np.float64).reshape(shape)
    if not (np.abs(array) <= MAX_M).all():
        raise ValueError(f"a number in it is not finite or over {MAX_M:,.0f}")
    return array
