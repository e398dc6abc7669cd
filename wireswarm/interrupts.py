"""Ctrl-C and SIGTERM before and after a command's work, and in commands that need no better."""

import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

# Also in `protocol`, which is not imported yet: another package of that name may be in the way.
SIGNALS = (signal.SIGINT, signal.SIGTERM)
INTERRUPTED = 130
"""Exit status."""


def leave_at_once() -> None:
    """End at each, without a word, from now on; unless it is ignored, as Ctrl-C is by jobs in the background."""
    for number in SIGNALS:
        if signal.getsignal(number) in (signal.default_int_handler, signal.SIG_DFL):
            signal.signal(number, lambda number, frame: _leave())


def ignore() -> None:
    """From now on: all is done and told, and Python takes some tenths of a second to end."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def _leave() -> None:
    """End, and with this process its children: the server that others are forked from imports for seconds."""
    with suppress(OSError):
        for children in Path("/proc/self/task").glob("*/children"):
            for child in children.read_text().split():
                os.kill(int(child), signal.SIGKILL)
    leave = getattr(sys.modules.get("protocol.temporary"), "leave", os._exit)  # not imported yet: there is no folder
    leave(INTERRUPTED)
