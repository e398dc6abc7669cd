"""What a process takes from the network: a queue that callbacks and signal handlers fill, and one thread empties."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import NamedTuple

import zenoh

from protocol import keys


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
    """Whether that thread is at work for minutes that nobody needs to be brought to its end."""

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
        """The next arrival; None where none comes before time.monotonic() reaches `deadline`."""
        try:
            return self.get(timeout=max(0.0, deadline - time.monotonic()))
        except Empty:
            return None
