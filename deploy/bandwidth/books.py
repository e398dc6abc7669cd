"""The books of a run, and that they balance: radio.csv, line by line, against the sums of bandwidth.json."""

import csv
import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

UNITS = ("messages", "bytes")


class NoRunError(ValueError):
    """A directory that is no finished run, or whose figures contradict each other; says what is wrong."""


def read_books(run: Path) -> dict[str, Any]:
    """bandwidth.json of a run. Raises NoRunError where there is none, or where it and radio.csv do not agree."""
    try:
        books: dict[str, Any] = json.loads((run / "bandwidth.json").read_text(encoding="utf-8"))
        with (run / "radio.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        summed = Counter(dict(_sums(books)))
        listed: Counter[tuple[str, ...]] = Counter()
        for row in rows:
            for unit, value in zip(UNITS, (1, int(row["bytes"])), strict=True):
                listed[row["sender"], row["receiver"], row["kind"], row["outcome"], unit] += value
        addressed = Counter(dict(_addressed(books)))
        offered = Counter(dict(_offered(books)))
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise NoRunError(f"{run} is no finished run: {error}") from None
    if +summed != +listed:
        first = min((summed - listed) + (listed - summed))
        raise NoRunError(
            f"{run}: the books do not balance: {' '.join(first)} is {listed[first]} in radio.csv, "
            f"{summed[first]} in bandwidth.json"
        )
    by_sender: Counter[tuple[str, ...]] = Counter()
    for (sender, _, kind, _, unit), value in listed.items():
        by_sender[sender, kind, unit] += value
    by_link: Counter[tuple[str, ...]] = Counter()
    for (sender, receiver, kind, _, unit), value in listed.items():
        by_link[sender, receiver, kind, unit] += value
    if +by_sender != +addressed or +by_link != +offered:
        raise NoRunError(f"{run}: the books do not balance: what was addressed is not what was delivered and dropped")
    return books


def _sums(books: dict[str, Any]) -> Iterator[tuple[tuple[str, ...], int]]:
    for link in books["links"]:
        for kind, counts in link["kinds"].items():
            for outcome, tally in {"delivered": counts["delivered"], **counts["dropped"]}.items():
                for unit in UNITS:
                    yield (link["sender"], link["receiver"], kind, outcome, unit), tally[unit]


def _offered(books: dict[str, Any]) -> Iterator[tuple[tuple[str, ...], int]]:
    for link in books["links"]:
        for kind, counts in link["kinds"].items():
            for unit in UNITS:
                yield (link["sender"], link["receiver"], kind, unit), counts["offered"][unit]


def _addressed(books: dict[str, Any]) -> Iterator[tuple[tuple[str, ...], int]]:
    for robot, counts in books["robots"].items():
        for kind, tally in counts["addressed"].items():
            for unit in UNITS:
                yield (robot, kind, unit), tally[unit]
