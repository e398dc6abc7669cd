"""Progress of a run on the terminal, and the tables at its end."""

import json
import shlex
import time
from collections import Counter
from collections.abc import Container
from pathlib import Path
from typing import Any, Self

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Column, Table
from rich.text import Text

from deploy.report.rundir import mapping
from deploy.report.words import factor, is_figure
from deploy.terminal.console import Terminal
from deploy.terminal.pairs import fates
from deploy.terminal.tables import add_row
from protocol.document import read_text
from protocol.messages import Progress
from protocol.text import printable

LINE_S = 10.0  # time between two lines of progress where the output is no terminal, such as a log file
WIDTH = 72  # characters that a line of the summary needs
MAX_ROBOTS = 6  # of a run whose pairs are listed unasked
TOUCHED = ("wall_contacts", "robot_contacts")


class Display:
    """Progress on stderr: a live table on a terminal, else a line now and then, or nothing."""

    def __init__(self, world: str, radio: str, quiet: bool) -> None:
        """radio: its settings in words, printed when the run begins."""
        self._world, self._radio, self._quiet = printable(world), radio, quiet
        self._console = Terminal()
        self._began: tuple[float, float] | None = None
        """When the first progress came, and its simulated seconds: a resumed run begins in its midst."""
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
            self._began = now, clock.t
            self._say(f"radio: {self._radio}")
        began, began_t = self._began
        speed = (clock.t - began_t) / max(now - began, 1e-9)
        alive = sum(status != "dead" for status in clock.status.values())
        title = (
            f"{self._world}: {alive} of {len(clock.status)} robots, tick {clock.tick}, {clock.t:.1f} s simulated, "
            f"{factor(speed)} x real time{_late(progress.late_ticks)}"
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


def print_summary(out: Path, pairs: bool = False) -> None:
    """Print to stdout how a run directory's run ended, and its tables, where there is a summary.json.

    pairs: also who met whom, where there are more than MAX_ROBOTS.
    """
    try:
        summary = json.loads(read_text(out / "summary.json"))
    except (OSError, ValueError, RecursionError):
        return
    summary = mapping(summary)
    robots = mapping(summary.get("robots"))
    console = Terminal(stderr=False, least_width=WIDTH)
    console.print(Text(printable(_result(summary)), style="bold"), soft_wrap=True)
    table = _table(["robot", "ended"], ["coverage", "t_90 s", "t_99 s", "path m", "touched", "sent B"])
    for robot, row in ((robot, mapping(row)) for robot, row in robots.items()):
        path = _number(row.get("path_m"), ".1f")
        counts = [count for key in TOUCHED if isinstance(count := row.get(key), int)]
        touched = _number(sum(counts) if counts else None)
        add_row(table, robot, str(row.get("ended")), *_times(row), path, touched, _number(row.get("bytes_sent")))
    if team := mapping(summary.get("team")):
        add_row(table, "team", "", *_times(team))
    console.print(table)
    print_pairs(out, console, robots, pairs or len(robots) <= MAX_ROBOTS)


def _result(summary: dict[str, Any]) -> str:
    """The run in a line: how many robots ended how, what the team saw, and the time it took."""
    endings = Counter(str(mapping(row).get("ended")) for row in mapping(summary.get("robots")).values())
    ended = ", ".join(f"{count} {how}" for how, count in endings.most_common())
    team = mapping(summary.get("team"))
    pieces = [ended or "no robot"]
    if "coverage" in team:
        pieces.append(f"{_number(team['coverage'], '.1%')} of the wall seen")
    if isinstance(team.get("t_99"), int | float):
        pieces.append(f"99 % after {_number(team['t_99'], '.0f')} s")
    if is_figure(speed := summary.get("real_time_factor")):
        pieces.append(f"{factor(speed)} times real time{_late(summary.get('late_ticks'))}")
    return "; ".join(pieces)


def print_pairs(out: Path, console: Console, robots: Container[str], listed: bool) -> None:
    """Print who of the robots met whom, and what became of their maps: a line each, or how many there are."""
    try:
        pairs = [pair for pair in fates(out) if pair.robot in robots and pair.peer in robots]
    except (OSError, ValueError):
        pairs = []
    if not pairs:
        return
    if not listed:
        met = {frozenset((pair.robot, pair.peer)) for pair in pairs}  # each robot tells of it, and one may have merged
        merged = {frozenset((pair.robot, pair.peer)) for pair in pairs if pair.merged_at is not None}
        line = f"{len(met)} pairs met, {len(merged)} are merged: wireswarm report {shlex.quote(str(out))} --pairs"
        console.print(Text(printable(line)), soft_wrap=True)
        return
    table = _table(["robot", "peer"], ["met", "failed", "proposed", "merged s"])
    table.add_column("peer's frame", no_wrap=True)
    table.add_column("last", no_wrap=True, overflow="ellipsis", ratio=1)  # shortened to what is left of the line
    table.expand = True
    for pair in pairs:
        frame = "-" if pair.transform is None else " ".join(_number(value, ".2f") for value in pair.transform)
        counts = (str(pair.contacts), str(pair.attempts), str(pair.proposed))
        add_row(table, pair.robot, pair.peer, *counts, _number(pair.merged_at, ".1f"), frame, pair.last)
    console.print(table)


def _table(words: list[str], numbers: list[str]) -> Table:
    return Table(*words, *(Column(head, justify="right") for head in numbers), box=None, pad_edge=False)


def _late(ticks: Any) -> str:
    return f", {_number(ticks)} late ticks" if ticks else ""


def _times(row: dict[str, Any]) -> tuple[str, str, str]:
    return _number(row.get("coverage"), ".1%"), _number(row.get("t_90"), ".1f"), _number(row.get("t_99"), ".1f")


def _number(value: Any, form: str = "") -> str:
    """A number as text; a dash for anything else."""
    return format(value, form) if is_figure(value) else "-"
