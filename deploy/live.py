"""Progress of a run on the terminal, and the tables at its end."""

import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Column, Table
from rich.text import Text

from deploy.pairs import fates
from protocol.messages import Progress

LINE_S = 10.0  # time between two lines of progress where the output is no terminal, such as a log file


class Display:
    """Progress on stderr: a live table on a terminal, else a line now and then, or nothing."""

    def __init__(self, world: str, radio: str, quiet: bool) -> None:
        """radio: its settings in words, printed when the run begins."""
        self._world, self._radio, self._quiet = world, radio, quiet
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
            self._console.print(line, highlight=False, soft_wrap=True)


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
    table = _table(["robot", "ended"], ["coverage", "t_90 s", "t_99 s", "path m", "contacts", "sent B"])
    for robot, row in summary["robots"].items():
        times = _seconds(row["t_90"]), _seconds(row["t_99"])
        counts = str(row["wall_contacts"] + row["robot_contacts"]), str(row["bytes_sent"])
        table.add_row(robot, row["ended"], f"{row['coverage']:.1%}", *times, f"{row['path_m']:.1f}", *counts)
    team = summary["team"]
    table.add_row("team", "", f"{team['coverage']:.1%}", _seconds(team["t_90"]), _seconds(team["t_99"]))
    console = Console()
    console.print(table)
    _print_pairs(out, console)
    factor = summary["real_time_factor"]
    if factor is not None:
        console.print(f"{factor:g} times real time{_late(summary['late_ticks'])}", highlight=False)


def _print_pairs(out: Path, console: Console) -> None:
    """Print who met whom, and what became of their maps."""
    try:
        pairs = fates(out)
    except (OSError, ValueError, KeyError):
        pairs = []
    if not pairs:
        return
    rest = ["merged s", "peer's frame x, y, theta", "last"]
    table = _table(["robot", "peer"], ["contacts", "attempts", "proposed"], rest)
    for pair in pairs:
        frame = "-" if pair.transform is None else ", ".join(f"{value:.2f}" for value in pair.transform)
        counts = (str(pair.contacts), str(pair.attempts), str(pair.proposed))
        table.add_row(pair.robot, pair.peer, *counts, _seconds(pair.merged_at), frame, pair.last)
    console.print(table)


def _table(words: list[str], numbers: list[str], rest: Sequence[str] = ()) -> Table:
    return Table(*words, *(Column(head, justify="right") for head in numbers), *rest, box=None, pad_edge=False)


def _late(ticks: int) -> str:
    return f", {ticks} late ticks" if ticks else ""


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"
