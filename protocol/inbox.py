"""What a process takes from the network: a queue that callbacks and signal handlers fill, and one thread empties."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import NamedTuple

import zenoh

from protocol import keys

SIGNAL_S = 0.2
"""Longest time until a signal is handled, by waking so often: a stop is to take less than 2 s."""


class Arrival(NamedTuple):
    """One thing that came in."""

    what: str  # last part of its key, or one of the inbox's own words such as Inbox.STOP
    robot: str = ""  # ID in its key
    payload: bytes = b""
    query: zenoh.Query | None = None  # the question that waits for a reply, if it is one


class Inbox(SimpleQueue[Arrival]):
    """Arrivals in their order."""

    STOP = "stop"
    stopped = False
    busy = False
    """Whether the thread that empties it is at long work that may be broken off, such as compiling."""

    def stop(self) -> None:
        """Ask the thread that empties the inbox to end its run."""
        self.stopped = True
        self.put(Arrival(self.STOP))

    @contextmanager
    def long_work(self) -> Iterator[None]:
        """Work that a signal to this process breaks off (agent/shell/command.py)."""
        self.busy = True
        try:
            yield
        finally:
            self.busy = False

    def hear(self, sample: zenoh.Sample) -> None:
        """Take a sample of a subscriber."""
        key = str(sample.key_expr)
        self.put(Arrival(keys.channel_of(key), keys.robot_of(key), sample.payload.to_bytes()))

    def take(self, deadline: float) -> Arrival | None:
        """The next arrival; None where none comes before time.monotonic() reaches `deadline`.

        It waits in steps: where another thread of the process receives a signal, the one that waits here is not woken.
        """
        while True:
            left = max(0.0, deadline - time.monotonic())
            try:
                return self.get(timeout=min(left, SIGNAL_S))
            except Empty:
                if left <= SIGNAL_S:
                    return None

    def next(self) -> Arrival:
        """The next arrival, waited for without limit."""
        while (arrival := self.take(math.inf)) is None:
            pass
        return arrival
