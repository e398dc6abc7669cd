"""The gate that every message between robots must pass, and the books of what passed and what was dropped."""

import math
from collections import Counter, defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from heapq import nlargest
from typing import Any, NamedTuple

import numpy as np

from protocol.arrays import Floats
from protocol.errors import ProtocolError
from protocol.messages import EVERYONE, MOST_LINKS, Heard, LinkReport, LinkTable, Send
from protocol.talk import MAX_SENDS
from world.checkpoint import State
from world.radio.air import Budget, Hop, delays, losses
from world.radio.config import Capacity, RadioConfig

# Outcomes; all but the first are reasons of a drop, as are those of the models of the air.
DELIVERED = "delivered"
RANGE = "range"  # too far at the sending tick
MTU = "mtu"  # longer than the radio carries in one piece
CAPACITY_OUT = "capacity_out"  # the sender's radio has no capacity left in this second
HELD_BACK = (MTU, CAPACITY_OUT)  # by the sender's own radio: they never went on the air
CAPACITY_IN = "capacity_in"  # the receiver's radio has none left
DEAD = "dead"  # the receiver was dead when it was to be delivered
ABSENT = "absent"  # the receiver had not joined the run by then
ENDED = "ended"  # the run ended before the delivery

MAX_KINDS = 16
"""Kinds of messages of one robot in a run, as the books have a row for each; ours are seven."""
TABLE_S = 10.0
"""Simulated seconds over which the link table counts losses: two beacons are due in them."""


class Passage(NamedTuple):
    """One message and one receiver: a line of radio.csv."""

    tick: int
    sender: str
    receiver: str
    kind: str
    bytes: int
    outcome: str


def tally() -> Counter[str]:
    """Messages and payload bytes; `update` adds another's."""
    return Counter(messages=0, bytes=0)


def _count(books: Counter[str], size: int) -> None:
    """One message more; `update` takes ten times as long."""
    books["messages"] += 1
    books["bytes"] += size


@dataclass
class Books:
    """Counts of messages and payload bytes: a broadcast is offered once, and addressed once per receiver."""

    offered: defaultdict[tuple[str, str], Counter[str]] = field(default_factory=lambda: defaultdict(tally))
    """By sender and kind."""
    addressed: defaultdict[tuple[str, str, str], Counter[str]] = field(default_factory=lambda: defaultdict(tally))
    """By sender, receiver and kind, counted when sent: an independent count, against which outcomes are checked."""
    links: defaultdict[tuple[str, str, str, str], Counter[str]] = field(default_factory=lambda: defaultdict(tally))
    """By receiver, kind, outcome and sender."""
    sent: Counter[str] = field(default_factory=Counter)
    """Bytes that each robot put on the air."""
    received: Counter[str] = field(default_factory=Counter)
    """Bytes that were delivered to each robot."""

    def as_dict(self, robots: Sequence[str]) -> dict[str, Any]:
        """The payload counts of bandwidth.json: per robot, link and kind.

        `offered` counts a robot's messages once, `addressed` once for each receiver; `delivered` and `dropped` count
        messages meant for the robot. At the end, what was addressed is what was delivered and what was dropped.
        """
        per_robot: dict[str, Any] = {
            robot: {"offered": {}, "addressed": {}, "delivered": {}, "dropped": {}} for robot in robots
        }
        for (sender, kind), count in sorted(self.offered.items()):
            per_robot[sender]["offered"][kind] = count
            per_robot[sender]["addressed"][kind] = tally()
        links: dict[tuple[str, str], dict[str, Any]] = {}
        for (sender, receiver, kind), count in sorted(self.addressed.items()):
            link = links.setdefault((sender, receiver), {"sender": sender, "receiver": receiver, "kinds": {}})
            link["kinds"][kind] = {"offered": count, "delivered": tally(), "dropped": {}}
            per_robot[sender]["addressed"][kind].update(count)
        for (receiver, kind, outcome, sender), count in sorted(self.links.items()):
            of_link, of_robot = links[sender, receiver]["kinds"][kind], per_robot[receiver]
            if outcome == DELIVERED:
                of_link["delivered"] = count
                of_robot["delivered"].setdefault(kind, tally()).update(count)
            else:
                of_link["dropped"][outcome] = count
                of_robot["dropped"].setdefault(kind, {}).setdefault(outcome, tally()).update(count)
        return {"robots": per_robot, "links": list(links.values())}

    _TALLIES = ("offered", "addressed", "links")

    def state(self) -> State:
        """For a checkpoint: keys and counts row by row."""
        tallies = {name: getattr(self, name).items() for name in self._TALLIES}
        rows = {name: [(*key, n["messages"], n["bytes"]) for key, n in items] for name, items in tallies.items()}
        return rows | {"sent": self.sent, "received": self.received}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        for name in self._TALLIES:
            for *key, messages, size in state[name]:
                getattr(self, name)[tuple(key)] = Counter(messages=int(messages), bytes=int(size))
        self.sent, self.received = Counter(state["sent"]), Counter(state["received"])


class Flying(NamedTuple):
    """A message on its way to one receiver, with the reason if it is lost."""

    due: int
    """Tick at which it is heard, or counted as lost."""
    sender: int
    receiver: int
    send: Send
    lost: str | None


@dataclass
class Reception:
    """What became of the latest messages of one directed link."""

    recent: dict[int, tuple[int, int]] = field(default_factory=dict)
    """By tick: messages judged in it, and how many of these were delivered; for the last TABLE_S."""
    bytes: int = 0
    """Delivered since the start."""
    heard: int = -1
    """Tick of the last delivery; -1 before the first."""

    def count(self, tick: int, delivered: bool, since: int) -> None:
        """Count one message, and forget those judged at tick `since` or before."""
        judged, got = self.recent.get(tick, (0, 0))
        self.recent[tick] = judged + 1, got + delivered
        self.heard = tick if delivered else self.heard
        self.forget(since)

    def forget(self, since: int) -> None:
        """Forget messages judged at tick `since` or before."""
        while self.recent and (first := next(iter(self.recent))) <= since:
            del self.recent[first]


class Radio:
    """Takes what robots send and hands out what is heard. Range and models judge at the sending tick."""

    def __init__(
        self,
        robots: Sequence[str],
        config: RadioConfig,
        seed: int = 0,
        period_s: float = 0.2,
        walls: Floats | None = None,
    ) -> None:
        """period_s: of a tick. walls: (n, 4) x1, y1, x2, y2 in metres, free space on their left; None: none."""
        self.books = Books()
        self._robots = list(robots)
        self._index = {robot: i for i, robot in enumerate(robots)}
        self._reach = math.inf if config.range_m is None else config.range_m
        self._mtu = config.mtu_bytes
        walls = np.zeros((0, 4)) if walls is None else walls
        self._losses = losses(config.models, self._robots, seed, period_s, walls)
        self._delay = delays(config.models, seed)
        limits = [model.bytes_per_s for model in config.models if isinstance(model, Capacity)]
        ticks = max(1, round(1 / period_s))  # about a second
        seconds = round(ticks * period_s, 9)  # 49 of 1/49 s are less than one by rounding
        self._budget = Budget(min(limits) * seconds if limits else None, ticks)
        self._flying: list[Flying] = []
        self._receptions: defaultdict[tuple[int, int], Reception] = defaultdict(Reception)
        self._table_ticks = max(1, round(TABLE_S / period_s))

    def check(self, sender: str, sends: Sequence[Send]) -> None:
        """Raise ProtocolError for a receiver that is no other robot of this run, for too many messages or kinds."""
        if len(sends) > MAX_SENDS:
            raise ProtocolError(f"{sender} sends {len(sends)} messages in one tick; at most {MAX_SENDS} are taken")
        new = {send.kind for send in sends if (sender, send.kind) not in self.books.offered}
        if new and len(new) + sum(name == sender for name, _ in self.books.offered) > MAX_KINDS:
            raise ProtocolError(f"{sender} sends more than {MAX_KINDS} kinds of messages")
        for send in sends:
            if send.to != EVERYONE and (send.to == sender or send.to not in self._index):
                raise ProtocolError(f"{sender} sends to {send.to}, who is no other robot of this run")

    def offer(self, tick: int, sends: Mapping[str, Sequence[Send]], places: Floats) -> None:
        """Take the messages of one tick; `places` (k, 2) are the true positions at that tick, metres."""
        for sender in sorted(self._index[robot] for robot, said in sends.items() if said):
            name, numbers = self._robots[sender], [0] * len(self._robots)
            near = np.hypot(*(places - places[sender]).T) <= self._reach
            others = [index for index in self._index.values() if index != sender]
            for send in sends[name]:
                size = len(send.payload)
                _count(self.books.offered[name, send.kind], size)
                held_back = MTU if size > self._mtu else None
                if held_back is None and not self._budget.takes(sender, tick, size):
                    held_back = CAPACITY_OUT
                self.books.sent[name] += 0 if held_back else size
                for receiver in others if send.to == EVERYONE else {self._index[send.to]} - {sender}:
                    hop = Hop(tick, sender, receiver, numbers[receiver], places[sender], places[receiver])
                    numbers[receiver] += 1
                    _count(self.books.addressed[name, self._robots[receiver], send.kind], size)
                    lost = held_back or (self._lost_to(hop) if near[receiver] else RANGE)
                    due = tick + (1 if lost else self._delay(hop))
                    self._flying.append(Flying(due, sender, receiver, send, lost))

    def _lost_to(self, hop: Hop) -> str | None:
        """The reason of the first model that loses a message; None where none does."""
        return next((reason for reason, loses in self._losses if loses(hop)), None)

    def deliver(
        self, tick: int, live: Collection[str], absent: Collection[str] = (), *, ended: bool = False
    ) -> tuple[dict[str, list[Heard]], list[Passage]]:
        """What each live robot hears at this tick, ordered by sender and sequence, and what became of messages.

        absent: robots that have not joined yet. ended: the run is over, and messages still on their way are dropped.
        """
        heard: dict[str, list[Heard]] = {robot: [] for robot in self._robots if robot in live}
        passages = []
        due = [message for message in self._flying if ended or message.due <= tick]
        self._flying = [] if ended else [message for message in self._flying if message.due > tick]
        for _, sender, receiver, send, lost in sorted(due, key=lambda message: (message.sender, message.send.tick)):
            size, from_, to = len(send.payload), self._robots[sender], self._robots[receiver]
            if lost is not None:
                outcome = lost
            elif ended:
                outcome = ENDED
            elif to not in heard:
                outcome = DEAD
            elif to in absent:
                outcome = ABSENT
            elif not self._budget.takes(receiver, tick, size):
                outcome = CAPACITY_IN
            else:
                outcome = DELIVERED
                heard[to].append(Heard(tick=tick, sender=from_, kind=send.kind, payload=send.payload))
                self.books.received[to] += size
            _count(self.books.links[to, send.kind, outcome, from_], size)
            passages.append(Passage(send.tick, from_, to, send.kind, size, outcome))
            link = self._receptions[sender, receiver]
            link.count(tick, outcome == DELIVERED, tick - self._table_ticks)
            link.bytes += size * (outcome == DELIVERED)
        return heard, passages

    def state(self) -> State:
        """For a checkpoint. Models of the air keep nothing that the seed does not give again."""
        flying = [(*message[:3], message.send.model_dump(), message.lost) for message in self._flying]
        receptions = [(*link, seen.bytes, seen.recent) for link, seen in self._receptions.items()]
        parts = {"books": self.books.state(), "budget": self._budget.state()}
        return parts | {"flying": flying, "receptions": receptions}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        self.books.restore(state["books"])
        self._budget.restore(state["budget"])
        for due, sender, receiver, send, lost in state["flying"]:
            self._flying.append(Flying(due, sender, receiver, Send.model_validate(send), lost))
        for sender, receiver, size, recent in state["receptions"]:
            seen = {tick: (judged, got) for tick, (judged, got) in recent.items()}
            heard = max((tick for tick, (_, got) in seen.items() if got), default=-1)
            self._receptions[sender, receiver] = Reception(seen, size, heard)

    def table(self, tick: int) -> LinkTable:
        """Links with a delivery in the last TABLE_S: the share lost in that time, and bytes delivered so far.

        Where they are more than a message has room for, those with most bytes.
        """
        rows, since = [], tick - self._table_ticks
        heard = [(pair, link) for pair, link in self._receptions.items() if link.heard > max(since, -1)]
        busiest = nlargest(MOST_LINKS, heard, key=lambda row: row[1].bytes)
        for (sender, receiver), link in sorted(busiest, key=lambda row: row[0]):
            link.forget(since)
            judged, got = map(sum, zip(*link.recent.values(), strict=True))
            names = {"sender": self._robots[sender], "receiver": self._robots[receiver]}
            rows.append(LinkReport(**names, loss=round(1 - got / judged, 4), bytes=link.bytes))
        return LinkTable(tick=tick, links=rows, left_out=len(heard) - len(rows))
