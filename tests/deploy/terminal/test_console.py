"""Bars on a terminal."""

import os
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager

import pytest
from rich.progress import Progress

from deploy.terminal.console import Terminal
from deploy.terminal.live import Display
from protocol import messages


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


def test_the_speed_is_that_since_the_first_progress(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was 1.23e+03 times real time, and 1e+12 times where a resumed run began."""
    display = Display("maze-15", "range 4 m", quiet=False)
    for now, t in ((100.0, 3600.0), (110.0, 15940.0)):
        monkeypatch.setattr(time, "monotonic", lambda now=now: now)
        clock = messages.Clock(tick=round(5 * t), t=t, status={"r1": "exploring"})
        display.show(messages.Progress(clock=clock, coverage={"r1": 0.5}, team=0.5))
    _, first, second = capsys.readouterr().err.splitlines()
    assert ", 0 x real time" in first and ", 1,234 x real time" in second
