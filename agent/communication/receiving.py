"""The maps and viewpoints of one peer, from messages that may be lost, late or doubled."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from protocol.arrays import Bools, Floats, Ints
from protocol.errors import ProtocolError
from protocol.grid_map import GridMap
from protocol.map_codec import decode_map
from protocol.talk import MAX_BODY, Ack, Part
from protocol.viewpoints import Views
from protocol.wireframe import Wireframe

KEPT_MAPS = 8
"""Versions of one peer's map that are kept beside its base: one on its way, and those of time-outs in between."""
MAPS_AT_ONCE = 2
"""Periods' worth of maps that a peer may send at once, and later two a period (ours): reading one takes up to 40 ms."""
KEPT_VIEWS = 6000
"""Viewpoints of one peer that are kept, the newest (24 bytes each): 3 km of path. A robot that knows more passes on no
others' (48 bytes each)."""
KEPT_ENDS = 400
"""Open ends of one peer that are kept, the newest (32 bytes each): as many goals as a robot remembers."""
CLOCK_S = 60.0
"""Who says where it was so long before its newest map had its clock put back, or a radio has so much jitter: then the
map is told again. Where the clock was put back by less, the next map that is newer counts."""


class ReceivedMap(NamedTuple):
    """The map of a peer, at a moment."""

    wireframe: Wireframe
    """In the peer's own frame."""
    tick: int
    """When the peer's map was so."""


class PeerViews(NamedTuple):
    """Where a peer has looked from, or knows that others have."""

    points: Floats = np.zeros((0, 2))
    """(k, 2) metres, the peer's own frame."""
    need: Ints = np.zeros(0, np.int64)
    """(k,) tick of the peer's map that holds what was seen from there."""
    heard: Bools = np.zeros(0, np.bool_)
    """(k,) whether others looked from there, whose maps the peer has merged."""
    ends: Floats = np.zeros((0, 4))
    """(g, 4) metres and unit, the peer's own frame: open ends that it looked at in vain, and where the walls go on."""
    editions: int = 0
    """How often the peer has told all anew, as some of it no longer held."""
    forgotten: tuple[int, int] = (0, 0)
    """Of this edition's viewpoints, how many the peer's own and from others are kept no more, the oldest ones."""


@dataclass
class Arriving:
    """Parts of a map that is not whole yet."""

    version: int
    base: int
    count: int
    last: int
    """Tick of the newest part."""
    bodies: dict[int, bytes] = field(default_factory=dict)
    """Payload of each part that came, by its number."""


@dataclass
class Known:
    """What a peer told of its map."""

    maps: dict[int, GridMap] = field(default_factory=dict)
    """By version: the newest, and those that it may still tell changes to."""
    map_tick: int = 0
    """When the newest was so: its version, or when it came, as nobody's map is of the future."""
    arriving: Arriving | None = None
    views: PeerViews = field(default_factory=PeerViews)
    views_asked: bool = False
    """Whether a question for viewpoints waits for its answer; what nobody asked for is not taken."""
    map_due: float = -math.inf
    """Tick from which the next map is in time, if its peer keeps to its period."""
    views_until: int = 0
    """Tick of the last viewpoint that it told."""

    @property
    def newest(self) -> int:
        """Version of its map as known; 0: none."""
        return max(self.maps, default=0)

    @property
    def is_empty(self) -> bool:
        """Whether neither a map of it is there nor a part of one."""
        return not self.maps and self.arriving is None

    def take_clock(self, tick: int, slack_ticks: int) -> None:
        """Note the tick of a place that it told, and forget maps and viewpoints of more than slack_ticks later.

        They are of its process before, by another clock. Beside them all that it tells now would seem overtaken.
        """
        if max(self.newest, self.views_until) > tick + slack_ticks:
            self.maps, self.arriving, self.views_until = {}, None, 0

    def take_part(
        self, tick: int, part: Part, patience_ticks: int, period_ticks: int
    ) -> tuple[Ack | None, ReceivedMap | None]:
        """Keep a part: the answer that it needs, and the map once it is whole.

        Parts of a map that waited for longer than patience_ticks are given up. Maps that come much more often than
        every period_ticks are not read; an honest peer sends them again. Raises ProtocolError for a part that does
        not fit the others, and for a map that is too large or that cannot be read.
        """
        if part.version in self.maps:
            return Ack(part.version), None
        if part.version < self.newest:
            return None, None  # overtaken by a newer one
        if part.base and part.base not in self.maps:
            return Ack(part.version, None), None
        arriving = self.arriving
        if arriving is not None and tick - arriving.last > patience_ticks:
            arriving = None
        if arriving is not None and part.version < arriving.version:
            return None, None
        if arriving is None or part.version > arriving.version:
            arriving = Arriving(part.version, part.base, part.parts, tick)
        elif (arriving.base, arriving.count) != (part.base, part.parts):
            raise ProtocolError("two parts of one map that do not fit each other")
        bodies = arriving.bodies | {part.number: part.body}
        if sum(map(len, bodies.values())) > MAX_BODY:
            raise ProtocolError(f"a map of more than {MAX_BODY} bytes")
        arriving.bodies, arriving.last = bodies, tick
        self.arriving = arriving
        if missing := frozenset(range(arriving.count)) - bodies.keys():
            return Ack(part.version, missing), None
        self.arriving = None
        if tick < self.map_due - MAPS_AT_ONCE * period_ticks:
            raise ProtocolError("maps in too quick succession")
        self.map_due = max(self.map_due, tick) + 0.5 * period_ticks
        body = b"".join(bodies[index] for index in range(arriving.count))
        whole = decode_map(body, self.maps[part.base] if part.base else None)
        kept = {version: old for version, old in self.maps.items() if version >= part.base} | {part.version: whole}
        for old in sorted(kept.keys() - {part.base})[:-KEPT_MAPS]:  # without its base it would seem to have begun anew
            del kept[old]
        self.maps = kept
        self.map_tick = min(part.version, tick)
        return Ack(part.version), ReceivedMap(whole.wireframe(), self.map_tick)

    def take_views(self, views: Views) -> PeerViews | None:
        """Add viewpoints; all of them, or None where the message came twice or late."""
        if not self.views_asked or views.until <= self.views_until or views.since not in (0, self.views_until):
            return None  # what is missing will be asked for
        self.views_asked = False
        old = self.views if views.since else PeerViews(editions=self.views.editions + 1)
        points = np.vstack((old.points, views.points))[-KEPT_VIEWS:]
        need = np.concatenate((old.need, np.full(len(views.points), self.map_tick)))[-KEPT_VIEWS:]
        heard = np.concatenate((old.heard, np.arange(len(views.points)) >= len(views.cells)))
        from_others, cut = int(heard[:-KEPT_VIEWS].sum()), max(len(heard) - KEPT_VIEWS, 0)
        forgotten = old.forgotten[0] + cut - from_others, old.forgotten[1] + from_others
        ends = np.vstack((old.ends, views.ends))[-KEPT_ENDS:]
        self.views = PeerViews(points, need, heard[-KEPT_VIEWS:], ends, old.editions, forgotten)
        self.views_until = views.until
        return self.views
