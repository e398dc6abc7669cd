"""Progress of a run on the terminal, and the tables at its end."""

import json
import time
from collections.abc import Container, Sequence
from pathlib import Path
from typing import Any, Self

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Column, Table
from rich.text import Text

from deploy.pairs import fates
from deploy.report.rundir import mapping
from deploy.report.words import MAX_SHOWN
from deploy.terminal import add_row
from protocol.messages import Progress
from protocol.text import printable

LINE_S = 10.0  # time between two lines of progress where the output is no terminal, such as a log file
CONTACTS = ("wall_contacts", "robot_contacts")


class Display:
    """Progress on stderr: a live table on a terminal, else a line now and then, or nothing."""

    def __init__(self, world: str, radio: str, quiet: bool) -> None:
        """radio: its settings in words, printed when the run begins."""
        self._world, self._radio, self._quiet = printable(world), radio, quiet
        self._console = Console(stderr=True)
        self._began: float | None = None
        self._line = 0.0
        self._live: Live | None = None

    def __enter__(self) -> Self:
        if self._console.is_terminal and not self._quiet:
            self._live = Live(Text(f"{self._world}: starting"), console=self._console, transient=True)
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._live.stop()

    def show(self, progress: Progress) -> None:
        """Take the newest progress."""
        now = time.monotonic()
        clock = progress.clock
        if self._began is None:
            self._began = now
            self._say(f"radio: {self._radio}")
        speed = clock.t / max(now - self._began, 1e-9)
        alive = sum(status != "dead" for status in clock.status.values())
        title = (
            f"{self._world}: {alive} of {len(clock.status)} robots, tick {clock.tick}, {clock.t:.1f} s simulated, "
            f"{speed:.0f} x real time{_late(progress.late_ticks)}"
        )
        if self._live:
            self._live.update(Group(Text(title), _bars(progress)))
        elif now - self._line >= LINE_S:
            self._line = now
            self._say(f"{title}, team coverage {progress.team:.1%}")

    def _say(self, line: str) -> None:
        if not self._quiet:
            self._console.print(Text(printable(line)), soft_wrap=True)


def _bars(progress: Progress) -> Table:
    table = Table.grid(padding=(0, 1))
    shares = [(robot, progress.coverage[robot], status) for robot, status in progress.clock.status.items()]
    for name, share, status in [*shares, ("team", progress.team, "")]:
        table.add_row(name, ProgressBar(total=1.0, completed=share, width=30), f"{share:.1%}", status)
    return table


def print_summary(out: Path) -> None:
    """Print the table of a run directory's summary.json to stdout, where there is one."""
    try:
        summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return
    summary = mapping(summary)
    robots = mapping(summary.get("robots"))
    table = _table(["robot", "ended"], ["coverage", "t_90 s", "t_99 s", "path m", "contacts", "sent B"])
    for robot, row in ((robot, mapping(row)) for robot, row in robots.items()):
        path = _number(row.get("path_m"), ".1f")
        contacts = _number(sum(count for key in CONTACTS if isinstance(count := row.get(key), int)))
        add_row(table, robot, str(row.get("ended")), *_times(row), path, contacts, _number(row.get("bytes_sent")))
    add_row(table, "team", "", *_times(mapping(summary.get("team"))))
    console = Console()
    console.print(table)
    _print_pairs(out, console, robots)
    factor = summary.get("real_time_factor")
    if factor is not None:
        console.print(f"{_number(factor, 'g')} times real time{_late(summary.get('late_ticks'))}", highlight=False)


def _print_pairs(out: Path, console: Console, robots: Container[str]) -> None:
    """Print who of the robots met whom, and what became of their maps."""
    try:
        pairs = [pair for pair in fates(out) if pair.robot in robots and pair.peer in robots]
    except (OSError, ValueError):
        pairs = []
    if not pairs:
        return
    rest = ["merged s", "peer's frame x, y, theta", "last"]
    table = _table(["robot", "peer"], ["contacts", "attempts", "proposed"], rest)
    for pair in pairs:
        frame = "-" if pair.transform is None else ", ".join(_number(value, ".2f") for value in pair.transform)
        counts = (str(pair.contacts), str(pair.attempts), str(pair.proposed))
        add_row(table, pair.robot, pair.peer, *counts, _number(pair.merged_at, ".1f"), frame, pair.last)
    console.print(table)


def _table(words: list[str], numbers: list[str], rest: Sequence[str] = ()) -> Table:
    return Table(*words, *(Column(head, justify="right") for head in numbers), *rest, box=None, pad_edge=False)


def _late(ticks: Any) -> str:
    return f", {_number(ticks)} late ticks" if ticks else ""


def _times(row: dict[str, Any]) -> tuple[str, str, str]:
    return _number(row.get("coverage"), ".1%"), _number(row.get("t_90"), ".1f"), _number(row.get("t_99"), ".1f")


def _number(value: Any, form: str = "") -> str:
    """A number as text; a dash for anything else, as robots and killed worlds leave it."""
    return format(value, form) if isinstance(value, int | float) and abs(value) < MAX_SHOWN else "-"
