"""The books of a run, and that they balance: radio.csv, line by line, against the sums of bandwidth.json."""

import csv
import json
import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from deploy import manifest
from deploy.report.rundir import BROKEN, MAX_TIME_S, OF_LOGS
from protocol.document import check_is_file, read_text
from protocol.errors import InputError
from world.radio.gate import HELD_BACK, Passage

MAX_BOOKS_BYTES = 1 << 30
"""Of bandwidth.json: 500 robots that all hear each other, and say all kinds of messages, fill 500 MB (ours)."""

Sums = Counter[tuple[str, ...]]


class NoRunError(InputError):
    """A directory that is no finished run, or whose figures contradict each other; says what is wrong."""


class _Part(BaseModel):
    """A part of bandwidth.json as a run writes it: nothing is taken for something else, and more may be there."""

    model_config = ConfigDict(strict=True)


Count = Annotated[int, Field(ge=0, lt=2**53)]
Share = Annotated[float, Field(allow_inf_nan=False)]


class _Tally(_Part):
    messages: Count
    bytes: Count


class _OfRobot(_Part):
    offered: dict[str, _Tally]
    addressed: dict[str, _Tally]
    delivered: dict[str, _Tally]
    dropped: dict[str, dict[str, _Tally]]


class _OfKind(_Part):
    offered: _Tally
    delivered: _Tally
    dropped: dict[str, _Tally]


class _OfLink(_Part):
    sender: str
    receiver: str
    kinds: dict[str, _OfKind]


class _Flow(_Part):
    messages: Count
    payload_bytes: Count
    overhead_bytes: Count
    wire_bytes: Count
    unexplained_share: Share


class _Books(_Part):
    robots: dict[str, _OfRobot]
    links: list[_OfLink]
    wire: dict[str, dict[str, _Flow]] = {}


def check_simulated(run: Path) -> None:
    """Raise NoRunError for a directory of recorded logs, which has a manifest.json and maps, too."""
    if manifest.is_of_logs(run):
        raise NoRunError(f"{run} {OF_LOGS}")


def check_has(run: Path, *names: str) -> None:
    """Raise NoRunError for a file that a run directory lacks; it names the file, or says why the run has not ended."""
    for name in names:
        if not (run / name).exists():
            raise NoRunError(f"{run} is no finished run: {manifest.unfinished(run) or f'it has no {name}'}")


def read_books(run: Path) -> dict[str, Any]:
    """bandwidth.json of a run. Raises NoRunError where there is none, or where it and radio.csv do not agree."""
    return read_traffic(run, ())[0]


def read_traffic(run: Path, kinds: Collection[str]) -> tuple[dict[str, Any], list[Passage]]:
    """The same, and the lines of radio.csv of some kinds of messages: a long file is read once. Raises NoRunError."""
    kept: list[Passage] = []

    def lines() -> Iterator[Passage]:
        for passage in _passages(run):
            if passage.kind in kinds:
                kept.append(passage)
            yield passage

    check_simulated(run)
    check_has(run, "bandwidth.json", "radio.csv")
    try:
        text = read_text(run / "bandwidth.json", MAX_BOOKS_BYTES)
        books: dict[str, Any] = json.loads(text, parse_float=_finite, parse_constant=_finite)
        _Books.model_validate(books)
        listed, summed = _of_lines(lines()), _of_books(books)
        off = (summed - listed) + (listed - summed)
    except ValidationError as error:
        wrong = error.errors()[0]
        where = ".".join(["bandwidth.json", *map(str, wrong["loc"])])
        raise NoRunError(f"{run} is no finished run: {where}: {wrong['msg']}") from None
    except BROKEN as error:
        raise NoRunError(f"{run} is no finished run: {error}") from None
    if off:
        first = min(off, key=lambda key: (-len(key), str(key)))
        raise NoRunError(
            f"{run}: what was addressed is not what was delivered and dropped, the books do not balance: "
            f"{' '.join(map(str, first))} is {listed[first]} in radio.csv, {summed[first]} in bandwidth.json"
        )
    return books, kept


def on_air(books: dict[str, Any], kind: str) -> int:
    """Bytes of a kind of messages that the senders' radios did not hold back; books: bandwidth.json.

    A broadcast counts once. Each robot's messages of the kind are taken to have as many receivers each.
    """
    held, total = Counter[str](), 0
    for link in books["links"]:
        dropped = link["kinds"].get(kind, {}).get("dropped", {})
        held[link["sender"]] += sum(tally["bytes"] for why, tally in dropped.items() if why in HELD_BACK)
    for robot, counts in books["robots"].items():
        offered, addressed = (counts[part].get(kind, {}).get("bytes", 0) for part in ("offered", "addressed"))
        total += offered - (held[robot] * offered // addressed if addressed else 0)
    return total


def _passages(run: Path) -> Iterator[Passage]:
    """The lines of radio.csv. Raises one of BROKEN."""
    check_is_file(run / "radio.csv")
    with (run / "radio.csv").open(encoding="utf-8", newline="") as file:
        for line in csv.DictReader(file):
            sender, receiver, kind, outcome = (line[key] for key in ("sender", "receiver", "kind", "outcome"))
            tick, size = int(line["tick"]), int(line["bytes"])
            if not (0 <= tick < MAX_TIME_S and 0 <= size < MAX_TIME_S):
                raise ValueError(f"radio.csv: no message has tick {tick:.3g} and {size:.3g} bytes")
            yield Passage(tick, sender, receiver, kind, size, outcome)


def _finite(text: str) -> float:
    """A number of JSON, which Python takes beyond all bounds. Raises ValueError."""
    if not math.isfinite(value := float(text)):
        raise ValueError(f"{text:.20} is no finite number")
    return value


def _of_lines(lines: Iterable[Passage]) -> Sums:
    """Sums by sender, receiver, kind, outcome and unit; by sender, receiver, kind and unit; by sender, kind, unit."""
    sums = Sums()
    for _, sender, receiver, kind, size, outcome in lines:
        for unit, value in (("messages", 1), ("bytes", size)):
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
