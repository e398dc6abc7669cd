"""Maps from robot to robot over a radio that loses messages: whole at first contact, later what changed (ours).

Each peer is told the changes to the map that it last acknowledged, and nothing while it has all. A version of a map
is the tick at which it was so. Both sides keep the maps that the other may still refer to.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

from agent.communication.config import TalkConfig
from agent.communication.contacts import Contacts
from agent.communication.hearing import Hearing, News, PeerViews, ReceivedMap
from agent.communication.receiving import KEPT_MAPS, Known
from protocol.errors import ProtocolError
from protocol.geometry import Pose
from protocol.grid_map import AXIS_STEPS, GridMap, main_axis, quantise
from protocol.map_codec import encode_map
from protocol.messages import EVERYONE, Event, Heard, Send
from protocol.talk import ACK, BEACON, DELTA, MAP, RESEND, Ack, Beacon, Part, in_parts
from protocol.viewpoints import NOWHERE, VIEWS, AskViews, Looked, Views, decode_views
from protocol.wireframe import Wireframe

NEVER = -(10**9)
"""A tick long ago."""
MOST_DOUBLINGS = 3
"""The wait for an acknowledgement doubles up to eight times the first one."""
WHOLE_BYTES = 1.0
"""A whole map takes more than this a vertex (1.7 measured): shorter changes need no comparison with it."""
REASSEMBLY_S = 30.0
"""Parts of a map wait this long for the next part: three retries."""
SLACK_CELLS = 1.5
"""A corner that moved by less than this, in cells of the grid, is not news. Most corners of a map still shift by
some millimetres a minute."""
SLACK_LEVELS = 2
"""A wall's likelihood that changed by less than this, in sevenths, is not news."""
AXIS_SLACK_DEG = 1.0
"""The grid is turned anew where the map's main axis is off by more. Then a wall of 1.2 m spans 2 cells across, which
costs 3 bits each."""
MOST_TRIES = 10
"""A map in several parts is sent to its end, or so often, before a newer one takes its place: else none arrived."""


@dataclass
class Told:
    """What a peer was told of the robot's own map."""

    acked: int = 0
    """Version that it has; 0: none."""
    maps: dict[int, GridMap] = field(default_factory=dict)
    """By version: the one that it has, and those that it was told since."""
    whole: list[Part] = field(default_factory=list)
    """The last news in all its parts."""
    parts: list[Part] = field(default_factory=list)
    """Those of them that are on their way, and not acknowledged."""
    sent: int = NEVER
    """Tick at which they, or the last ones, were sent."""
    update: int = NEVER
    """Tick of the last news."""
    tries: int = 0
    compared: int = -1
    """State of the robot's map that was last compared with what the peer has, or is being told."""
    untold: str = ""
    """Why the last news could not be told, where it could not."""
    current: int = 0
    """Tick until which it has all that was seen."""

    def take_ack(self, ack: Ack) -> None:
        """Note what the peer has, or lacks."""
        if ack.version not in self.maps:
            return  # of a former life, or of something long ago
        if ack.missing is None:  # it has lost what it once had: all of it again
            self.maps, self.acked, self.whole, self.parts, self.compared, self.current = {}, 0, [], [], -1, 0
        elif ack.missing:
            if self.parts and self.parts[0].version == ack.version:  # else another map is on its way by now
                self.parts = [p for p in self.whole if p.number in ack.missing]  # it may have given up some it had
        elif ack.version > self.acked:
            self.acked, self.current, self.tries = ack.version, max(self.current, ack.version), 0
            self.maps = {version: one for version, one in self.maps.items() if version >= ack.version}
            self.parts = [p for p in self.parts if p.version > ack.version]


class Exchange:
    """One robot's part of all exchanges of maps."""

    def __init__(self, config: TalkConfig, rate_hz: float, mtu_bytes: int) -> None:
        """rate_hz: ticks a second. mtu_bytes: the longest message that the radio carries."""
        self.config, self.mtu_bytes = config, mtu_bytes
        self.contacts = Contacts(round(config.silence_s * rate_hz))
        self._told: dict[str, Told] = {}
        self._known: dict[str, Known] = {}
        self._answers: list[tuple[str, Ack, int]] = []
        """Acknowledgements due: to whom, what, and how many parts there are."""
        self._events: list[Event] = []
        """What happened while talking."""
        self._asks: dict[str, int] = {}
        """Who wants to know where the robot looked from, and since when."""
        self._axis: int | None = None
        self._beacon_due = False
        self._beacon_ticks = max(1, round(config.beacon_s * rate_hz))
        self._sight_ticks = max(1, round(config.sight_beacon_s * rate_hz))
        self._period_ticks = max(1, round(config.map_period_s * rate_hz))
        self._retry_ticks = max(1, round(config.retry_s * rate_hz))
        self._patience_ticks = max(1, round(REASSEMBLY_S * rate_hz))

    def hear(self, tick: int, heard: Sequence[Heard]) -> Hearing:
        """Take a tick's messages. Events are `contact`, `lost`, `refused` and the last talk's `untold`.

        A bad message meets nobody.
        """
        events, self._events = self._events, []
        refused: dict[str, str] = {}
        news: dict[str, News] = {}
        for message in heard:
            peer = message.sender
            try:
                said = self._take(tick, peer, message)
            except ProtocolError as error:
                refused.setdefault(peer, str(error))
                continue
            if self.contacts.hear(tick, peer):
                events.append(self._greet(peer))
                known = self._known.get(peer)
                news[peer] = News(peer, tick, map=None if known is None else known.map())
            one = news.get(peer) or News(peer, self.contacts.present[peer].since)
            match said:
                case Beacon():
                    one = one._replace(beacon=said)
                case ReceivedMap():
                    one = one._replace(map=said)
                case PeerViews():
                    one = one._replace(views=said)
            news[peer] = one
        events += [Event(event="refused", data={"peer": peer, "reason": why}) for peer, why in refused.items()]
        events += self.contacts.forget(tick)
        return Hearing([news[peer] for peer in self.contacts.present if peer in news], events)

    def _greet(self, peer: str) -> Event:
        """Answer a new contact by a beacon, and tell at once what did not arrive before."""
        self._beacon_due = True
        told = self._told.setdefault(peer, Told())
        told.sent, told.tries = NEVER, 0
        return Event(event="contact", data={"peer": peer})

    def _take(self, tick: int, peer: str, message: Heard) -> Beacon | ReceivedMap | PeerViews | None:
        """What a message tells that is new; raises ProtocolError for a bad one."""
        if message.kind == BEACON:
            return Beacon.decode(message.payload)
        if message.kind in (MAP, DELTA, RESEND):
            return self._take_part(tick, peer, Part.decode(message.payload))
        if message.kind == ACK:
            ack = Ack.decode(message.payload)
            if peer in self._told:
                self._told[peer].take_ack(ack)
            return None
        if message.kind == VIEWS:
            return self._take_views(peer, decode_views(message.payload))
        raise ProtocolError(f"a message of kind {message.kind}, which is unknown")

    def _take_part(self, tick: int, peer: str, part: Part) -> ReceivedMap | None:
        known = self._known.setdefault(peer, Known())
        ack, new = known.take_part(tick, part, self._patience_ticks)
        if ack is not None:
            self._answer(peer, ack, part.parts)
        return new

    def _answer(self, peer: str, ack: Ack, count: int) -> None:
        """Acknowledge at this tick's end: one answer a peer and version, the last word."""
        self._answers = [due for due in self._answers if (due[0], due[1].version) != (peer, ack.version)]
        self._answers.append((peer, ack, count))

    def _take_views(self, peer: str, views: AskViews | Views) -> PeerViews | None:
        if isinstance(views, Views):
            return self._known.setdefault(peer, Known()).take_views(views)
        self._asks[peer] = views.since
        return None

    def talk(
        self,
        tick: int,
        pose: Pose,
        wireframe: Wireframe,
        state: int,
        looked: Looked = NOWHERE,
        ask: Collection[str] = (),
        in_sight: bool = False,
    ) -> list[Send]:
        """What to send at this tick: beacon, acknowledgements, and to each peer what it does not have.

        pose and wireframe: the robot's own, looked: where it looked from, for those that ask. state: a number that
        changes with the wireframe. ask: peers whose viewpoints are wanted, once a beacon's period. in_sight: a peer
        whose frame is not known may be in sight, and so see the robot, too; beacons come sooner then.
        """
        sends = []
        period = self._sight_ticks if in_sight else self._beacon_ticks
        if self._beacon_due or tick % period == 0 or tick % self._beacon_ticks == 0:
            sends.append(Send(tick=tick, to=EVERYONE, kind=BEACON, payload=Beacon(tick, pose).encode()))
        self._beacon_due = False
        sends += [Send(tick=tick, to=to, kind=ACK, payload=ack.encode(count)) for to, ack, count in self._answers]
        self._answers = []
        for peer in self.contacts.present:
            kind, parts = self._due(tick, peer, self._told.setdefault(peer, Told()), wireframe, state)
            sends += [Send(tick=tick, to=peer, kind=kind, payload=part.encode()) for part in parts]
        return sends + self._talk_of_views(tick, state, looked, ask)

    def _talk_of_views(self, tick: int, state: int, looked: Looked, ask: Collection[str]) -> list[Send]:
        """Answers and questions. Nobody is told of a viewpoint before it has the map of what was seen from there."""
        sends = []
        for peer, since in self._asks.items():
            told = self._told.get(peer)
            if told is None:
                continue
            if not told.parts and told.compared == state:
                told.current = tick
            views = looked.between(since, told.current, self.mtu_bytes)
            if views is not None:
                sends.append(Send(tick=tick, to=peer, kind=VIEWS, payload=views.encode()))
        self._asks = {}
        if tick % self._beacon_ticks == 0:
            for peer in self.contacts.present:
                if peer in ask:
                    question = AskViews(self._known.setdefault(peer, Known()).views_until)
                    sends.append(Send(tick=tick, to=peer, kind=VIEWS, payload=question.encode()))
        return sends

    def _due(self, tick: int, peer: str, told: Told, wireframe: Wireframe, state: int) -> tuple[str, list[Part]]:
        """News, or what was not acknowledged in time."""
        late = tick - told.sent >= self._retry_ticks << min(told.tries, MOST_DOUBLINGS)
        if told.parts and not late:
            return RESEND, []
        half_there = len(told.parts) > 0 and told.parts[0].parts > 1 and told.tries < MOST_TRIES
        if told.compared != state and not half_there and tick - told.update >= self._period_ticks:
            told.compared = state
            news = self._tellable(tick, peer, told, wireframe)
            if news:
                told.tries = told.tries + 1 if told.parts else 0
                told.whole, told.parts, told.sent, told.update = news, news, tick, tick
                return DELTA if news[0].base else MAP, news
        if told.parts:
            told.tries += 1
            told.sent = tick
        return RESEND, list(told.parts)

    def _tellable(self, tick: int, peer: str, told: Told, wireframe: Wireframe) -> list[Part]:
        """News; none, and an event the first time, where they are more than travels."""
        try:
            news, told.untold = self._news(tick, told, wireframe), ""
        except ProtocolError as error:
            if not told.untold:
                self._events.append(Event(event="untold", data={"peer": peer, "reason": str(error)}))
            told.untold = str(error)
            return []
        return news

    def _news(self, tick: int, told: Told, wireframe: Wireframe) -> list[Part]:
        """The parts that bring a peer up to date; none where it is, or where that is on its way.

        Raises ProtocolError where they are more than travels.
        """
        config = self.config
        axis = main_axis(wireframe)
        slack = AXIS_SLACK_DEG / 90 * AXIS_STEPS
        if self._axis is None or abs((axis - self._axis + AXIS_STEPS // 2) % AXIS_STEPS - AXIS_STEPS // 2) > slack:
            self._axis = axis
        base = told.maps.get(told.acked)
        if base is not None and base.axis != self._axis:
            base = None
        new = quantise(wireframe, config.cell_mm, self._axis, base, SLACK_CELLS, SLACK_LEVELS)
        if base is not None and new.alike(base) and not told.parts:
            return []
        coded, version = encode_map(new, base, likelihoods=config.likelihoods), told.acked if base is not None else 0
        if base is not None and len(coded.data) > WHOLE_BYTES * len(new.cells):
            whole = encode_map(new, likelihoods=config.likelihoods)
            if len(whole.data) <= len(coded.data):
                coded, version = whole, 0
        pending = told.maps.get(told.parts[0].version) if told.parts else None
        if pending is not None and pending.alike(coded.map):
            return []
        if not len(new.cells) and base is None:
            return []
        parts = in_parts(tick, version, coded.data, self.mtu_bytes)
        told.maps[tick] = coded.map
        for old in sorted(told.maps.keys() - {told.acked})[:-KEPT_MAPS]:
            del told.maps[old]
        return parts
