"""Viewpoints: where a robot has looked from, for peers that have its map (ours; docs/protocol.md).

Places are on a grid of 10 cm, in the order in which the robot was there, or heard of them: it passes on those of peers
whose maps it has merged. Each is coded as its offset from where the last step would lead on. With them go the open ends
of walls at which the robot looked in vain. A list covers the ticks (since, until].
"""

import math
from bisect import bisect_right
from typing import NamedTuple

import numpy as np

from protocol.arrays import Floats, Ints
from protocol.bits import BitReader, BitWriter, bits_of, bits_of_each
from protocol.errors import ProtocolError
from protocol.geometry import Pose
from protocol.talk import POSE_BYTES, check_version, first_byte, pose_bytes, take_pose, take_varint, varint
from protocol.wireframe import MAX_COORDINATE_M

VIEWS = "views"  # kind of message, as in radio.csv
CELL_M = 0.1  # of the grid: a robot keeps 0.13 m from walls, so nearly the same is seen from the middle of its cell
MAX_VIEWPOINTS = 4000  # of one message: 2 km of path (ours)
TURN_BITS = 4
TURNS = 1 << TURN_BITS  # directions of open ends that are told apart, 22.5 degrees each: corners differ by 90
_ASKS, _PLACES, _HEARD, _IN_VAIN = 1, 2, 4, 8
"""Flags in the lowest bits of the first byte: a question; with the asked robot's frame; with others' viewpoints; with
open ends."""
_COUNT, _FIRST, _STEP = 4, 6, 1
"""Exponential-Golomb orders: of the count, of the first place, and of the other places' offsets."""


class AskViews(NamedTuple):
    """The question for a peer's viewpoints that are not known yet."""

    since: int  # tick of the last viewpoint that is known; 0 for none
    frame: Pose | None = None
    """Where the asked robot's frame lies in the sender's: to 1 mm and 0.006 degrees; None where it has not merged
    that robot's map, or told it lately."""

    def encode(self) -> bytes:
        """2 to 6 bytes, and 10 of the frame."""
        if self.frame is None:
            return first_byte(_ASKS) + varint(self.since)
        return first_byte(_ASKS | _PLACES) + varint(self.since) + pose_bytes(self.frame)


class Views(NamedTuple):
    """Where the sender has looked from, or heard that others have, after one tick and until another."""

    since: int  # 0: the list is whole, and replaces what was told before
    until: int
    cells: Ints  # (k, 2) in units of CELL_M, the sender's own frame
    heard: Ints = np.zeros((0, 2), np.int64)  # (j, 2) the same, of peers whose maps it has merged
    in_vain: Ints = np.zeros((0, 3), np.int64)
    """(g, 3) cells of open ends that it looked at in vain, and where the wall goes on there, in TURNS a turn."""

    @property
    def points(self) -> Floats:
        """(k + j, 2) metres, its own ones first."""
        return np.asarray(CELL_M * np.vstack((self.cells, self.heard)), np.float64)

    @property
    def ends(self) -> Floats:
        """(g, 4) metres and unit: these open ends, and where their walls go on."""
        turn = 2.0 * np.pi / TURNS * self.in_vain[:, 2]
        return np.column_stack((CELL_M * self.in_vain[:, :2], np.cos(turn), np.sin(turn)))

    def encode(self) -> bytes:
        """About five bits a viewpoint, and thirty an open end."""
        bits = BitWriter()
        _write(bits, self.cells)
        if len(self.heard):
            _write(bits, self.heard)
        if len(self.in_vain):
            _write(bits, self.in_vain[:, :2])
            for turn in self.in_vain[:, 2].tolist():
                bits.bits(turn, TURN_BITS)
        return self._head() + bits.data()

    @property
    def nbytes(self) -> int:
        """How many bytes that are."""
        bits = _size(self.cells) + (_size(self.heard) if len(self.heard) else 0)
        if len(self.in_vain):
            bits += _size(self.in_vain[:, :2]) + TURN_BITS * len(self.in_vain)
        return len(self._head()) + (bits + 7 >> 3)

    def _head(self) -> bytes:
        flags = _HEARD * (len(self.heard) > 0) | _IN_VAIN * (len(self.in_vain) > 0)
        return first_byte(flags) + varint(self.until) + varint(self.until - self.since)


def _numbers(cells: Ints) -> Ints:
    """(2 k,) numbers >= 0 that tell cells (k, 2): those of the first have the order _FIRST, all others _STEP."""
    offsets = np.diff(cells, axis=0, prepend=0)  # of the first one its place, of the second one its step
    offsets[2:] -= offsets[1:-1].copy()
    return np.where(offsets >= 0, 2 * offsets, -2 * offsets - 1).reshape(-1)  # as `bits.folded`


def _write(bits: BitWriter, cells: Ints) -> None:
    """How many cells (k, 2) there are, and each."""
    bits.number(len(cells), _COUNT)
    for k, value in enumerate(_numbers(cells).tolist()):
        bits.number(value, _FIRST if k < 2 else _STEP)


def _size(cells: Ints) -> int:
    """Bits that `_write` makes of cells (k, 2), without making them."""
    numbers, orders = _numbers(cells), np.full(2 * len(cells), _STEP)
    orders[:2] = _FIRST
    return bits_of(len(cells), _COUNT) + int(bits_of_each(numbers, orders).sum())


def _read(reader: BitReader) -> Ints:
    """(k, 2) cells as they were written."""
    count = reader.number(_COUNT)
    if count > MAX_VIEWPOINTS:
        raise ProtocolError(f"{count} viewpoints in one message; 1 to {MAX_VIEWPOINTS} are taken")
    cells: list[tuple[int, int]] = []
    last = step = (0, 0)
    order = _FIRST
    for _ in range(count):
        x, y = (last[axis] + step[axis] + reader.signed(order) for axis in (0, 1))
        if CELL_M * max(abs(x), abs(y)) > MAX_COORDINATE_M:
            raise ProtocolError("a viewpoint out of bounds")
        step = (x - last[0], y - last[1]) if order == _STEP else (0, 0)
        last, order = (x, y), _STEP
        cells.append(last)
    return np.array(cells, np.int64).reshape(-1, 2)


def turn_of_end(along: Floats) -> int:
    """A unit direction (2,) in TURNS a turn."""
    return round(math.atan2(along[1], along[0]) / (2.0 * math.pi) * TURNS) % TURNS


def decode_views(data: bytes) -> AskViews | Views:
    """Raises ProtocolError on anything else than one of the two."""
    flags = check_version(data)
    tick, at = take_varint(data, 1)
    if flags == _ASKS and at == len(data):
        return AskViews(tick)
    if flags == _ASKS | _PLACES and at + POSE_BYTES == len(data):
        return AskViews(tick, take_pose(data, at)[0])
    if flags & ~(_HEARD | _IN_VAIN):
        raise ProtocolError("a message about viewpoints that is none")
    back, at = take_varint(data, at)
    if not 0 < back <= tick:
        raise ProtocolError("viewpoints of the future")
    reader = BitReader(data[at:])
    views = Views(tick - back, tick, _read(reader))
    if flags & _HEARD:
        views = views._replace(heard=_read(reader))
    if flags & _IN_VAIN:
        places = _read(reader)
        turns = [reader.bits(TURN_BITS) for _ in places]
        views = views._replace(in_vain=np.column_stack((places, np.array(turns, np.int64))))
    reader.finish()
    lists = {_HEARD: views.heard, _IN_VAIN: views.in_vain}
    if not (flags or len(views.cells)) or any(flags & flag and not len(some) for flag, some in lists.items()):
        raise ProtocolError("a message of viewpoints without any")
    return views


class Looked(NamedTuple):
    """From where a robot knows that it, or a peer whose map it has merged, has looked, and at which open ends it did so
    in vain; rows in order of the ticks."""

    ticks: list[int]  # (k,) when it was there, or heard of it
    places: list[tuple[float, float]]  # (k,) metres, its own frame
    owners: list[str]  # (k,) who was there; empty: the robot itself
    turns: list[int]  # (k,) of an open end where its wall goes on, in TURNS a turn; -1 of a viewpoint

    @classmethod
    def nowhere(cls) -> "Looked":
        """Nothing yet."""
        return cls([], [], [], [])

    def add(self, tick: int, x: float, y: float, owner: str = "", turn: int = -1) -> None:
        """Add one."""
        self.ticks.append(tick)
        self.places.append((x, y))
        self.owners.append(owner)
        self.turns.append(turn)

    def between(self, since: int, until: int, mtu: int, asker: str = "") -> Views | None:
        """What there is to tell in a message of at most mtu bytes, the oldest first; None without anything.

        Nobody is told of his own viewpoints. A robot that began anew after `since` tells all.
        """
        if since and self.ticks and since < self.ticks[0]:
            since = 0
        first, end = bisect_right(self.ticks, since or -1), bisect_right(self.ticks, until)
        rows = [row for row in range(first, end) if not asker or self.owners[row] != asker]
        count = min(len(rows), MAX_VIEWPOINTS, 2 * mtu)  # a viewpoint takes four bits or more
        while count := self._whole_ticks(rows, count):
            ends = [row for row in rows[:count] if self.turns[row] >= 0]
            own, heard = (
                [row for row in rows[:count] if self.turns[row] < 0 and bool(self.owners[row]) == others]
                for others in (False, True)
            )
            turns = np.array([self.turns[row] for row in ends], np.int64)
            in_vain = np.column_stack((self._cells(ends), turns))
            views = Views(since, self.ticks[rows[count - 1]], self._cells(own), self._cells(heard), in_vain)
            if views.until > 0 and views.nbytes <= mtu:
                return views
            count //= 2
        return None

    def _whole_ticks(self, rows: list[int], count: int) -> int:
        """How many of the first `count` rows there are without those of a tick that goes on after them."""
        while 0 < count < len(rows) and self.ticks[rows[count - 1]] == self.ticks[rows[count]]:
            count -= 1
        return count

    def _cells(self, rows: list[int]) -> Ints:
        """(k, 2) cells of these rows."""
        return np.round(np.array([self.places[row] for row in rows]).reshape(-1, 2) / CELL_M).astype(np.int64)


NOWHERE = Looked.nowhere()
