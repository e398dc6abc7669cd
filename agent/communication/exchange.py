"""What robots tell each other over a radio that loses messages; of maps the whole first, later what changed (ours).

Each peer is told the changes to the map that it last acknowledged, and nothing while it has all. A version of a map
is the tick at which it was so. Both sides keep the maps that the other may still refer to.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple

from agent.communication.config import TalkConfig
from agent.communication.receiving import KEPT_MAPS, Known, PeerViews, ReceivedMap
from protocol.errors import ProtocolError
from protocol.frames import FRAMES, ToldFrames, in_messages
from protocol.geometry import Pose
from protocol.grid_map import AXIS_STEPS, GridMap, main_axis, quantise
from protocol.map_codec import Coded, encode_map
from protocol.messages import EVERYONE, Event, Heard, Send
from protocol.talk import ACK, BEACON, DELTA, MAP, MAX_SENDS, RESEND, Ack, Beacon, Part, in_parts
from protocol.viewpoints import NOWHERE, VIEWS, AskViews, Looked, Views, decode_views
from protocol.wireframe import Wireframe

NOBODY: Mapping[str, Pose] = MappingProxyType({})
NEVER = -(10**9)
"""A tick long ago."""
MOST_DOUBLINGS = 3
"""How often the wait for an acknowledgement doubles at most."""
WHOLE_BYTES = 1.0
"""A whole map takes more than this a vertex (2.0 measured), so shorter changes are not compared with it."""
REASSEMBLY_S = 30.0
"""Parts of a map wait this long for the next part: three retries."""
SLACK_CELLS = 1.5
"""A corner that moved by fewer cells of the grid is not news: most corners still shift by millimetres a minute."""
SLACK_LEVELS = 2
"""A wall's likelihood that changed by less than this, in sevenths, is not news."""
AXIS_SLACK_DEG = 1.0
"""The grid is turned anew where the map's main axis is off by more: a wall of 1.2 m then costs 6 bits more."""
MOST_FROM_PEER = 80
"""Messages of one peer that are read in a tick (ours): all parts of a map, and some more. An honest peer sends 3."""
MOST_ANSWERS = 8
"""Maps of one peer that are acknowledged in a tick, the newest ones; else it could use up what a robot may say."""
TOLD_IN_TURN = 3
"""Peers in contact beyond which updates of the map come less often: a robot tells so many of them in a period. Of 30
robots in a maze of 40 m eight go about together once the map is whole, and have the same news from each other."""
MOST_TRIES = 10
"""A newer map waits until an older one in several parts is acknowledged, or was sent this often: else none arrives."""
KINDS = frozenset((BEACON, MAP, DELTA, RESEND, ACK, VIEWS, FRAMES))
"""What is read. Robots with other programs may say other things on the same air, to each other."""


@dataclass(slots=True)
class Contact:
    """A peer within radio range: known by its messages alone, never by a list from the truth."""

    since: int
    """Tick of the first message after silence."""
    last: int
    """Tick of the newest message."""


class News(NamedTuple):
    """What a peer told in this tick."""

    peer: str
    since: int
    """Tick at which the contact with it began."""
    beacon: Beacon | None = None
    map: ReceivedMap | None = None
    """A newer map; at the beginning of a contact also the map that is known from an earlier one."""
    views: PeerViews | None = None
    """All its viewpoints, where new ones came."""
    frame: Pose | None = None
    """Where it says that the robot's own frame lies in its frame, where it has merged the robot's map."""
    others: Mapping[str, Pose | None] = NOBODY
    """Where it says that the frames of others lie in its own; None of whom it has taken that back."""


@dataclass
class Told:
    """What a peer was told of the robot's own map."""

    acked: int = 0
    """Version that it has; 0: none."""
    maps: dict[int, GridMap] = field(default_factory=dict)
    """By version: the one that it has, and those that it was told since."""
    whole: list[Part] = field(default_factory=list)
    """All parts of the newest update."""
    parts: list[Part] = field(default_factory=list)
    """Those of them that are not acknowledged."""
    sent: int = NEVER
    """Tick at which parts were last sent."""
    update: int = NEVER
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
    frames: dict[str, tuple[bool, int]] = field(default_factory=dict)
    """Of each peer: whether its frame was told or taken back, and the beacons' periods since, in this contact."""

    def take_due_frames(self, names: Iterable[str], frames: Mapping[str, Pose]) -> list[str]:
        """Of whom the frame, or that there is none any more, is to be told: at once, and 1, 3, 7, ... periods later.

        Counts a period.
        """
        due = []
        for name in sorted(names):
            held, periods = self.frames.get(name, (False, 0))
            periods = periods + 1 if held == (name in frames) else 1
            self.frames[name] = name in frames, periods
            if periods & (periods - 1) == 0:
                due.append(name)
        return due

    def take_ack(self, ack: Ack) -> None:
        """Note what the peer has, or lacks."""
        if ack.version not in self.maps:
            return  # an answer to an earlier process of this name, or to a version given up since
        if ack.missing is None:  # the peer has lost its base: the whole map goes again
            self.maps, self.acked, self.whole, self.parts, self.compared, self.current = {}, 0, [], [], -1, 0
        elif ack.missing:
            if self.parts and self.parts[0].version == ack.version:  # else another map is on its way by now
                self.parts = [p for p in self.whole if p.number in ack.missing]  # it may have given up some it had
        elif ack.version > self.acked:
            self.acked, self.current, self.tries = ack.version, max(self.current, ack.version), 0
            self.maps = {version: one for version, one in self.maps.items() if version >= ack.version}
            self.parts = [p for p in self.parts if p.version > ack.version]


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


class Exchange:
    """One robot's part of all that is told and heard."""

    def __init__(self, config: TalkConfig, rate_hz: float, mtu_bytes: int) -> None:
        """rate_hz: ticks a second. mtu_bytes: the longest message that the radio carries."""
        self.config, self.mtu_bytes = config, mtu_bytes
        self.contacts: dict[str, Contact] = {}
        """Peers heard lately, in the order in which their contacts began: C of Algorithm 1."""
        self._told: defaultdict[str, Told] = defaultdict(Told)
        self._known: defaultdict[str, Known] = defaultdict(Known)
        self._news: MapNews | None = None
        """Of the map that was told last."""
        self._answers: list[tuple[str, Ack, int]] = []
        """Acknowledgements due: to whom, what, and how many parts there are."""
        self._events: list[Event] = []
        """What happened while talking."""
        self._asked_since: dict[str, int] = {}
        """Who wants to know where the robot looked from, and since when."""
        self._refused: dict[str, int] = {}
        """Tick at which a peer's refusal was last told."""
        self._beacon_due = False
        self._silence_ticks = round(config.silence_s * rate_hz)
        waits_s = config.beacon_s, config.sight_beacon_s, config.map_period_s, config.retry_s, REASSEMBLY_S
        ticks = [max(1, round(wait_s * rate_hz)) for wait_s in waits_s]
        self._beacon_ticks, self._sight_ticks, self._period_ticks, self._retry_ticks, self._patience_ticks = ticks

    def hear(self, tick: int, heard: Sequence[Heard]) -> tuple[list[News], list[Event]]:
        """Take a tick's messages: news, one of each peer that said something, in the order of `contacts`.

        Events are `contact`, `lost`, `refused` and the last talk's `untold`. A bad message makes no contact.
        One of a kind that is not ours is passed over.
        """
        events, self._events = self._events, []
        refused: dict[str, str] = {}
        news: dict[str, News] = {}
        count: Counter[str] = Counter()
        for message in heard:
            peer = message.sender
            if message.kind not in KINDS:
                continue
            if peer in refused:
                continue  # nor is the rest read of what it says in this tick
            count[peer] += 1
            if count[peer] > MOST_FROM_PEER:
                refused[peer] = f"more than {MOST_FROM_PEER} messages in a tick"
                continue
            try:
                said = self._take(tick, peer, message)
            except ProtocolError as error:
                refused[peer] = str(error)
                continue
            if peer not in self.contacts:
                self.contacts[peer] = Contact(tick, tick)
                events.append(Event(event="contact", data={"peer": peer}))
                news[peer] = News(peer, tick, map=self._known[peer].map())
                self._beacon_due = True
                told = self._told[peer]
                told.frames = {}
                told.sent, told.tries = NEVER, 0  # what did not arrive before is sent again at once
            self.contacts[peer].last = tick
            one = news.get(peer) or News(peer, self.contacts[peer].since)
            match said:
                case Beacon():
                    one = one._replace(beacon=said)
                case ReceivedMap():
                    one = one._replace(map=said)
                case PeerViews():
                    one = one._replace(views=said)
                case AskViews():
                    one = one._replace(frame=said.frame or one.frame)
                case ToldFrames():
                    one = one._replace(others={**one.others, **said.of})
            news[peer] = one
        for peer, why in refused.items():  # not in each tick, as there is room for so many events only
            if tick - self._refused.get(peer, NEVER) >= self._period_ticks:
                self._refused[peer] = tick
                events.append(Event(event="refused", data={"peer": peer, "reason": why}))
        lost = [peer for peer, contact in self.contacts.items() if tick - contact.last > self._silence_ticks]
        events += [Event(event="lost", data={"peer": peer}) for peer in lost]
        self.contacts = {peer: contact for peer, contact in self.contacts.items() if peer not in lost}
        return [news[peer] for peer in self.contacts if peer in news], events

    def _take(
        self, tick: int, peer: str, message: Heard
    ) -> Beacon | ReceivedMap | PeerViews | AskViews | ToldFrames | None:
        """What a message of one of our KINDS tells that is new; raises ProtocolError for a bad one."""
        if message.kind == BEACON:
            return Beacon.decode(message.payload)
        if message.kind in (MAP, DELTA, RESEND):
            part = Part.decode(message.payload)
            ack, new = self._known[peer].take_part(tick, part, self._patience_ticks, self._period_ticks)
            if ack is not None:  # of the answers to one version, the last one goes
                self._answers = [due for due in self._answers if (due[0], due[1].version) != (peer, ack.version)]
                self._answers.append((peer, ack, part.parts))
                theirs = [due for due in self._answers if due[0] == peer]
                if len(theirs) > MOST_ANSWERS:
                    self._answers.remove(theirs[0])
            return new
        if message.kind == ACK:
            self._told[peer].take_ack(Ack.decode(message.payload))
            return None
        if message.kind == VIEWS:
            views = decode_views(message.payload)
            if isinstance(views, Views):
                return self._known[peer].take_views(views)
            self._asked_since[peer] = views.since
            return views
        assert message.kind == FRAMES, message.kind
        return ToldFrames.decode(message.payload)

    def talk(
        self,
        tick: int,
        pose: Pose,
        told_to: Callable[[str], Wireframe],
        told_version: int,
        looked: Looked = NOWHERE,
        frames: Mapping[str, Pose] = NOBODY,
        in_sight: bool = False,
        asks: bool = False,
    ) -> list[Send]:
        """What to send at this tick: beacon, acknowledgements, and to each peer what it does not have.

        pose: the robot's own. told_to: the map for a peer. told_version: a number that changes whenever one of these
        maps may have. looked: where it looked from, for those that ask. frames: the transform of each merged
        peer, of which that peer and the others are told. in_sight: a peer may be in sight, and so see the robot, too,
        and one of the two does not know the other's frame; beacons come sooner then. asks: whether peers are asked for
        their viewpoints, once a beacon's period.
        """
        sends = []
        period = self._sight_ticks if in_sight else self._beacon_ticks
        if self._beacon_due or tick % period == 0 or tick % self._beacon_ticks == 0:
            sends.append(Send(tick=tick, to=EVERYONE, kind=BEACON, payload=Beacon(tick, pose).encode()))
        self._beacon_due = False
        sends += [Send(tick=tick, to=to, kind=ACK, payload=ack.encode(count)) for to, ack, count in self._answers]
        self._answers = []
        for peer in self.contacts:
            kind, parts = self._due(tick, peer, told_to, told_version)
            sends += [Send(tick=tick, to=peer, kind=kind, payload=part.encode()) for part in parts]
        sends += self._views_to_tell(tick, told_version, looked)
        if tick % self._beacon_ticks == 0:
            for peer in self.contacts:
                sends += self._questions(tick, peer, frames) if asks else []
                sends += self._frames_to_tell(tick, peer, frames)
        return sends[:MAX_SENDS]

    def _views_to_tell(self, tick: int, told_version: int, looked: Looked) -> list[Send]:
        """To those that ask. Nobody is told of a viewpoint before it has the map of what was seen from there."""
        sends = []
        for peer, since in self._asked_since.items():
            told = self._told[peer]
            if not told.parts and told.compared == told_version:
                told.current = tick
            views = looked.between(since, told.current, self.mtu_bytes, peer)
            if views is not None:
                sends.append(Send(tick=tick, to=peer, kind=VIEWS, payload=views.encode()))
        self._asked_since = {}
        return sends

    def _questions(self, tick: int, peer: str, frames: Mapping[str, Pose]) -> list[Send]:
        """To a peer whose map is known, for its viewpoints: once it is merged, contact with it may be over."""
        known = self._known[peer]
        if not known.maps:
            return []
        frame = frames.get(peer) if self._told[peer].take_due_frames([peer], frames) else None
        known.views_asked = True
        return [Send(tick=tick, to=peer, kind=VIEWS, payload=AskViews(known.views_until, frame).encode())]

    def _frames_to_tell(self, tick: int, peer: str, frames: Mapping[str, Pose]) -> list[Send]:
        """To a merged peer, the frames of all others."""
        if peer not in frames:
            return []
        told = self._told[peer]
        names = told.take_due_frames((frames.keys() | told.frames.keys()) - {peer}, frames)
        some = in_messages({name: frames.get(name) for name in names}, self.mtu_bytes)
        return [Send(tick=tick, to=peer, kind=FRAMES, payload=one.encode()) for one in some]

    def _due(
        self, tick: int, peer: str, told_to: Callable[[str], Wireframe], told_version: int
    ) -> tuple[str, list[Part]]:
        """Kind and parts of the next update to a peer, or those that were not acknowledged in time."""
        told = self._told[peer]
        late = tick - told.sent >= self._retry_ticks << min(told.tries, MOST_DOUBLINGS)
        if told.parts and not late:
            return RESEND, []
        half_there = len(told.parts) > 0 and told.parts[0].parts > 1 and told.tries < MOST_TRIES
        period = self._period_ticks * max(TOLD_IN_TURN, len(self.contacts)) // TOLD_IN_TURN
        if told.compared != told_version and not half_there and tick - told.update >= period:
            told.compared = told_version
            try:
                parts, told.untold = self._update(tick, told, told_to(peer)), ""
            except ProtocolError as error:
                if not told.untold:
                    self._events.append(Event(event="untold", data={"peer": peer, "reason": str(error)}))
                parts, told.untold = [], str(error)
            if parts:
                told.tries = told.tries + 1 if told.parts else 0
                told.whole, told.parts, told.sent, told.update = parts, parts, tick, tick
                return DELTA if parts[0].base else MAP, parts
        if told.parts:
            told.tries += 1
            told.sent = tick
        return RESEND, list(told.parts)

    def _update(self, tick: int, told: Told, wireframe: Wireframe) -> list[Part]:
        """The parts that bring a peer up to date; none where it is, or where that is on its way.

        Raises ProtocolError where the map or its parts exceed what a message may hold.
        """
        config = self.config
        axis = main_axis(wireframe)
        slack = AXIS_SLACK_DEG / 90 * AXIS_STEPS
        if told.axis is None or abs((axis - told.axis + AXIS_STEPS // 2) % AXIS_STEPS - AXIS_STEPS // 2) > slack:
            told.axis = axis
        base = told.maps.get(told.acked)
        if base is not None and base.axis != told.axis:
            base = None
        if self._news is None or not self._news.are_of(wireframe, told.axis, base):
            new = quantise(wireframe, config.cell_mm, told.axis, base, SLACK_CELLS, SLACK_LEVELS)
            self._news = MapNews(wireframe, told.axis, base, new, config.likelihoods)
        new = self._news.new
        if (new.alike(base) and not told.parts) if base is not None else not len(new.cells):
            return []
        coded, is_whole = self._news.coded()
        version = 0 if is_whole else told.acked
        pending = told.maps.get(told.parts[0].version) if told.parts else None
        if pending is not None and pending.alike(coded.map):
            return []
        parts = in_parts(tick, version, coded.data, self.mtu_bytes)
        told.maps[tick] = coded.map
        for old in sorted(told.maps.keys() - {told.acked})[:-KEPT_MAPS]:
            del told.maps[old]
        return parts
