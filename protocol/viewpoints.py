"""Viewpoints: where a robot has looked from, for peers that have merged its map (ours; docs/protocol.md).

Places are on a grid of 10 cm, in the order in which the robot was there. Each is coded as its offset from where the
last step would lead on. A list covers the ticks (since, until].
"""

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from protocol.arrays import Floats, Ints
from protocol.bits import BitReader, BitWriter
from protocol.errors import ProtocolError
from protocol.geometry import Pose
from protocol.talk import angle_of, check_version, first_byte, take_varint, turn_of, varint
from protocol.wireframe import MAX_COORDINATE_M

VIEWS = "views"  # kind of message, as in radio.csv
CELL_M = 0.1  # of the grid: a robot keeps 0.13 m from walls, so nearly the same is seen from the middle of its cell
MAX_VIEWPOINTS = 4000  # of one message: 2 km of path (ours)
_ASKS, _PLACES = 1, 2  # flags in the lowest bits of the first byte: a question; with the asked robot's frame
_FRAME = struct.Struct("<iiH")
_COUNT, _FIRST, _STEP = 4, 6, 1
"""Exponential-Golomb orders: of the count, of the first place, and of the other places' offsets."""


class AskViews(NamedTuple):
    """The question for a merged peer's viewpoints that are not known yet."""

    since: int  # tick of the last viewpoint that is known; 0 for none
    frame: Pose | None = None
    """Where the asked robot's frame lies in the sender's: to 1 mm and 0.006 degrees; None where it knows already."""

    def encode(self) -> bytes:
        """Two to seven bytes, and ten of the frame."""
        if self.frame is None:
            return first_byte(_ASKS) + varint(self.since)
        x, y, theta = self.frame
        frame = _FRAME.pack(round(1000 * x), round(1000 * y), turn_of(theta))
        return first_byte(_ASKS | _PLACES) + varint(self.since) + frame


class Views(NamedTuple):
    """Where the sender has looked from after one tick and until another."""

    since: int  # 0: the list is whole, and replaces what was told before
    until: int
    cells: Ints  # (k, 2) in units of CELL_M, the sender's own frame

    @property
    def points(self) -> Floats:
        """(k, 2) metres."""
        return np.asarray(CELL_M * self.cells, np.float64)

    def encode(self) -> bytes:
        """About five bits a viewpoint."""
        bits = BitWriter()
        bits.number(len(self.cells), _COUNT)
        last = step = (0, 0)
        order = _FIRST
        for x, y in self.cells.tolist():
            bits.signed(x - last[0] - step[0], order)
            bits.signed(y - last[1] - step[1], order)
            step = (x - last[0], y - last[1]) if order == _STEP else (0, 0)
            last, order = (x, y), _STEP
        return first_byte(0) + varint(self.until) + varint(self.until - self.since) + bits.data()


def decode_views(data: bytes) -> AskViews | Views:
    """Raises ProtocolError on anything else than one of the two."""
    flags = check_version(data)
    tick, at = take_varint(data, 1)
    if flags == _ASKS and at == len(data):
        return AskViews(tick)
    if flags == _ASKS | _PLACES and at + _FRAME.size == len(data):
        x, y, turn = _FRAME.unpack_from(data, at)
        if max(abs(x), abs(y)) > 1000 * MAX_COORDINATE_M:
            raise ProtocolError("a frame from out of bounds")
        return AskViews(tick, (x / 1000, y / 1000, angle_of(turn)))
    if flags:
        raise ProtocolError("a message about viewpoints that is none")
    back, at = take_varint(data, at)
    if not 0 < back <= tick:
        raise ProtocolError("viewpoints of the future")
    reader = BitReader(data[at:])
    count = reader.number(_COUNT)
    if not 0 < count <= MAX_VIEWPOINTS:
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
    reader.finish()
    return Views(tick - back, tick, np.array(cells, np.int64))


class Looked(NamedTuple):
    """Where a robot itself has looked from."""

    ticks: Sequence[int] = ()  # (k,) rising: when it was there
    places: Sequence[tuple[float, float]] = ()  # (k,) metres, its own frame

    def between(self, since: int, until: int, mtu: int) -> Views | None:
        """What there is to tell in a message of at most mtu bytes, the oldest first; None without anything.

        A robot that began anew after `since` tells all.
        """
        if since and self.ticks and since < self.ticks[0]:
            since = 0
        known = since or -1
        chosen = [k for k, tick in enumerate(self.ticks) if known < tick <= until][:MAX_VIEWPOINTS]
        while chosen and self.ticks[chosen[-1]] > 0:
            cells = np.round(np.array([self.places[k] for k in chosen]) / CELL_M).astype(np.int64)
            views = Views(since, self.ticks[chosen[-1]], cells)
            if len(views.encode()) <= mtu:
                return views
            chosen = chosen[: len(chosen) // 2]
        return None


NOWHERE = Looked()
