"""The gate that every message between robots must pass, and the books of what passed."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from protocol.errors import ProtocolError
from protocol.messages import EVERYONE, Heard, Send
from world.config import RadioConfig

DELIVERED = "delivered"
RANGE = "range"
"""Dropped: too far at the sending tick."""
DEAD = "dead"
"""Dropped: the receiver was dead when it was to be delivered."""
ENDED = "ended"
"""Dropped: the run ended before the delivery."""


class Passage(NamedTuple):
    """One message and one receiver: a line of radio.csv."""

    tick: int
    sender: str
    receiver: str
    kind: str
    size: int
    outcome: str


@dataclass
class Tally:
    """Messages and payload bytes."""

    messages: int = 0
    bytes: int = 0

    def add(self, size: int) -> None:
        """Count one message of that many bytes."""
        self.messages += 1
        self.bytes += size

    def as_dict(self) -> dict[str, int]:
        """For JSON."""
        return {"messages": self.messages, "bytes": self.bytes}


@dataclass
class Books:
    """Payload counts; on the air a broadcast counts once, on the links once per receiver."""

    on_air: defaultdict[tuple[str, str], Tally] = field(default_factory=lambda: defaultdict(Tally))
    """By sender and kind."""
    links: defaultdict[tuple[str, str, str, str], Tally] = field(default_factory=lambda: defaultdict(Tally))
    """By sender, receiver, kind and outcome."""
    sent: defaultdict[str, int] = field(default_factory=lambda: defaultdict(int))
    """Bytes that each robot put on the air."""
    received: defaultdict[str, int] = field(default_factory=lambda: defaultdict(int))
    """Bytes that were delivered to each robot."""

    def as_dict(self, robots: Sequence[str]) -> dict[str, Any]:
        """The payload counts of bandwidth.json: per robot, link and kind."""
        per_robot: dict[str, Any] = {robot: {"offered": {}, "delivered": {}, "dropped": {}} for robot in robots}
        for (sender, kind), tally in sorted(self.on_air.items()):
            per_robot[sender]["offered"][kind] = tally.as_dict()
        links: dict[tuple[str, str], dict[str, Any]] = {}
        into: defaultdict[tuple[str, str, str], Tally] = defaultdict(Tally)
        for (sender, receiver, kind, outcome), tally in sorted(self.links.items()):
            link = links.setdefault((sender, receiver), {"sender": sender, "receiver": receiver, "kinds": {}})
            counts = link["kinds"].setdefault(kind, {"offered": Tally(), "delivered": Tally(), "dropped": {}})
            _sum(counts["offered"], tally)
            _sum(into[receiver, kind, outcome], tally)
            if outcome == DELIVERED:
                _sum(counts["delivered"], tally)
            else:
                counts["dropped"][outcome] = tally.as_dict()
        for link in links.values():
            for counts in link["kinds"].values():
                counts["offered"], counts["delivered"] = (counts[part].as_dict() for part in ("offered", "delivered"))
        for (receiver, kind, outcome), tally in sorted(into.items()):
            if outcome == DELIVERED:
                per_robot[receiver]["delivered"][kind] = tally.as_dict()
            else:
                per_robot[receiver]["dropped"].setdefault(kind, {})[outcome] = tally.as_dict()
        return {"robots": per_robot, "links": list(links.values())}


def _sum(total: Tally, tally: Tally) -> None:
    total.messages += tally.messages
    total.bytes += tally.bytes


class Radio:
    """A disc around each sender, judged at the sending tick; delivery one tick later. Walls do not matter yet."""

    def __init__(self, robots: Sequence[str], config: RadioConfig) -> None:
        self.books = Books()
        self._robots = list(robots)
        self._index = {robot: i for i, robot in enumerate(robots)}
        self._reach = config.range_m
        self._flying: list[tuple[str, Send, list[tuple[str, bool]]]] = []

    def check(self, sender: str, send: Send) -> None:
        """Raise ProtocolError where the receiver is nobody else in this run."""
        if send.to != EVERYONE and (send.to == sender or send.to not in self._index):
            raise ProtocolError(f"{sender} sends to {send.to}, who is no other robot of this run")

    def offer(self, tick: int, sends: Mapping[str, Sequence[Send]], places: NDArray[np.float64]) -> None:
        """Take the messages of one tick; `places` (k, 2) are the true positions at that tick, metres."""
        for sender in sorted(sends, key=self._index.__getitem__):
            here = places[self._index[sender]]
            near = np.hypot(*(places - here).T) <= self._reach
            for send in sends[sender]:
                self.books.on_air[sender, send.kind].add(len(send.payload))
                self.books.sent[sender] += len(send.payload)
                receivers = self._robots if send.to == EVERYONE else [send.to]
                reached = [(other, bool(near[self._index[other]])) for other in receivers if other != sender]
                self._flying.append((sender, send, reached))

    def deliver(
        self, tick: int, live: Collection[str], *, ended: bool = False
    ) -> tuple[dict[str, list[Heard]], list[Passage]]:
        """What each live robot hears at this tick, in the order of sender and sequence, and all that was judged."""
        heard: dict[str, list[Heard]] = {robot: [] for robot in self._robots if robot in live}
        passages = []
        for sender, send, reached in self._flying:
            size = len(send.payload)
            message = Heard(tick=tick, sender=sender, kind=send.kind, payload=send.payload)
            for receiver, near in reached:
                if not near:
                    outcome = RANGE
                elif ended:
                    outcome = ENDED
                elif receiver not in heard:
                    outcome = DEAD
                else:
                    outcome = DELIVERED
                    heard[receiver].append(message)
                    self.books.received[receiver] += size
                self.books.links[sender, receiver, send.kind, outcome].add(size)
                passages.append(Passage(send.tick, sender, receiver, send.kind, size, outcome))
        self._flying = []
        return heard, passages
