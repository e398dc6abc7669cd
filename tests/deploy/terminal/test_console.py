"""Bars on a terminal."""

import os
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager

import pytest
from rich.progress import Progress

from deploy.terminal.console import Terminal
from deploy.terminal.live import Display


@pytest.mark.parametrize(
    "bars", [lambda: Display("maze-15", "range 4 m", quiet=False), lambda: Progress("bar", console=Terminal())]
)
def test_a_bar_that_is_broken_off_leaves_a_terminal_its_cursor(
    bars: Callable[[], AbstractContextManager[object]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TERM", "xterm")
    ours, theirs = os.openpty()
    with os.fdopen(theirs, "w") as terminal, os.fdopen(ours, "rb", buffering=0) as reader:
        monkeypatch.setattr(sys, "stderr", terminal)
        with bars():
            print("begun", file=sys.stderr, flush=True)
            said = reader.read(4096)
    assert b"begun" in said and b"\x1b[?25l" not in said
