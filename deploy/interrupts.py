"""Ctrl-C and SIGTERM, which mean the same to every command."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def on_interrupt(act: Callable[[], None]) -> Iterator[None]:
    """Call `act` at each, between two steps of the main thread, which goes on after it; then as before."""
    before = {number: signal.signal(number, lambda number, frame: act()) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
