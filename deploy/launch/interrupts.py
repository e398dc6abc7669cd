"""Ctrl-C and SIGTERM, which mean the same to every command."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from protocol.command import SIGNALS


@contextmanager
def on_interrupt(act: Callable[[], None]) -> Iterator[None]:
    """Call `act` at each, between two steps of the main thread, which goes on after it; then as before.

    In another thread, such as that of a worker's task, nothing is done: signals are the main thread's.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, lambda number, frame: act()) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
