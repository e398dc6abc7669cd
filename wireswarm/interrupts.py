"""Ctrl-C and SIGTERM while the command is imported, and in commands that need no better: end at once without a word."""

import os
import signal
from contextlib import suppress
from pathlib import Path

INTERRUPTED = 130
"""Exit status."""


def leave_at_once() -> None:
    """Handle both from now on, unless Ctrl-C is ignored already, as in a process that the command has started."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda number, frame: _leave())


def _leave() -> None:
    """End, and with this process its children: the server that others are forked from imports for seconds."""
    with suppress(OSError):
        for children in Path("/proc/self/task").glob("*/children"):
            for child in children.read_text().split():
                os.kill(int(child), signal.SIGKILL)
    os._exit(INTERRUPTED)
