"""A run as a Rerun recording: what is drawn where, and how the viewer shows it first.

All that is drawn lies in the world's frame, metres, x to the right and y ahead, the walls standing on z = 0. Each thing
has a path: world/walls, world/ROBOT with its beams, world/maps/ROBOT, world/trials/ROBOT/PEER, world/radio,
coverage/ROBOT and events. Two timelines: tick, and simulated seconds (sim).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from deploy.report import style
from deploy.report.rundir import MAX_M, Map
from deploy.report.story import GLYPHS, SEVERITY, forgets, sentence
from protocol.arrays import Floats, Ints
from protocol.geometry import compose, pose_of
from protocol.messages import LidarSpec
from protocol.wireframe import Label
from world.recorder import TEAM
from world.worldfile import rings_of

HIGH_M = 0.15  # of the walls as drawn: a world file does not say
ABOVE_M = 0.02  # maps lie so far above the walls
BESIDE_M = 0.04  # between the maps of two robots where they agree
NAME_M = 0.35  # height of a robot's name
WALL_M, TRIAL_M, BEAM_M, RADIO_M = 0.02, 0.012, 0.003, 0.015  # half widths of lines
LIT, SHADED = (0xD3, 0xD8, 0xDE), (0x8A, 0x93, 0x9E)  # tops and sides of the true walls
LABELS = {Label.NOMINAL: (style.INK, 0.03), Label.OCCLUSION: ("#f0a500", 0.05), Label.FRONTIER: (style.OPEN, 0.07)}
"""Colour and radius (m) of a map's vertices."""
HEARD, TRIED = 0x7B879490, 0xE8B500FF  # colours of radio links and of maps on trial
REPLAY_S = 60.0  # in which a replay shows the whole run, unless the viewer's speed is changed
SEEN_FROM = (0.0, -0.15, 1.1)
"""Where the eye is, in the world's longer sides from its middle."""
BEAMS_APART = 4  # beams drawn: each fourth one, as all of them would hide the rest
LEVELS = {"warning": "WARN", "error": "ERROR"}
"""Of the log, by severity; what is no part of the story of trust is DEBUG."""
BONDS = ("proposed", "accepted", "rejected", "unmerged")
"""Events that change what a robot holds of another."""
NO_WALLS = np.zeros((0, 2, 2))
SHOWN = ["ERROR", "WARN", "INFO"]

Ticks = Sequence[int] | Ints


def replayed(duration_s: float) -> rrb.TimePanel:
    """Play a finished run of so many simulated seconds from its begin."""
    return rrb.TimePanel(
        timeline="sim", state="collapsed", play_state="playing", playback_speed=max(1, round(duration_s / REPLAY_S))
    )


def followed() -> rrb.TimePanel:
    """Show the newest of a run that is under way."""
    return rrb.TimePanel(timeline="sim", state="collapsed", play_state="following")


class ViewRecording:
    """Rows of a recording.

    Each method takes rows in one call, with the tick of each: one for what just came, all of a run for a replay.
    """

    def __init__(self, file: Path, robots: Sequence[str], frames: Mapping[str, Floats], period_s: float) -> None:
        """file: where it is written, an .rrd. frames: by robot, (3,) the pose of its own frame in the world."""
        self._stream = rr.RecordingStream("wireswarm", send_properties=False)
        self._stream.set_sinks(rr.FileSink(file))
        self._robots, self._frames, self._period_s = list(robots), dict(frames), period_s
        self._styled: set[str] = set()
        self._merged: defaultdict[str, set[str]] = defaultdict(set)
        self._trials: defaultdict[str, set[str]] = defaultdict(set)

    def flush(self) -> None:
        """Write what was added."""
        self._stream.flush()

    def close(self) -> None:
        """Write the file's end."""
        self._stream.disconnect()

    def scene(self, solid: BaseGeometry, radius_m: float, play: rrb.TimePanel) -> None:
        """The true walls, the robots' bodies, and how the viewer shows all and plays it."""
        self._stream.send_blueprint(_blueprint(solid, play))
        words = [rr.AnnotationInfo(label, label.word, _rgba(colour)) for label, (colour, _) in LABELS.items()]
        self._always("/", rr.AnnotationContext(words))
        self._always("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        self._always("world/walls", _walls(solid))
        for robot in self._robots:
            colour = self._colour(robot)
            body = rr.Cylinders3D(lengths=[0.2], radii=[radius_m], centers=[(0, 0, 0.1)], colors=_paint(colour))
            self._always(f"world/{robot}/body", body)
            ahead = rr.Arrows3D(
                vectors=[(2.5 * radius_m, 0, 0)], origins=[(0, 0, 0.21)], radii=[0.2 * radius_m], colors=_paint(colour)
            )
            self._always(f"world/{robot}/heading", ahead)
            x, y, theta = self._frames[robot].tolist()
            self._always(f"world/maps/{robot}/vertices", rr.Points3D.from_fields(show_labels=False))
            self._always(f"world/maps/{robot}", rr.Transform3D(translation=(x, y, 0), quaternion=_turned([theta])[0]))
        for name in (*self._robots, TEAM):
            colour = _rgba(style.FAINT) if name == TEAM else self._colour(name)
            line = rr.SeriesLines(colors=_paint(colour), names=[name])
            self._always(f"coverage/{name}", line)
        for robot in self._robots:
            self._name([0], robot)

    def drive(self, robot: str, ticks: Ticks, poses: Floats) -> None:
        """Where a robot truly is: poses (k, 3), world frame."""
        places = np.column_stack((poses[:, :2], np.zeros(len(poses))))
        columns = rr.Transform3D.columns(translation=places, quaternion=_turned(poses[:, 2]))
        self._send(f"world/{robot}", ticks, columns)

    def beams(self, robot: str, ticks: Ticks, scans: Iterable[Floats], lidar: LidarSpec) -> None:
        """What a robot's beams met: scans (beams,), metres; what is not finite is not drawn."""
        bearings = lidar.bearings()[::BEAMS_APART]
        aim = np.column_stack((np.cos(bearings), np.sin(bearings)))
        mount = np.array((lidar.mount_x_m, lidar.mount_y_m))
        rows = []
        for scan in scans:
            ranges = scan[::BEAMS_APART]
            met = np.isfinite(ranges)
            ends = mount + ranges[met, None] * aim[met]
            rows.append(np.stack((np.broadcast_to(mount, ends.shape), ends), axis=1))
        self._lines(f"world/{robot}/beams", ticks, rows, self._colour(robot, 0x50), BEAM_M, 0.15)

    def maps(self, robot: str, ticks: Ticks, maps: Sequence[Map]) -> None:
        """A robot's maps in its own frame, its walls and those that only others saw told apart."""
        k, colour = self._robots.index(robot), self._colour(robot)
        moved, path = [one.inset(k * BESIDE_M) for one in maps], f"world/maps/{robot}"
        heard = [np.isin(np.arange(len(one.edges)), list(one.heard)) for one in moved]
        walls = [one.vertices[one.edges] for one in moved]
        own = [lines[~of_others] for lines, of_others in zip(walls, heard, strict=True)]
        others = [lines[of_others] for lines, of_others in zip(walls, heard, strict=True)]
        self._lines(f"{path}/own", ticks, own, colour, WALL_M)
        self._lines(f"{path}/heard", ticks, others, self._colour(robot, 0x90), WALL_M / 2)
        points = np.concatenate([_raised(one.vertices, HIGH_M + 2 * ABOVE_M) for one in moved])
        labels = np.concatenate([one.labels for one in moved])
        radii = np.array([LABELS[label][1] for label in Label])[labels]
        columns = rr.Points3D.columns(positions=points, radii=radii, class_ids=labels)  # named where the mouse is
        self._send(f"{path}/vertices", ticks, columns, [len(one.vertices) for one in moved])

    def radio(self, ticks: Ticks, links: Sequence[Floats]) -> None:
        """Who hears whom: for each tick the places (links, 2, 2) of both ends."""
        self._lines("world/radio", ticks, links, HEARD, RADIO_M, NAME_M)

    def coverage(self, name: str, ticks: Ticks, shares: Floats) -> None:
        """Of a robot, or the team."""
        self._send(f"coverage/{name}", ticks, rr.Scalars.columns(scalars=shares))

    def events(self, ticks: Ticks, events: Sequence[Mapping[str, Any]]) -> None:
        """Lines of the log: `robot`, `event` and what else an event of events.jsonl has."""
        if not events:
            return
        texts = [sentence(dict(event)) for event in events]
        names = [event["event"] for event in events]
        levels = [LEVELS.get(SEVERITY.get(name, ""), "INFO" if name in GLYPHS else "DEBUG") for name in names]
        self._send("events", ticks, rr.TextLog.columns(text=texts, level=levels))

    def trust(self, tick: int, event: Mapping[str, Any], tried: Map | None) -> None:
        """Show what an event changes between two robots: `tried` is the peer's map in its own frame, if it is known."""
        robot, peer, what = event["robot"], event.get("peer"), event["event"]
        if robot not in self._robots:
            return
        if what == "dead" or forgets(event):
            for one in sorted(self._trials.pop(robot, ())):
                self._trial(tick, robot, one)
            if what != "dead":  # the last map of a dead robot holds what it had merged
                self._merged.pop(robot, None)
        elif what not in BONDS or peer not in self._robots:
            return
        elif what == "proposed":
            self._trials[robot].add(peer)
            if tried is not None and _is_pose(event.get("transform")):
                frame = compose(pose_of(self._frames[robot]), tuple(event["transform"]))
                placed = tried.moved(np.array(frame))
                said = f"{robot} tries {peer}: {event.get('inliers', 'some')} corners fit"
                self._trial(tick, robot, peer, placed.vertices[placed.edges], said)
        else:
            self._trials[robot].discard(peer)
            (self._merged[robot].add if what == "accepted" else self._merged[robot].discard)(peer)
            self._trial(tick, robot, peer)
        self._name([tick], robot)

    def _trial(self, tick: int, robot: str, peer: str, walls: Floats = NO_WALLS, said: str | None = None) -> None:
        """Draw the map of a peer that is on trial, its walls (n, 2, 2); none where the trial has ended."""
        path = f"world/trials/{robot}/{peer}"
        self._lines(path, [tick], [walls], TRIED, TRIAL_M, HIGH_M + 3 * ABOVE_M, said)

    def _name(self, ticks: Ticks, robot: str) -> None:
        """A robot's name, with whose maps it has merged and tries."""
        parts = [f"{word} {', '.join(sorted(of[robot]))}" for word, of in self._standing if of[robot]]
        columns = rr.Points3D.columns(
            positions=[(0, 0, NAME_M)],
            radii=[0.001],
            colors=_paint(self._colour(robot)),
            labels=[": ".join((robot, "; ".join(parts))) if parts else robot],
            show_labels=[True],
        )
        self._send(f"world/{robot}/name", ticks, columns)

    @property
    def _standing(self) -> tuple[tuple[str, Mapping[str, set[str]]], ...]:
        return ("merged", self._merged), ("tries", self._trials)

    def _lines(
        self,
        path: str,
        ticks: Ticks,
        rows: Sequence[Floats],
        colour: int,
        half_width: float,
        z: float = HIGH_M + ABOVE_M,
        said: str | None = None,
    ) -> None:
        """For each tick lines from place to place, (n, 2, 2), that replace those of the tick before."""
        if path not in self._styled:
            self._styled.add(path)
            self._always(path, rr.LineStrips3D.from_fields(colors=_paint(colour), radii=[half_width]))
        strips = _raised(np.concatenate(rows).reshape(-1, 2), z).reshape(-1, 2, 3).astype(np.float32)
        self._send(path, ticks, rr.LineStrips3D.columns(strips=strips), [len(row) for row in rows])
        if said is not None:
            self._send(path, ticks, rr.LineStrips3D.columns(labels=[said], show_labels=[True]))

    def _send(
        self, path: str, ticks: Ticks, columns: rr.ComponentColumnList, lengths: Sequence[int] | None = None
    ) -> None:
        numbers = np.asarray(ticks)
        times = [
            rr.TimeColumn("tick", sequence=numbers),
            rr.TimeColumn("sim", duration=np.round(numbers * self._period_s * 1e3).astype("timedelta64[ms]")),
        ]
        self._stream.send_columns(path, times, columns if lengths is None else columns.partition(lengths))

    def _always(self, path: str, what: Any) -> None:
        self._stream.log(path, what, static=True)

    def _colour(self, robot: str, opacity: int = 0xFF) -> int:
        return _rgba(style.colour(self._robots.index(robot)), opacity)


def _rgba(colour: str, opacity: int = 0xFF) -> int:
    """A colour such as #0072b2 as Rerun takes it."""
    return int(colour[1:], 16) << 8 | opacity


def _paint(colour: int) -> NDArray[np.uint32]:
    return np.array([colour], np.uint32)


def _is_pose(value: Any) -> bool:
    """Whether an event's value is a pose that can be drawn."""
    parts = value if isinstance(value, list | tuple) and len(value) == 3 else [None]
    return all(isinstance(part, int | float) and abs(part) <= MAX_M for part in parts)


def _raised(points: Floats, z: float) -> Floats:
    """Points (n, 2) at a height (n, 3)."""
    return np.column_stack((points, np.full(len(points), z)))


def _turned(headings: Iterable[float]) -> Floats:
    """Quaternions (n, 4), x y z w, of turns about z."""
    half = np.fromiter(headings, np.float64) / 2
    return np.column_stack((np.zeros((len(half), 2)), np.sin(half), np.cos(half)))


def _walls(solid: BaseGeometry) -> rr.Mesh3D:
    """Solids (polygons), HIGH_M high: their tops as triangles, and two triangles for each side."""
    tops = shapely.get_coordinates(shapely.constrained_delaunay_triangles(solid)).reshape(-1, 4, 2)[:, :3]
    sides = []
    for ring in rings_of(solid):
        low, high = (_raised(ring, z) for z in (0.0, HIGH_M))
        sides += [np.stack((low[:-1], low[1:], high[1:]), 1), np.stack((low[:-1], high[1:], high[:-1]), 1)]
    corners = np.concatenate([_raised(tops.reshape(-1, 2), HIGH_M), *(side.reshape(-1, 3) for side in sides)])
    colours = np.full((len(corners), 3), SHADED, np.uint8)
    colours[: tops.shape[0] * 3] = LIT
    triangles = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
    return rr.Mesh3D(vertex_positions=corners, triangle_indices=triangles, vertex_colors=colours)


def _blueprint(solid: BaseGeometry, play: rrb.TimePanel) -> rrb.Blueprint:
    """World on the left, coverage and the log on the right."""
    x0, y0, x1, y1 = solid.bounds
    middle, side = np.array(((x0 + x1) / 2, (y0 + y1) / 2, 0.0)), math.hypot(x1 - x0, y1 - y0) / math.sqrt(2)
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital, position=middle + side * np.array(SEEN_FROM), look_target=middle, eye_up=(0, 0, 1)
    )
    world = rrb.Spatial3DView(origin="world", name="World", eye_controls=eye, line_grid=False)
    share = rrb.TimeSeriesView(origin="coverage", name="Coverage")
    columns = rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"])
    rows = rrb.TextLogRows(filter_by_log_level=SHOWN)
    log = rrb.TextLogView(origin="events", name="Events", columns=columns, rows=rows)
    return rrb.Blueprint(
        rrb.Horizontal(world, rrb.Vertical(share, log), column_shares=[3, 2]),
        play,
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="collapsed"),
    )
