"""What was made of logs, as a table and sentences on the terminal."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.table import Table

from deploy.terminal.console import Terminal
from deploy.terminal.live import MAX_ROBOTS, WIDTH, print_pairs
from deploy.terminal.tables import add_row

COLUMNS = ("robot", "log", "scans", "skipped", "path m", "loops", "map B", "step ms", "99 % ms")


def print_mapped(out: Path, summary: Mapping[str, Any]) -> None:
    """Print the figures of a run directory's summary.json, a sentence for all that is odd, and who met whom."""
    table, sentences = Table(*COLUMNS, box=None, pad_edge=False), []
    for robot, row in summary["robots"].items():
        skipped = sum(row["skipped"].values())
        told = "too large" if row["map_bytes"] is None else str(row["map_bytes"])
        counts = (str(row["scans"]), str(skipped), f"{row['path_m']:.1f}", str(row["loops"]), told)
        add_row(table, robot, row["log"], *counts, f"{row['step_ms_median']:.1f}", f"{row['step_ms_99']:.1f}")
        sentences += [f"{robot}: skipped {count} {reason}" for reason, count in row["skipped"].items()]
        sentences += [f"{robot}: {note}" for note in row["notes"]]
    if summary.get("heard") == "all":
        sentences.append("no reference says where each robot was, so all heard each other")
    console = Terminal(stderr=False, least_width=WIDTH)
    console.print(table)
    for sentence in sentences:
        console.print(sentence, markup=False, highlight=False)
    print_pairs(out, console, summary["robots"], len(summary["robots"]) <= MAX_ROBOTS)
