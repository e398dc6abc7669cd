"""What a run looks like while it runs, and the short table at its end."""

from __future__ import annotations

import json
import time
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from protocol.messages import Progress

LINE_S = 10.0
"""Between two lines where the output is no terminal, such as a log file."""


class Display:
    """Live progress on stderr: a table on a terminal, else a line now and then, or nothing."""

    def __init__(self, world: str, radio: str, quiet: bool) -> None:
        """radio: its configuration in words, printed when the run begins."""
        self._world, self._radio, self._quiet = world, radio, quiet
        self._console = Console(stderr=True)
        self._began: float | None = None
        self._line = 0.0
        self._open = ExitStack()
        self._live: Live | None = None

    def __enter__(self) -> Self:
        if self._console.is_terminal and not self._quiet:
            self._live = self._open.enter_context(
                Live(Text(f"{self._world}: starting"), console=self._console, transient=True)
            )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.close()

    def show(self, progress: Progress) -> None:
        """Take the newest progress."""
        now = time.monotonic()
        clock = progress.clock
        if self._began is None:
            self._began = now
            if not self._quiet:
                self._console.print(f"radio: {self._radio}", highlight=False, soft_wrap=True)
        speed = clock.t / (now - self._began) if now > self._began else 0.0
        alive = sum(status != "dead" for status in clock.status.values())
        late = f", {progress.late_ticks} late ticks" if progress.late_ticks else ""
        title = (
            f"{self._world}: {alive} of {len(clock.status)} robots, tick {clock.tick}, {clock.t:.1f} s simulated, "
            f"{speed:.0f} x real time{late}"
        )
        if self._live:
            self._live.update(Group(Text(title), _bars(progress)))
        elif not self._quiet and now - self._line >= LINE_S:
            self._line = now
            self._console.print(f"{title}, team coverage {progress.team:.1%}", highlight=False, soft_wrap=True)


def _bars(progress: Progress) -> Table:
    table = Table.grid(padding=(0, 1))
    shares = [(robot, progress.coverage[robot], status) for robot, status in progress.clock.status.items()]
    for name, share, status in [*shares, ("team", progress.team, "")]:
        table.add_row(name, ProgressBar(total=1.0, completed=share, width=30), f"{share:.1%}", status)
    return table


def print_summary(out: Path) -> None:
    """Print the table of a run directory's summary.json to stdout, where there is one."""
    try:
        summary: dict[str, Any] = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    except OSError:
        return
    table = Table(box=None, pad_edge=False)
    for heading in ("robot", "ended", "coverage", "t_90 s", "t_99 s", "path m", "contacts", "sent B"):
        table.add_column(heading, justify="left" if heading in ("robot", "ended") else "right")
    for robot, row in summary["robots"].items():
        table.add_row(
            robot,
            row["ended"],
            f"{row['coverage']:.1%}",
            _seconds(row["t_90"]),
            _seconds(row["t_99"]),
            f"{row['path_m']:.1f}",
            str(row["wall_contacts"] + row["robot_contacts"]),
            str(row["bytes_sent"]),
        )
    team = summary["team"]
    table.add_row("team", "", f"{team['coverage']:.1%}", _seconds(team["t_90"]), _seconds(team["t_99"]))
    console = Console()
    console.print(table)
    factor = summary["real_time_factor"]
    if factor is not None:
        late = f", {summary['late_ticks']} late ticks" if summary["late_ticks"] else ""
        console.print(f"{factor:g} times real time{late}", highlight=False)


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"
