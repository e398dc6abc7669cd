"""Declared tables: which cases make a row, what is made of their figures, and the bars that it must meet."""

import re
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table as Printed
from rich.text import Text

from deploy.bench.cases import Figures
from deploy.png import write_figure
from deploy.sweep.statistics import is_time, time_of, told_of
from deploy.sweep.statistics import median as median_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Outcomes = Mapping[str, Figures]  # figures of all cases by name
Runs = Sequence[Figures]  # figures of the cases that make one row
Row = dict[str, Any]  # value by column key
Reduce = Callable[[Runs, str], Any]  # makes one value of the figure of that key of some runs


def only(runs: Runs, key: str) -> Any:
    """The figure of the only run."""
    return runs[0].get(key)


def _of_all(make: Callable[[list[Any]], Any]) -> Reduce:
    """One value of the figures of all runs; None where a run lacks it."""

    def reduce(runs: Runs, key: str) -> Any:
        values = [run.get(key) for run in runs]
        return make(values) if values and None not in values else None

    return reduce


least, most, total = _of_all(min), _of_all(max), _of_all(sum)
mean = _of_all(lambda values: float(statistics.fmean(values)))


def _reached(runs: Runs, key: str) -> list[Any]:
    """The figure of each run; a time that was not reached is infinite."""
    return [time_of(run.get(key)) if is_time(key) else run.get(key) for run in runs]


def median(runs: Runs, key: str) -> float | None:
    """Of the figures of all runs; None where a run lacks it, and of times that half of the runs did not reach."""
    values = _reached(runs, key)
    found = None if None in values else median_of(values)
    return None if found is None else told_of(found.value)


def count(runs: Runs, key: str) -> int:
    """Number of the runs."""
    return len(runs)


def spread(runs: Runs, key: str) -> str:
    """Least and most of the runs that have the figure, which is that of the column KEY or KEY_spread.

    A time that a run did not reach is the most.
    """
    values = [value for value in _reached(runs, key.removesuffix("_spread")) if value is not None]
    return f"{min(values):.0f}-{max(values):.0f}".replace("inf", "∞") if values else "-"


def times(reduce: Reduce, of: Callable[[Figures], float | None]) -> Reduce:
    """The same of a time that is made of each run; None: it was not reached."""
    return lambda runs, _: reduce([{"t_": of(run)} for run in runs], "t_")


def completed_at(run: Figures) -> float | None:
    """When a run was complete; None where it ended otherwise, such as by its limit."""
    return run["ended_at"] if run["ended"] == "complete" else None


def share(holds: Callable[[Figures], object]) -> Reduce:
    """Share of the runs of which something holds."""
    return lambda runs, _: sum(map(bool, map(holds, runs))) / len(runs)


def over(part: str, whole: str) -> Reduce:
    """The sum of a figure of all runs over the sum of another one."""
    return lambda runs, _: float(total(runs, part) / max(total(runs, whole), 1))


REDUCTIONS = {
    "least": least, "most": most, "total": total, "median": median, "mean": mean, "count": count, "spread": spread,
}  # fmt: skip


@dataclass(frozen=True)
class Column:
    """One value of every row, and its bar, if it has one."""

    key: str
    head: str
    of: Reduce = only  # makes the value, where rows are groups of cases
    sign: str = ""  # what a value must be of the bound: >= or <=; empty without a bar
    bound: float = 0.0

    def misses(self, value: object) -> bool:
        """Whether a value misses the bar, as a missing value does."""
        if not isinstance(value, int | float):
            return bool(self.sign)
        return (self.sign == ">=" and value < self.bound) or (self.sign == "<=" and value > self.bound)

    @property
    def bar(self) -> str:
        """The bar in words; empty without."""
        return f"{self.sign} {self.bound:g}" if self.sign else ""


_COLUMN = re.compile(r"(?P<key>[\w-]+)(?: (?P<of>\w+))?(?: (?P<sign>[<>]=) (?P<bound>\S+))?(?:: (?P<head>.+))?")


def columns(text: str, **made: Reduce) -> list[Column]:
    """Columns from their words, as in "world; t median <= 600: seconds; share >= 0.9".

    The words are the key in the JSON, a name in REDUCTIONS, a bar, and the head above the column. Without such a name
    the function `made` of that key reduces the figures of several runs, or the only run's figure is taken; without a
    head the key's own words stand there. Raises ValueError.
    """
    out = []
    for words in text.split(";"):
        found = _COLUMN.fullmatch(" ".join(words.split()))
        if found is None:
            raise ValueError(f"{words!r} is no column")
        key, of, sign, bound, head = found.groups()
        reduce = REDUCTIONS[of] if of else made.get(key, only)
        out.append(Column(key, head or key.replace("_", " "), reduce, sign or "", float(bound or 0.0)))
    return out


def text_of(value: object) -> str:
    """A value as it is printed; a dash for None."""
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
    return "-" if value is None else str(value)


def label(row: Row) -> str:
    """What a row is about: its leading words, else its first value by name."""
    words = [*takewhile(lambda value: isinstance(value, str), row.values())]
    key, first = next(iter(row.items()))
    return ", ".join(words) or f"{key} {text_of(first)}"


_Printed = tuple[str, list[Text], bool]  # of a column: its head, its cells, and whether they are words


def _fitting(columns: Sequence[_Printed], labels: int, width: int) -> list[list[_Printed]]:
    """The columns in groups of at most `width` characters, where that can be; each begins with the labels."""

    def wide(columns: Sequence[_Printed]) -> int:
        heads = (max(map(len, [*head.split(), ""])) for head, _, _ in columns)
        cells = (max(cell.cell_len for cell in texts) for _, texts, _ in columns)
        return sum(max(pair) + 1 for pair in zip(heads, cells, strict=True)) + 2  # a box has a space at each side

    groups = [[*columns[:labels]]]
    for column in columns[labels:]:
        if len(groups[-1]) > labels and wide([*groups[-1], column]) > width:
            groups.append([*columns[:labels]])
        groups[-1].append(column)
    return groups


VERDICTS = {None: "", True: "met", False: "not met"}


@dataclass(frozen=True)
class Section:
    """A table that is filled: a row of values by column key each."""

    table: "Table"
    title: str
    note: str
    rows: Sequence[Row]
    judged: Sequence[bool]  # which rows have bars
    quick: bool = False  # of too few cases for the bars, so that no row is judged

    def missed(self, number: int) -> list[str] | None:
        """Keys of the bars that a row misses; None where it has none."""
        if self.quick or not self.judged[number] or not any(column.bar for column in self.table.columns):
            return None
        return [column.key for column in self.table.columns if column.misses(self.rows[number].get(column.key))]

    @property
    def met(self) -> bool | None:
        """Whether all rows meet all bars; None without bars."""
        verdicts = [missed for number in range(len(self.rows)) if (missed := self.missed(number)) is not None]
        return not any(verdicts) if verdicts else None

    def print(self, console: Console) -> None:
        """The table, each value beside its bar green if met and red with an ! if not.

        Where it is wider than the console, its columns are printed in several tables, each with the rows' labels.
        """
        unjudged = self.quick and any(self.judged) and any(column.bar for column in self.table.columns)
        verdict = "not judged (quick)" if unjudged else VERDICTS[self.met]
        title = f"{self.title}: {verdict}" if verdict else self.title
        texts = [self._texts(column) for column in self.table.columns]
        missed = [self.missed(number) for number in range(len(self.rows))]
        verdicts = [Text(VERDICTS[None if keys is None else not keys]) for keys in missed]
        heads = [f"{column.head}\n{column.bar}".strip() for column in self.table.columns]
        words = [any(isinstance(row.get(column.key), str) for row in self.rows) for column in self.table.columns]
        labels = words.index(False) if False in words else len(words)
        printed = [(*part, words[k]) for k, part in enumerate(zip(heads, texts, strict=True))]
        parts = _fitting([*printed, ("", verdicts, True)], labels, console.width)
        for number, part in enumerate(parts):
            last = number == len(parts) - 1
            caption = (self.note or None) if last else None
            table = Printed(title=None if number else title, caption=caption, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
            table.title_justify = table.caption_justify = "left"
            for head, _, named in part:
                table.add_column(head, justify="left" if named else "right", no_wrap=named)
            for cells in zip(*(cells for _, cells, _ in part), strict=True):
                table.add_row(*cells)
            console.print(table)

    def _texts(self, column: Column) -> list[Text]:
        """The cells of a column."""
        cells = []
        for number, row in enumerate(self.rows):
            missed = self.missed(number)
            bad = column.key in (missed or ())
            style = "red" if bad else "green" if column.bar and missed is not None else ""
            cells.append(Text(text_of(row.get(column.key)) + (" !" if bad else ""), style=style))
        return cells

    def draw(self, path: Path) -> None:
        """The table's picture, if it has one."""
        if self.table.drawn is not None:
            from matplotlib.figure import Figure

            figure = Figure(figsize=(5, 3.4), layout="constrained")
            figure.suptitle(self.title, fontsize="medium")
            self.table.drawn(self.rows, figure)
            write_figure(figure, path, dpi=120)

    def as_dict(self, sensing: str = "") -> dict[str, Any]:
        """All of it as JSON values. sensing: that of runs which do not set it themselves; empty: not told."""
        own = self.table.sensing or sensing
        return {
            "title": self.title,
            **({"sensing": own} if own else {}),
            "met": self.met,
            "bars": {column.key: column.bar for column in self.table.columns if column.bar},
            "rows": [{**row, "missed": self.missed(number)} for number, row in enumerate(self.rows)],
        } | ({"note": self.note} if self.note else {})


@dataclass(frozen=True)
class Table:
    """One table of a benchmark, as declared."""

    name: str
    title: str | Callable[[Outcomes], str]
    rows: str | Callable[[Outcomes], Sequence[Row]]
    """A pattern of case names (see `grouped`), each group of which is a row; or a function that makes the rows.

    A row that holds "judged": False need not meet the bars; that key does not come into the table."""
    heads: str | Sequence[Column]  # the columns, or their words (see `columns`)
    total: str = ""  # first value of a last row over all groups; none without
    judged: Callable[[Row], bool] = lambda row: True  # which rows must meet the bars
    note: str | Callable[[Outcomes], str] = ""
    drawn: Callable[[Sequence[Row], "Figure"], None] | None = None  # makes a picture of its rows
    sensing: str = ""  # that of its runs, where these set it themselves; empty: what the benchmark was asked for

    @cached_property
    def columns(self) -> Sequence[Column]:
        """One value of every row each."""
        return columns(self.heads) if isinstance(self.heads, str) else self.heads

    def section(self, figures: Outcomes) -> Section:
        """The table with the figures of a benchmark; without rows where its cases have none."""
        if callable(self.rows):
            rows = list(self.rows(figures))
        else:
            rows = [row_of(self.columns, runs, labels) for labels, runs in grouped(figures, self.rows)]
            if rows and self.total:
                rows.append(row_of(self.columns, runs_of(figures, self.rows), {self.columns[0].key: self.total}))
        judged = [row.pop("judged", True) and self.judged(row) for row in rows]
        title, note = ((text(figures) if rows else "") if callable(text) else text for text in (self.title, self.note))
        return Section(self, title, note, rows, judged)


def row_of(columns: Sequence[Column], runs: Runs, labels: Row) -> Row:
    """A row of labels, and of values that the other columns make of the runs."""
    return labels | {column.key: column.of(runs, column.key) for column in columns if column.key not in labels}


def grouped(figures: Outcomes, pattern: str) -> list[tuple[Row, list[Figures]]]:
    """Groups of the cases whose names fit: {KEY} labels a group, * is any one word between slashes.

    So `runs/{world}/*` puts the seeds of a world together; (?:a|b) is either word. Groups and runs are in the order of
    the cases.
    """
    fits = re.compile(re.sub(r"\{(\w+)\}", r"(?P<\1>.+)", pattern.replace("*", "[^/]+")))
    groups: dict[tuple[str, ...], tuple[Row, list[Figures]]] = {}
    for name, found in figures.items():
        if match := fits.fullmatch(name):
            groups.setdefault(match.groups(), (match.groupdict(), []))[1].append(found)
    return list(groups.values())


def by_label(figures: Outcomes, pattern: str) -> dict[str, list[Figures]]:
    """The groups of a pattern with one label, by that label."""
    return {next(iter(labels.values())): runs for labels, runs in grouped(figures, pattern)}


def runs_of(figures: Outcomes, pattern: str) -> list[Figures]:
    """All cases whose names fit."""
    return [run for _, runs in grouped(figures, pattern) for run in runs]


def whole(pattern: str) -> Callable[[Outcomes], list[Row]]:
    """Rows of the labels and all figures of each case."""
    return lambda figures: [labels | run for labels, runs in grouped(figures, pattern) for run in runs]
