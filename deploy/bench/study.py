"""A published experiment made again: its benchmark in full, and which values of its tables came out the same."""

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from deploy.bench.benchmark import Benchmark
from deploy.bench.layouts import SHARED, absent
from deploy.bench.tables import VERDICTS, Row, Table, label
from deploy.revision import ROOT
from deploy.terminal.console import Terminal
from protocol.command import say
from protocol.errors import InputError
from protocol.status import Status

STUDIES = {"trust": "alignment", "maps": "filter", "exploration": "exploration", "radio": "radio"}
"""The benchmark of each, with the paper's sensing."""
PUBLISHED = ROOT / "results"


def study(name: str, folder: Path, jobs: int | None, quick: bool = False) -> Status:
    """Make the published tables of an experiment again and compare them; as `Benchmark.run`.

    quick: as little of each as shows that all works, so that few values come out the same. Raises InputError where
    there is nothing to compare with.
    """
    published = Benchmark(STUDIES[name]).file(PUBLISHED, quick=False, ideal=True)
    if not published.is_file() or folder.resolve() == PUBLISHED.resolve():
        raise InputError(f"--results {folder}: it is compared with {published} of a checkout, so choose another folder")
    if lacking := absent():
        say(f"layouts that are not in {SHARED}, so that what is published of them is not made: {', '.join(lacking)}")
    before = json.loads(published.read_text(encoding="utf-8"))
    benchmark = Benchmark(STUDIES[name], before["sections"])
    status = benchmark.run(quick, folder, jobs, ideal=True)
    now = json.loads(benchmark.file(folder, quick, ideal=True).read_text(encoding="utf-8"))
    comparison(before, now).section({}).print(Terminal(stderr=False))
    return status


def comparison(before: Mapping[str, Any], now: Mapping[str, Any]) -> Table:
    """A row for each table of a published document: how many of its values are the same in another one."""
    rows: list[Row] = []
    for name, section in before["sections"].items():
        values, again = _values(section), _values(now["sections"].get(name, {"rows": []}))
        same = sum(again.get(place) == value for place, value in values.items())
        verdicts = {which: VERDICTS[found["met"].get(name)] for which, found in (("then", before), ("now", now))}
        rows.append({"table": name, "values": len(values), "same": same, **verdicts})
    title = "Values as published; times are the machine's, and others change with the sources"
    return Table("published", title, lambda _: rows, "table; values; same; then: bars then; now: bars now")


def _values(section: Mapping[str, Any]) -> dict[tuple[str, int, str], Any]:
    """Values of a table by what the row is about, which of those that are alike in it, and column.

    Where a row is missing, later ones with its label move up, and are compared with others.
    """
    values: dict[tuple[str, int, str], Any] = {}
    seen = Counter[str]()
    for row in section["rows"]:
        only = len(section["rows"]) == 1 and not isinstance(next(iter(row.values())), str)
        about = "" if only else label(row)  # the first value of an only row may be measured
        values |= {(about, seen[about], key): value for key, value in row.items() if key != "missed"}
        seen[about] += 1
    return values
