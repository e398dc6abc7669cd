"""The books of a run, and that they balance: radio.csv, line by line, against the sums of bandwidth.json."""

import csv
import json
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from protocol.document import check_is_file, read_text
from protocol.errors import InputError

MAX_BOOKS_BYTES = 1 << 30
"""Of bandwidth.json: 500 robots that all hear each other, and say all kinds of messages, fill 500 MB (ours)."""

Sums = Counter[tuple[str, ...]]


class NoRunError(InputError):
    """A directory that is no finished run, or whose figures contradict each other; says what is wrong."""


def read_books(run: Path) -> dict[str, Any]:
    """bandwidth.json of a run. Raises NoRunError where there is none, or where it and radio.csv do not agree."""
    try:
        books: dict[str, Any] = json.loads(read_text(run / "bandwidth.json", MAX_BOOKS_BYTES))
        check_is_file(run / "radio.csv")
        with (run / "radio.csv").open(encoding="utf-8", newline="") as file:
            listed = _of_lines(csv.DictReader(file))
        summed = _of_books(books)
        off = (summed - listed) + (listed - summed)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError, csv.Error) as error:
        raise NoRunError(f"{run} is no finished run: {error}") from None
    if off:
        first = min(off, key=lambda key: (-len(key), str(key)))
        raise NoRunError(
            f"{run}: what was addressed is not what was delivered and dropped, the books do not balance: "
            f"{' '.join(map(str, first))} is {listed[first]} in radio.csv, {summed[first]} in bandwidth.json"
        )
    return books


def _of_lines(lines: Iterable[dict[str, str]]) -> Sums:
    """Sums by sender, receiver, kind, outcome and unit; by sender, receiver, kind and unit; by sender, kind, unit."""
    sums = Sums()
    for line in lines:
        sender, receiver, kind, outcome = (line[key] for key in ("sender", "receiver", "kind", "outcome"))
        for unit, value in (("messages", 1), ("bytes", int(line["bytes"]))):
            for key in ((sender, receiver, kind, outcome, unit), (sender, receiver, kind, unit), (sender, kind, unit)):
                sums[key] += value
    return sums


def _of_books(books: dict[str, Any]) -> Sums:
    """The same sums in bandwidth.json: what became of each message, what was offered, and what was addressed."""
    sums = Sums()
    for link in books["links"]:
        for kind, counts in link["kinds"].items():
            ends = {("delivered",): counts["delivered"], (): counts["offered"]}
            ends |= {(why,): tally for why, tally in counts["dropped"].items()}
            for end, tally in ends.items():
                for unit in ("messages", "bytes"):
                    sums[link["sender"], link["receiver"], kind, *end, unit] += tally[unit]
    for robot, counts in books["robots"].items():
        for kind, tally in counts["addressed"].items():
            for unit in ("messages", "bytes"):
                sums[robot, kind, unit] += tally[unit]
    return sums
