"""Figures with the bars they must meet, as tables for people and JSON for programs."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

WIDTH = 150
"""Characters that the widest table needs; a narrower terminal breaks its lines, but no figure is lost."""


@dataclass(frozen=True)
class Column:
    """One figure of every row, and its bar, if it has one."""

    key: str
    head: str
    at_least: float | None = None
    at_most: float | None = None
    digits: int = 3

    def met(self, value: object) -> bool | None:
        """Whether a value meets the bar; None where there is nothing to judge. A missing value meets no bar."""
        if self.at_least is None and self.at_most is None:
            return None
        if not isinstance(value, int | float):
            return False
        return (self.at_least is None or value >= self.at_least) and (self.at_most is None or value <= self.at_most)

    @property
    def bar(self) -> str:
        """The bar in words; empty without."""
        words = [f">= {self.at_least:g}"] if self.at_least is not None else []
        return " ".join(words + ([f"<= {self.at_most:g}"] if self.at_most is not None else []))

    def text(self, value: object) -> str:
        """The value in words."""
        if value is None:
            return "-"
        return f"{value:,.{self.digits}f}" if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class Section:
    """One table: a row of values by column key each. Rows named in `beside` stand beside it and have no bars."""

    name: str
    title: str
    columns: Sequence[Column]
    rows: Sequence[Mapping[str, Any]]
    beside: frozenset[int] = field(default_factory=frozenset)
    note: str = ""

    def missed(self, number: int) -> list[str] | None:
        """Keys of the bars that a row misses; None where it has none."""
        if number in self.beside:
            return None
        verdicts = {column.key: column.met(self.rows[number].get(column.key)) for column in self.columns}
        if all(verdict is None for verdict in verdicts.values()):
            return None
        return [key for key, verdict in verdicts.items() if verdict is False]

    @property
    def met(self) -> bool | None:
        """Whether all rows meet all bars; None without bars."""
        verdicts = [missed for number in range(len(self.rows)) if (missed := self.missed(number)) is not None]
        return not any(verdicts) if verdicts else None

    def print(self, console: Console) -> None:
        """The table, each value beside its bar green if met and red with an ! if not."""
        verdict = _verdict(self.met)
        table = Table(
            title=f"{self.title}: {verdict}" if verdict else self.title,
            title_justify="left",
            caption=self.note or None,
            caption_justify="left",
            box=SIMPLE_HEAD,
            padding=(0, 1, 0, 0),
        )
        for column in self.columns:
            named = any(isinstance(row.get(column.key), str) for row in self.rows)
            head = f"{column.head}\n{column.bar}".strip()
            table.add_column(head, justify="left" if named else "right", no_wrap=named)
        table.add_column("", no_wrap=True)
        for number, row in enumerate(self.rows):
            missed = self.missed(number)
            cells = []
            for column in self.columns:
                value = row.get(column.key)
                judged = missed is not None and column.met(value) is not None
                bad = missed is not None and column.key in missed
                style = ("red" if bad else "green") if judged else ""
                cells.append(Text(column.text(value) + (" !" if bad else ""), style=style))
            table.add_row(*cells, Text(_verdict(None if missed is None else not missed)))
        console.print(table)

    def as_dict(self) -> dict[str, Any]:
        """All of it as JSON values."""
        return {
            "title": self.title,
            "met": self.met,
            "bars": {column.key: column.bar for column in self.columns if column.bar},
            "rows": [{**row, "missed": self.missed(number)} for number, row in enumerate(self.rows)],
        } | ({"note": self.note} if self.note else {})


def _verdict(met: bool | None) -> str:
    return "" if met is None else ("met" if met else "not met")


def report(name: str, sections: Sequence[Section], failed: Mapping[str, str], out: Path) -> None:
    """Print all tables and write them to `out`, with the machine they were measured on."""
    console = Console()
    console.width = max(console.width, WIDTH)
    for section in sections:
        section.print(console)
    for case, reason in failed.items():
        console.print(f"no figures of {case}: {reason}", style="red", markup=False, highlight=False)
    document = {
        "bench": name,
        "version": version("wireswarm"),
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cpus": os.cpu_count(),
        "met": {section.name: section.met for section in sections},
        "sections": {section.name: section.as_dict() for section in sections},
        "failed": dict(failed),
    }
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    console.print(f"written to {out}", highlight=False)
