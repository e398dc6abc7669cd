"""Ctrl-C and SIGTERM while the command is imported, and in commands that need no better: end at once without a word."""

import os
import signal

INTERRUPTED = 130
"""Exit status."""


def leave_at_once() -> None:
    """Handle both from now on, unless Ctrl-C is ignored already, as in a process that the command has started."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda number, frame: os._exit(INTERRUPTED))
