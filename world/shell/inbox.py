"""What comes to the world: robots' samples, changes of their liveliness tokens, and their questions."""

import threading
from collections import Counter
from typing import Any

import zenoh

from protocol import keys
from protocol.access import ANYBODY
from protocol.codec import encode
from protocol.inbox import Arrival, Inbox
from protocol.messages import Refused, clipped

MOST_WAITING, MOST_BYTES_WAITING = 4096, 8 << 20
"""Arrivals of one robot that wait for the world, and their bytes (ours). An honest one answers a tick in at most 260
messages and 1 MB, and again where its link was lost; then it waits for the world."""


class WorldInbox(Inbox):
    """Arrivals of all robots in one order, which one thread takes. What is too much of a robot is left out and told."""

    ALIVE, GONE, ENDED, FLOOD = "token", "no-token", "ended", "flood"

    def __init__(self) -> None:
        super().__init__()
        self._waiting: Counter[str] = Counter()
        self._bytes: Counter[str] = Counter()
        self._lock = threading.Lock()

    def put(self, arrival: Arrival, *_: Any) -> None:
        """Add an arrival, unless it is one too many of its robot."""
        robot = arrival.robot
        if robot:
            with self._lock:
                if self._waiting[robot] > MOST_WAITING or self._bytes[robot] > MOST_BYTES_WAITING:
                    return
                self._waiting[robot] += 1
                self._bytes[robot] += len(arrival.payload)
                if self._waiting[robot] > MOST_WAITING or self._bytes[robot] > MOST_BYTES_WAITING:
                    arrival = Arrival(self.FLOOD, robot, arrival.payload)
        super().put(arrival)

    def take(self, deadline: float) -> Arrival | None:
        """The next arrival; None where none comes before time.monotonic() reaches `deadline`."""
        arrival = super().take(deadline)
        if arrival is not None and arrival.robot:
            with self._lock:
                self._waiting[arrival.robot] -= 1
                self._bytes[arrival.robot] -= len(arrival.payload)
                if not self._waiting[arrival.robot]:
                    del self._waiting[arrival.robot], self._bytes[arrival.robot]
        return arrival

    def end(self, robot: str) -> None:
        """Take the launcher's word that a robot's process has ended for good."""
        self.put(Arrival(self.ENDED, robot))

    def watch(self, sample: zenoh.Sample) -> None:
        """Take a change of a robot's liveliness token."""
        what = self.ALIVE if sample.kind == zenoh.SampleKind.PUT else self.GONE
        self.put(Arrival(what, keys.robot_of(str(sample.key_expr))))

    def ask(self, query: zenoh.Query) -> None:
        """Take a question on robots/*/srv/**."""
        key = str(query.key_expr)
        payload = query.payload.to_bytes() if query.payload is not None else b""
        what, robot = keys.channel_of(key), keys.robot_of(key)
        # whoever asks why may have made up the ID: all of them count as one
        self.put(Arrival(what, ANYBODY if what == keys.WHY else robot, payload, query))


def refuse(query: zenoh.Query, reason: str | None) -> None:
    """Answer a question by why it is refused; not at all where there is no reason."""
    if reason is not None:
        query.reply_err(encode(Refused(reason=clipped(reason))))
