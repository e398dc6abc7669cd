"""The map that one peer was told, and the parts of the next update: all of it, or what changed since (ours)."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from agent.communication.config import TalkConfig
from agent.communication.receiving import KEPT_MAPS
from agent.geometry.transform import DISTINCT_M, DISTINCT_RAD, apart
from protocol.geometry import Pose
from protocol.grid_map import AXIS_STEPS, GridMap, main_axis, quantise
from protocol.map_codec import Coded, encode_map
from protocol.talk import HAS_NO_MAP, Ack, Part, in_parts
from protocol.wireframe import Wireframe

LONG_AGO = -(10**9)
"""A tick long ago."""
WHOLE_BYTES = 1.0
"""A whole map takes more than this a vertex (2.0 measured), so shorter changes are not compared with it."""
SLACK_CELLS = 1.5
"""A corner that moved by fewer cells of the grid is not news: most corners still shift by millimetres a minute."""
SLACK_LEVELS = 2
"""A wall's likelihood that changed by less than this, in sevenths, is not news."""
AXIS_SLACK_DEG = 1.0
"""The grid is turned anew where the map's main axis is off by more: a wall of 1.2 m then costs 6 bits more."""


@dataclass
class Told:
    """What a peer was told of the robot's own map."""

    acked: int = 0
    """Version that it has; 0: none."""
    acked_since: int = LONG_AGO
    """Tick since which it has some version."""
    maps: dict[int, GridMap] = field(default_factory=dict)
    """By version: the one that it has, and those that it was told since."""
    as_changes: set[int] = field(default_factory=set)
    """Those of these versions that it was told as changes."""
    whole: list[Part] = field(default_factory=list)
    """All parts of the newest update."""
    parts: list[Part] = field(default_factory=list)
    """Those of them that are not acknowledged."""
    sent: int = LONG_AGO
    """Tick at which parts were last sent."""
    update: int = LONG_AGO
    """Tick of the newest update."""
    tries: int = 0
    """How often the newest update was sent again, or replaced, without an acknowledgement."""
    compared: int = -1
    """State of the robot's map that was last compared with what the peer has, or is being told."""
    untold: str = ""
    """Why the last update could not be sent; empty where it could."""
    axis: int | None = None
    """Direction of the grid of its maps, in steps of AXIS_STEPS a quarter turn."""
    current: int = 0
    """Tick until which it has all that was seen."""
    frames: dict[str, tuple[Pose | None, int]] = field(default_factory=dict)
    """Of each other: where its frame was told to lie, None where that was taken back, and beacons' periods since."""

    def tell_frames_anew(self) -> None:
        """All of them are told, or taken back, with the next beacon."""
        self.frames = {name: (told, 0) for name, (told, _) in self.frames.items()}

    def take_due_frames(self, names: Iterable[str], frames: Mapping[str, Pose]) -> list[str]:
        """Of whom the frame, or that there is none any more, is to be told: at once, and 1, 3, 7, ... periods later.

        A frame that contradicts the one told is told at once, too. Counts a period.
        """
        due = []
        for name in sorted(names):
            now, (told, periods) = frames.get(name), self.frames.get(name, (None, 0))
            periods = 1 if _contradict(now, told) else periods + 1
            if periods & (periods - 1) == 0:
                due.append(name)
                told = now
            self.frames[name] = told, periods
        return due

    def take_ack(self, tick: int, ack: Ack, late_ticks: int) -> bool:
        """Note what the peer has, or lacks; true where it has nothing more of what it had, as it began anew.

        late_ticks: how long after its first answer it may seem to have nothing, by a message that is late. If it has
        begun anew it says so again. Later answers do not matter, as who has a map never says again that it has none.
        """
        may_be_late = tick - self.acked_since <= late_ticks
        has_begun_anew = ack == HAS_NO_MAP and self.acked > 0 and not self.parts and not may_be_late
        if ack.version not in self.maps and not has_begun_anew:
            return False  # an answer to an earlier process of this name, or to a version given up since
        if ack.missing is None and not has_begun_anew and ack.version not in self.as_changes:
            return False  # who is told the whole needs no base
        if ack.missing is None:  # the peer has lost its base: the whole map goes again
            self.maps, self.acked, self.whole, self.parts, self.compared, self.current = {}, 0, [], [], -1, 0
        elif ack.missing:
            if self.parts and self.parts[0].version == ack.version:  # else another map is on its way by now
                self.parts = [p for p in self.whole if p.number in ack.missing]  # it may have given up some it had
        elif ack.version > self.acked:
            self.acked_since = self.acked_since if self.acked else tick
            self.acked, self.current, self.tries = ack.version, max(self.current, ack.version), 0
            self.maps = {version: one for version, one in self.maps.items() if version >= ack.version}
            self.parts = [p for p in self.parts if p.version > ack.version]
        return ack.missing is None


def _contradict(one: Pose | None, other: Pose | None) -> bool:
    """Whether two words on a frame, None for that there is none, are not the same."""
    if one is None or other is None:
        return one is not other
    return bool(apart(np.array(one), np.array(other), np.zeros(2), DISTINCT_M, DISTINCT_RAD))


class MapNews:
    """A map for all peers that have the same base, as those that were told the same since their contacts began."""

    def __init__(self, wireframe: Wireframe, axis: int, base: GridMap | None, new: GridMap, likelihoods: bool) -> None:
        """new: the wireframe on the grid of an axis, as what has changed since a base, if there is one.

        likelihoods: whether walls are told with theirs.
        """
        self._of, self._axis, self._base, self.new, self._likelihoods = wireframe, axis, base, new, likelihoods
        self._coded: tuple[Coded, bool] | None = None

    def are_of(self, wireframe: Wireframe, axis: int, base: GridMap | None) -> bool:
        """Whether they are of this very map, in the same form."""
        return self._of is wireframe and self._base is base and self._axis == axis

    def coded(self) -> tuple[Coded, bool]:
        """The shorter one of the changes and the whole map; and whether that is the whole."""
        if self._coded is None:
            coded, whole = encode_map(self.new, self._base, likelihoods=self._likelihoods), self._base is None
            if not whole and len(coded.data) > WHOLE_BYTES * len(self.new.cells):
                other = encode_map(self.new, likelihoods=self._likelihoods)
                if len(other.data) <= len(coded.data):
                    coded, whole = other, True
            self._coded = coded, whole
        return self._coded


class Telling:
    """What brings peers up to date with the robot's map. Peers that have the same share the work."""

    def __init__(self, config: TalkConfig, mtu_bytes: int) -> None:
        """mtu_bytes: of the radio."""
        self._config, self._mtu_bytes = config, mtu_bytes
        self._news: MapNews | None = None
        """Of the map that was told last."""

    def update(self, tick: int, told: Told, wireframe: Wireframe) -> list[Part]:
        """The parts that bring a peer up to date; none where it is, or where that is on its way.

        Raises ProtocolError where the map or its parts exceed what a message may hold.
        """
        config = self._config
        axis = main_axis(wireframe)
        slack = AXIS_SLACK_DEG / 90 * AXIS_STEPS
        if told.axis is None or abs((axis - told.axis + AXIS_STEPS // 2) % AXIS_STEPS - AXIS_STEPS // 2) > slack:
            told.axis = axis
        base = told.maps.get(told.acked)
        if base is not None and base.axis != told.axis:
            base = None
        if self._news is None or not self._news.are_of(wireframe, told.axis, base):
            likelihood = wireframe.likelihood if config.likelihoods else np.ones_like(wireframe.likelihood)
            as_told = replace(wireframe, likelihood=likelihood)
            new = quantise(as_told, config.cell_mm, told.axis, base, SLACK_CELLS, SLACK_LEVELS)
            self._news = MapNews(wireframe, told.axis, base, new, config.likelihoods)
        new = self._news.new
        if (new.alike(base) and not told.parts) if base is not None else not len(new.cells):
            return []
        coded, is_whole = self._news.coded()
        version = 0 if is_whole else told.acked
        pending = told.maps.get(told.parts[0].version) if told.parts else None
        if pending is not None and pending.alike(coded.map):
            return []
        parts = in_parts(tick, version, coded.data, self._mtu_bytes)
        told.maps[tick] = coded.map
        for old in sorted(told.maps.keys() - {told.acked})[:-KEPT_MAPS]:
            del told.maps[old]
        told.as_changes = {one for one in told.as_changes if one in told.maps} | ({tick} if version else set())
        return parts
