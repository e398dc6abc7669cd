"""How far a sweep is, and when it will be done, on stderr."""

import time
from datetime import timedelta
from typing import Self

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.text import Text

from deploy.sweep.work import OK, Row
from deploy.terminal.console import Terminal
from deploy.terminal.live import LINE_S
from protocol.text import printable


class SweepProgress:
    """A bar on a terminal, else a line now and then; failed runs are told, each with its reason."""

    def __init__(self, total: int, quiet: bool) -> None:
        """total: runs that are to be made."""
        self._total, self._done, self._quiet = total, 0, quiet
        self._began = self._line = time.monotonic()
        self._console = Terminal(quiet)
        columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"))
        self._bar = Progress(*columns, console=self._console, disable=not self._console.is_terminal)
        self._task = self._bar.add_task("", total=total)

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def arrived(self, row: Row) -> None:
        """Another run is there."""
        self._done += 1
        now = time.monotonic()
        left_s = (now - self._began) / self._done * (self._total - self._done)
        left = f"{timedelta(seconds=round(left_s))} left"
        self._bar.update(self._task, advance=1, description=left)
        if row["status"] != OK:
            self.say(f"{row['settings']}: {row['reason']}")
        if not self._console.is_terminal and (now - self._line >= LINE_S or self._done == self._total):
            self._line = now
            self.say(f"{self._done} of {self._total}, {left}")

    def say(self, sentence: str) -> None:
        """Tell something above the bar."""
        self._console.print(Text(printable(sentence)), soft_wrap=True)
