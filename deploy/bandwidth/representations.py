"""What a run's map traffic would have cost in other forms, charged at the moments at which it sent something new.

A contact update is one such moment (updates.jsonl). Then `full`, `json`, `grid_*` and `points` send their whole
current map, `scans_*` the scans since the last update to that peer, `grid_delta_zlib` the cells that changed since.
Baselines pay for their bytes alone; only ours pays for headers, acknowledgements and what was sent again.
"""

import io
import json
import zlib
from collections import defaultdict
from collections.abc import Iterable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar

import numpy as np
from PIL import Image
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from rich.progress import track

from agent.communication.config import TalkConfig
from deploy.bandwidth.books import NoRunError, check_has, on_air, read_traffic
from deploy.bandwidth.replay import Seen, config_of, seen_again
from deploy.config import RunConfig
from deploy.occupancy_grid import OccupancyGrid, States, two_bits
from deploy.report.rundir import BROKEN, MAX_TIME_S, as_map
from deploy.terminal.console import Terminal
from protocol.document import read_lines
from protocol.errors import InputError
from protocol.files import write_whole
from protocol.frames import FRAMES
from protocol.grid_map import main_axis, quantise
from protocol.map_codec import encode_map
from protocol.talk import ACK, BEACON, DELTA, MAP, RESEND
from protocol.viewpoints import VIEWS
from protocol.wireframe import Wireframe
from world.config import WorldConfig
from world.radio.gate import HELD_BACK

CELL_M = 0.05  # of the grids, in the robot's own frame
POINT_BYTES = 8  # two float32: a point per occupied cell
FORMS = {
    "delta": "what went on the air: changes, headers, acknowledgements, what was sent again",
    "full": "the whole map anew, coded as ours",
    "json": "the whole map anew as JSON",
    "grid_raw": "the whole 5 cm grid anew, a byte a cell",
    "grid_zlib": "the same by zlib",
    "grid_delta_zlib": "the cells that changed, by zlib",
    "grid_png": "the whole grid anew as PNG",
    "scans_raw": "the scans since the last update, float32",
    "scans_zlib": "the same by zlib",
    "points": "a point per occupied cell, the whole map anew",
}
NAMES = tuple(FORMS)
OURS = (MAP, DELTA, RESEND, ACK)
"""Kinds of messages that are `delta`. Viewpoints are no part of the map: like beacons they are counted apart."""


class Update(NamedTuple):
    """One contact update, and what it costs in each form but `delta`, whose bytes go when they go."""

    t: float
    robot: str
    bytes: dict[str, int]


class _Head(BaseModel):
    """What a line of updates.jsonl says beside its map: without that it is read in a third of the time (measured)."""

    model_config = ConfigDict(strict=True)

    t: Annotated[float, Field(ge=0, lt=MAX_TIME_S)]
    tick: Annotated[int, Field(ge=0, lt=MAX_TIME_S)]
    robot: str
    told: list[str]


class _Line(_Head):
    """A line of updates.jsonl."""

    map: dict[str, Any]


Line = TypeVar("Line", bound=_Head)

Charged = tuple[list[Update], float]
"""A robot's updates, and the free area that its grid has at its end, m2."""


@dataclass(frozen=True)
class Measurement:
    """The map traffic of a run in all forms."""

    updates: list[Update]
    sent: list[tuple[float, str, int]]  # simulated seconds, robot and bytes of each message that is part of `delta`
    beacon_bytes: int
    viewpoint_bytes: int  # questions and answers of where robots have looked from
    frame_bytes: int  # where the frames of others lie
    explored_m2: dict[str, float]  # free area that each robot's grid has at its end
    books: dict[str, Any]  # bandwidth.json before it was measured

    def totals(self) -> dict[str, int]:
        """Bytes by form."""
        rest = {name: sum(update.bytes[name] for update in self.updates) for name in NAMES if name != "delta"}
        return {"delta": sum(size for _, _, size in self.sent), **rest}

    def as_dict(self) -> dict[str, Any]:
        """The fields that it adds to bandwidth.json."""
        return {
            "beacon_bytes": self.beacon_bytes,
            "viewpoint_bytes": self.viewpoint_bytes,
            "frame_bytes": self.frame_bytes,
            "updates": len(self.updates),
            "explored_m2": {robot: round(area, 2) for robot, area in self.explored_m2.items()},
            "representations": self.totals(),
        }


def measure(run: Path, config: WorldConfig | None = None, pool: Executor | None = None) -> Measurement:
    """Measure a run directory; config: of the run, None to read it there. Raises NoRunError.

    pool: its robots are divided among these processes, and a terminal shows how many are done.
    """
    config = config or config_of(run)
    (books, ours), seen = read_traffic(run, OURS), seen_again(run, config)
    check_has(run, "updates.jsonl")
    period_s = 1 / config.spec.lidar.rate_hz
    named, told = {row.sender for row in ours}, defaultdict[str, list[tuple[int, str]]](list)
    try:
        for text in read_lines(run / "updates.jsonl"):
            line = _parsed(_Head, text)
            named.update((line.robot, *line.told))
            told[line.robot].append((line.tick, text))  # parsed, its map takes seven times the memory
        if unknown := named.difference(seen):
            raise ValueError(f"its files name {min(unknown):.40}, and truth.json does not")
    except BROKEN as error:
        raise NoRunError(f"{run} is no finished run: {error}") from None
    sent = [(row.tick * period_s, row.sender, row.bytes) for row in ours if row.outcome not in HELD_BACK]
    beacons, views, frames = (on_air(books, kind) for kind in (BEACON, VIEWS, FRAMES))
    live = {robot: what for robot, what in seen.items() if len(what.ranges)}  # else dead before it saw anything

    own = [[text for _, text in sorted(told[robot], key=itemgetter(0))] for robot in live]
    charged = (pool.map if pool else map)(partial(_charged, config), live.values(), own)
    try:
        found = dict(zip(live, _watched(charged, len(live)) if pool else charged, strict=True))
    except InputError as error:
        raise NoRunError(f"{run} is no finished run: {error}") from None
    updates = [update for mine, _ in found.values() for update in mine]
    explored = {robot: found[robot][1] if robot in found else 0.0 for robot in seen}
    updates.sort(key=lambda update: update.t)
    return Measurement(updates, sent, beacons, views, frames, explored, books)


def write(run: Path, measurement: Measurement) -> None:
    """Add the measurement to bandwidth.json."""
    text = json.dumps(measurement.books | measurement.as_dict(), indent=1, allow_nan=False)
    write_whole(run / "bandwidth.json", text + "\n")


def _watched(done: Iterable[Charged], total: int) -> Iterable[Charged]:
    """The same, with a bar on a terminal."""
    console = Terminal()
    return track(done, "bandwidth", total, console=console, transient=True, disable=not console.is_terminal)


def _parsed(model: type[Line], text: str) -> Line:
    """What a line of updates.jsonl says. Raises InputError."""
    try:
        return model.model_validate_json(text)
    except ValidationError as error:
        wrong = error.errors()[0]
        raise InputError(f"updates.jsonl: {'.'.join(map(str, wrong['loc']))}: {wrong['msg']}") from None


def _charged(config: WorldConfig, seen: Seen, lines: Iterable[str]) -> Charged:
    """A robot's updates by its lines of updates.jsonl, in order, and the free area that its grid has at its end.

    Raises InputError for a line without a map or with one that no robot tells, and for poses too far apart.
    """
    forms = _Forms(seen, config)
    updates = [update for line in lines for update in forms.charge(_parsed(_Line, line))]
    return updates, float((forms.states(len(seen.ranges) - 1) == 1).sum() * CELL_M**2)


class _Forms:
    """One robot's map in all forms, as it grows."""

    def __init__(self, seen: Seen, config: WorldConfig) -> None:
        reach = config.spec.lidar.range_max_m
        low, high = seen.poses[:, :2].min(0) - reach, seen.poses[:, :2].max(0) + reach
        low = np.floor(low / CELL_M) * CELL_M
        self._seen = seen
        self._talk = config.agent.radio if isinstance(config, RunConfig) else TalkConfig()
        self._grid = OccupancyGrid((*low.tolist(), *high.tolist()), CELL_M, reach)
        self._next = seen.begin  # tick of the first scan that is not in the grid
        self._told: dict[str, tuple[int, States]] = {}
        """Per peer the tick after its last update, and the grid as it was."""

    def states(self, tick: int) -> States:
        """(nx, ny) 0 unknown, 1 free, 2 occupied, with the scan of that tick."""
        new = slice(self._next, tick + 1)
        ranges = self._seen.ranges[new].astype(np.float64)
        ranges[np.isinf(ranges)] = np.nan  # silent beams clear no cells: dark and grazing walls return nothing, too
        self._next = max(self._next, tick + 1)
        return self._grid.add(ranges, self._seen.rays(new)).states()

    def charge(self, line: _Line) -> list[Update]:
        """Updates of one line of updates.jsonl, one for each peer. Raises InputError."""
        tick, states = line.tick, self.states(line.tick)
        try:
            whole = _whole_map(line.map, self._talk) | _whole_grid(states)
        except BROKEN as error:
            raise InputError(f"updates.jsonl: {line.robot} told no map at tick {tick} ({error})") from None
        updates = []
        for peer in line.told:
            since, before = self._told.get(peer, (self._seen.begin, np.zeros_like(states)))
            scans = self._seen.ranges[since : tick + 1]
            part = {"scans_raw": scans.nbytes, "scans_zlib": len(zlib.compress(scans.tobytes(), 6))}
            part["grid_delta_zlib"] = _changed_cells(before, states)
            updates.append(Update(line.t, line.robot, whole | part))
            self._told[peer] = tick + 1, states
        return updates


def _whole_map(fields: Mapping[str, Any], talk: TalkConfig) -> dict[str, int]:
    """`full` on the grid and with the likelihoods that the robots sent, or the two would not be of one map."""
    told, likelihood = as_map(fields), np.array(fields["edge_likelihood"], np.float32)
    edges = told.edges.astype(np.int32)
    wireframe = Wireframe(told.vertices, told.labels, edges, likelihood, np.ones(len(edges), np.bool_))
    full = encode_map(quantise(wireframe, talk.cell_mm, main_axis(wireframe)), likelihoods=talk.likelihoods).data
    return {"full": len(full), "json": len(json.dumps(fields, separators=(",", ":")))}


def _whole_grid(states: States) -> dict[str, int]:
    cells, png = _cropped(states), io.BytesIO()
    image = Image.fromarray(cells).convert("P")
    image.putpalette([205, 205, 205, 254, 254, 254, 0, 0, 0])  # of the usual map files: unknown, free, occupied
    image.save(png, "PNG", bits=2, optimize=True)
    return {
        "grid_raw": cells.size,
        "grid_zlib": min(len(zlib.compress(cells.tobytes(), 9)), len(zlib.compress(two_bits(cells), 9))),
        "grid_png": len(png.getvalue()),
        "points": POINT_BYTES * int((cells == 2).sum()),
    }


def _cropped(states: States) -> States:
    """The smallest part that holds all known cells; one unknown cell where none is known."""
    rows, columns = np.flatnonzero(states.any(1)), np.flatnonzero(states.any(0))
    return states[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] if len(rows) else states[:1, :1]


def _changed_cells(before: States, after: States) -> int:
    """Bytes of the cells that changed: as gaps and states, or as an image of their box, whichever is shorter."""
    changed = np.flatnonzero(before != after)
    gaps = np.diff(changed, prepend=-1).astype("<u4")
    listed = gaps.astype("<u2") if len(gaps) and gaps.max() < 2**16 else gaps
    as_list = len(zlib.compress(listed.tobytes() + two_bits(after.reshape(-1)[changed]), 9))
    image = _cropped(np.where(before != after, after + 1, 0).astype(np.uint8))
    return min(as_list, len(zlib.compress(image.tobytes(), 9)), len(zlib.compress(two_bits(image), 9)))
