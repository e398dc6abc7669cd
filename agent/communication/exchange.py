"""What robots tell each other over a radio that loses messages; of maps the whole first, later what changed (ours).

Each peer is told the changes to the map that it last acknowledged, and nothing while it has all. A version of a map
is the tick at which it was so. Both sides keep the maps that the other may still refer to.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

from agent.communication.config import TalkConfig
from agent.communication.receiving import CLOCK_S, Known, PeerViews, ReceivedMap
from agent.communication.telling import LONG_AGO, Telling, Told
from agent.period import Period, in_ticks
from protocol.errors import ProtocolError
from protocol.frames import FRAMES, ToldFrames, in_messages
from protocol.geometry import Pose
from protocol.messages import EVERYONE, Event, Heard, Send
from protocol.talk import ACK, BEACON, DELTA, HAS_NO_MAP, MAP, MAX_SENDS, RESEND, Ack, Beacon, Part
from protocol.viewpoints import NOWHERE, VIEWS, AskViews, Looked, Views, decode_views
from protocol.wireframe import Wireframe

NOBODY: Mapping[str, Pose] = MappingProxyType({})
MOST_DOUBLINGS = 3
"""How often the wait for an acknowledgement doubles at most."""
REASSEMBLY_S = 30.0
"""Parts of a map wait this long for the next part: three retries."""
LATE_S = 5.0
"""Messages are taken to be under way for no longer, nor for longer than the silence after which a contact begins. More
latency than that (settings allow it) may still look like a restart."""
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
    """Tick of the first message after silence, or of that by which the peer has begun anew."""
    last: int
    """Tick of the newest message."""


class BegunAnew(NamedTuple):
    """The word of a peer that it has no map of the robot any more."""

    since: int
    """Tick from which on its maps may be those of its new process."""


class News(NamedTuple):
    """What a peer told in this tick."""

    peer: str
    since: int
    """Tick at which the contact with it began."""
    beacon: Beacon | None = None
    map: ReceivedMap | None = None
    """A newer map."""
    views: PeerViews | None = None
    """All its viewpoints, where new ones came."""
    frame: Pose | None = None
    """Where it says that the robot's own frame lies in its frame, where it has merged the robot's map."""
    others: Mapping[str, Pose | None] = NOBODY
    """Where it says that the frames of others lie in its own; None of whom it has taken that back."""
    anew: int | None = None
    """Where it says that it has begun anew: the tick from which on its maps may be those of its new process. It may go
    on from a checkpoint, in the same frame, or begin in another one."""


class Exchange:
    """One robot's part of all that is told and heard."""

    def __init__(self, config: TalkConfig, rate_hz: float, mtu_bytes: int, wants_maps: bool = False) -> None:
        """rate_hz: ticks a second. mtu_bytes: the longest message that the radio carries.

        wants_maps: whether a peer in contact of whose map nothing is there is told so, once a beacon's period. It may
        have told it before the robot began anew.
        """
        self.mtu_bytes, self._wants_maps = mtu_bytes, wants_maps
        self.contacts: dict[str, Contact] = {}
        """Peers heard lately, in the order in which their contacts began: C of Algorithm 1."""
        self._told: defaultdict[str, Told] = defaultdict(Told)
        self._known: defaultdict[str, Known] = defaultdict(Known)
        self._telling = Telling(config, mtu_bytes)
        self._answers: list[tuple[str, Ack, int]] = []
        """Acknowledgements due: to whom, what, and how many parts there are."""
        self._events: list[Event] = []
        """What happened while talking."""
        self._asked_since: dict[str, int] = {}
        """Who wants to know where the robot looked from, and since when."""
        self._refused: dict[str, int] = {}
        """Tick at which a peer's refusal was last told."""
        self._beacon_due = False
        self._beacons = Period(in_ticks(config.beacon_s, rate_hz))
        self._sight_beacons = Period(in_ticks(config.sight_beacon_s, rate_hz))
        self._silence_ticks = in_ticks(config.silence_s, rate_hz)
        self._late_ticks = in_ticks(min(config.silence_s, LATE_S), rate_hz)
        self._period_ticks = in_ticks(config.map_period_s, rate_hz)
        self._retry_ticks = in_ticks(config.retry_s, rate_hz)
        self._patience_ticks = in_ticks(REASSEMBLY_S, rate_hz)
        self._clock_ticks = in_ticks(CLOCK_S, rate_hz)

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
                self._beacon_due = True
                told = self._told[peer]
                told.tell_frames_anew()
                told.sent, told.tries = LONG_AGO, 0  # what did not arrive before is sent again at once
            self.contacts[peer].last = tick
            one = news.get(peer, News(peer, tick))._replace(since=self.contacts[peer].since)
            match said:
                case Beacon() if one.beacon is None or said.tick >= one.beacon.tick:
                    one = one._replace(beacon=said)
                case ReceivedMap():
                    one = one._replace(map=said)
                case PeerViews():
                    one = one._replace(views=said)
                case AskViews():
                    one = one._replace(frame=said.frame or one.frame)
                case ToldFrames():
                    one = one._replace(others={**one.others, **said.of})
                case BegunAnew():
                    one = one._replace(anew=said.since)
            news[peer] = one
        for peer, why in refused.items():  # not in each tick, as there is room for so many events only
            if tick - self._refused.get(peer, LONG_AGO) >= self._period_ticks:
                self._refused[peer] = tick
                events.append(Event(event="refused", data={"peer": peer, "reason": why}))
        lost = [peer for peer, contact in self.contacts.items() if tick - contact.last > self._silence_ticks]
        events += [Event(event="lost", data={"peer": peer}) for peer in lost]
        self.contacts = {peer: contact for peer, contact in self.contacts.items() if peer not in lost}
        return [news[peer] for peer in self.contacts if peer in news], events

    def tell_frames_anew(self) -> None:
        """The robot's map lies otherwise in its frame: peers are told with the next beacon where all frames are now."""
        for told in self._told.values():
            told.tell_frames_anew()

    def _take(
        self, tick: int, peer: str, message: Heard
    ) -> Beacon | ReceivedMap | PeerViews | AskViews | ToldFrames | BegunAnew | None:
        """What a message of one of our KINDS tells that is new; raises ProtocolError for a bad one."""
        if message.kind == BEACON:
            beacon = Beacon.decode(message.payload)
            self._known[peer].take_clock(beacon.tick, self._clock_ticks)
            return beacon
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
            if not self._told[peer].take_ack(tick, Ack.decode(message.payload), self._late_ticks):
                return None
            contact = self.contacts.pop(peer, Contact(tick, tick))  # it knows nothing of the robot: it is met anew
            return BegunAnew(contact.since - self._silence_ticks)
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
        regular, sooner = self._beacons.take_due(tick), self._sight_beacons.take_due(tick)
        if self._beacon_due or regular or (in_sight and sooner):
            sends.append(Send(tick=tick, to=EVERYONE, kind=BEACON, payload=Beacon(tick, pose).encode()))
        self._beacon_due = False
        sends += [Send(tick=tick, to=to, kind=ACK, payload=ack.encode(count)) for to, ack, count in self._answers]
        self._answers = []
        for peer in self.contacts:
            kind, parts = self._due(tick, peer, told_to, told_version)
            sends += [Send(tick=tick, to=peer, kind=kind, payload=part.encode()) for part in parts]
        sends += self._views_to_tell(tick, told_version, looked)
        if regular:
            for peer in self.contacts:
                if self._wants_maps and self._known[peer].is_empty:
                    sends.append(Send(tick=tick, to=peer, kind=ACK, payload=HAS_NO_MAP.encode()))
                sends += self._questions(tick, peer, frames) if asks else []
                sends += self._frames_to_tell(tick, peer, frames)
        return sends[:MAX_SENDS]

    def _views_to_tell(self, tick: int, told_version: int, looked: Looked) -> list[Send]:
        """To those that ask. Nobody is told of a viewpoint before it has the map of what was seen from there."""
        sends = []
        for peer, since in self._asked_since.items():
            told = self._told[peer]
            if not told.parts and not told.untold and told.compared == told_version:
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
        """To a merged peer, the frames of all others; from who is merged no more, what it was told is taken back."""
        told, frames = self._told[peer], frames if peer in frames else NOBODY
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
                parts, told.untold = self._telling.update(tick, told, told_to(peer)), ""
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
