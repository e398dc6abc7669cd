"""Results of sweeps as tables: medians of each group of runs, and differences between runs of the same seed."""

import csv
import io
import json
import math
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.box import SIMPLE_HEAD
from rich.table import Table

from deploy.sweep import picture
from deploy.sweep.picture import Panel, titled
from deploy.sweep.statistics import Estimate, difference, median, value_of
from deploy.sweep.store import read_rows
from deploy.sweep.work import OK, Row
from deploy.terminal.console import Terminal
from deploy.terminal.tables import add_row
from protocol.document import MAX_INT, parse_document
from protocol.errors import InputError
from protocol.files import make_folder, write_whole

MEASURES = (
    "team.coverage", "team.t_90", "team.t_99", "mean.path_m", "worst.wall_recall", "worst.wall_precision",
    "mean.bytes_sent",
)  # fmt: skip
"""Without --measure."""

WIDTH = 200  # characters that a line with all of them needs

KEY = r"[\w.*]+"
"""Of a setting, such as mind.* where one mind is for all robots."""

CONTENTS = ("revision", "world.hash", "mind.hash")
"""Columns that tell runs apart beside their settings: our sources, the world's file and minds of your own. Where worlds
or minds are compared, their hash is left out."""

ALIKE = "are alike in all else, seeds included, and revisions where a side has several"

Point = tuple[tuple[str, str], ...]
"""Settings and their values as JSON, in the order of their names."""


class Sheet(NamedTuple):
    """A table: lines of texts, counts and figures (None: there is none) under heads."""

    title: str
    heads: list[str]
    lines: list[list[str | int | Estimate | None]]
    unreached: Mapping[tuple[int, int], str] = {}
    """By line and column: of a median that is no time, how many runs did not reach it."""


def select(what: str) -> tuple[list[Row], list[str]]:
    """Rows of FOLDER, or FOLDER:KEY=VALUE,KEY=VALUE, and these keys. Raises InputError."""
    folder, *wishes = re.split(rf":(?={KEY}(?:=|$))", what, maxsplit=1)
    if not Path(folder).is_dir():  # a folder's name may have a colon
        folder, wishes = what, []
    if not Path(folder).is_dir():
        raise InputError(f"{folder:.200}: no folder of a sweep's results")
    try:
        wanted = dict(_wish(wish) for text in wishes for wish in re.split(rf",(?={KEY}=)", text))
    except InputError as error:
        raise InputError(f"{what:.200}: {error}") from None
    rows = [row for row in read_rows(Path(folder)) if wanted.items() <= _settings(row, wanted).items()]
    if not rows:
        raise InputError(f"{what:.200}: no results{_there(read_rows(Path(folder)), wanted)}")
    return _once(rows), list(wanted)


def _once(rows: Iterable[Row]) -> list[Row]:
    """One result of each run: several sweeps below a folder may hold it. One that did not fail, if there is one."""
    found: dict[tuple[object, object], Row] = {}
    for row in rows:
        run = row["revision"], row["key"]
        if found.setdefault(run, row)["status"] != OK:
            found[run] = row
    return list(found.values())


def _there(rows: Iterable[Row], keys: Iterable[str]) -> str:
    """Which values of these settings there are, to be said after what is missing."""
    values: dict[str, set[str]] = {key: set() for key in keys}
    for row in rows:
        for key, value in _settings(row, values).items():
            if key in values:
                values[key].add(value)
    told = [
        f"{key} is {', '.join(map(_plain, sorted(found, key=_rank))):.200}" if found else f"no run has {key}"
        for key, found in values.items()
    ]
    return "".join(f"; {one}" for one in told)


def _wish(text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not equals:
        raise InputError(f"{text:.200}: write KEY=VALUE, such as radio.range_m=4")
    try:
        return key, value if key in CONTENTS else _text(parse_document(value))
    except InputError as error:
        raise InputError(f"{key}: {error}") from None


def _text(value: object) -> str:
    """JSON that is the same for values that are equal: 4 and 4.0, and objects in any order."""
    return json.dumps(_plainest(value), sort_keys=True)


def _plainest(value: Any) -> Any:
    if isinstance(value, list):
        return [_plainest(one) for one in value]
    if isinstance(value, dict):
        return {key: _plainest(one) for key, one in value.items()}
    return int(value) if isinstance(value, float) and value.is_integer() and abs(value) < MAX_INT else value


def _settings(row: Row, keys: Iterable[str]) -> dict[str, str]:
    """Those settings of a run as JSON, as far as it has them, and its CONTENTS.

    Values are those of its configuration; a benchmark's case has none, but what it was given.
    """
    made = _flat(json.loads(row["settings"])) | _flat(json.loads(row.get("config", "{}")))
    return {key: _text(made[key]) for key in keys if key in made} | {key: row.get(key, "") for key in CONTENTS}


def _flat(tree: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Settings, and groups of them, by dotted key."""
    flat = {prefix + name: value for name, value in tree.items()}
    for name, value in tree.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{name}.")
    return flat


def _points(*sides: Sequence[Row]) -> list[list[Point]]:
    """What the runs of each side were made with: their CONTENTS, and each setting that was given for any of them.

    A run that several sweeps ask for is labelled by the first one only, which may have left a setting as it is.
    Settings that were given for no run are alike in a revision, and may be new in another.
    """
    given = (_flat(json.loads(row["settings"])) for rows in sides for row in rows)
    keys = {key for flat in given for key, value in flat.items() if not isinstance(value, dict)}
    return [[tuple(sorted(_settings(row, keys).items())) for row in rows] for rows in sides]


def medians(rows: Sequence[Row], measures: Sequence[str]) -> Sheet:
    """Medians over the seeds of runs that are alike in all else, and of how many values they are where a run has none.

    Raises InputError for a measure that no run has, and where two runs are alike in their seed, too.
    """
    _check(measures, rows)
    groups: dict[Point, list[Row]] = defaultdict(list)
    (points,) = _points(rows)
    for point, row in _by_point(rows, points, []).items():
        groups[_without(point, ["seed"])].append(row)
    varied = _varied(list(groups))
    groups = dict(sorted(groups.items(), key=lambda group: [_rank(dict(group[0]).get(key, "")) for key in varied]))
    heads = [*varied, "runs", "failed"]
    lines: list[list[str | int | Estimate | None]] = []
    for point, alike in groups.items():
        failed = sum(row["status"] != OK for row in alike)
        lines.append([*(_plain(dict(point).get(key, "")) for key in varied), len(alike), failed])
    unreached = {}
    for name in measures:
        found = [[value for row in alike if (value := value_of(row, name)) is not None] for alike in groups.values()]
        for number, values in enumerate(found):
            if never := sum(map(math.isinf, values)):
                unreached[number, len(heads)] = f"not reached ({never} of {len(values)})"
            lines[number].append(median(values))
        heads.append(name)
        if sum(map(len, found)) < sum(row["status"] == OK for row in rows):
            heads.append(f"{name} values")
            for line, values in zip(lines, found, strict=True):
                line.append(len(values))
    return Sheet("Medians", heads, lines, unreached)


def compare(first: str, second: str, measures: Sequence[str]) -> Sheet:
    """The runs that two texts select, compared; within each of the CONTENTS that a side has several of.

    Raises InputError.
    """
    (mine, keys), (theirs, others) = select(first), select(second)
    single = [column for column in CONTENTS if _is_single(mine, column) and _is_single(theirs, column)]
    sheet = compared(mine, theirs, [*keys, *others, *single], measures)
    return sheet._replace(title=f"{sheet.title}: {first} less {second}")


def _is_single(rows: Sequence[Row], column: str) -> bool:
    """Whether runs have one revision, or one hash of each world or mind. Older results have no hash, which is one."""
    of = column.rpartition(".")[0]
    made = [_settings(row, [of]) for row in rows]
    return len({(one.get(of), one[column]) for one in made}) == len({one.get(of) for one in made})


def compared(first: Sequence[Row], second: Sequence[Row], besides: Sequence[str], measures: Sequence[str]) -> Sheet:
    """Of runs in pairs that are alike in all but the settings `besides`, seeds included: what the first have more.

    Raises InputError where nothing pairs, two runs of a side have one partner, or no run has a measure.
    """
    _check(measures, [*first, *second])
    if not (pairs := _pairs(first, second, besides)):
        raise InputError(f"no two of these runs {ALIKE}")
    return _differences(pairs, measures)


def _pairs(first: Sequence[Row], second: Sequence[Row], besides: Sequence[str]) -> list[tuple[Row, Row]]:
    """Runs that are alike in all but the settings `besides`. Raises InputError where two of a side have one partner."""
    groups = {key.partition(".")[0] for key in besides}
    besides = [*besides, *(column for column in CONTENTS if column.partition(".")[0] in groups)]
    mine, theirs = (
        _by_point(rows, points, besides) for rows, points in zip((first, second), _points(first, second), strict=True)
    )
    return [(row, other) for point, row in mine.items() if (other := theirs.get(point)) is not None]


def _differences(pairs: Sequence[tuple[Row, Row]], measures: Sequence[str]) -> Sheet:
    """What the first of each pair have more, a line a measure; of no pairs nothing."""
    lines: list[list[str | int | Estimate | None]] = []
    for measure in measures:
        values = [(value_of(row, measure), value_of(other, measure)) for row, other in pairs]
        both = [(a, b) for a, b in values if a is not None and b is not None]
        neither = sum(math.isinf(a) and math.isinf(b) for a, b in both)
        found = difference(both, measure) if neither < len(both) else None  # times that nobody has are not equal ones
        lines.append([measure, len(both), len(pairs) - len(both), *(found or (None, None)), neither])
    heads = ["measure", "pairs", "without", "median difference", "P(better)", "neither reached"]
    return Sheet("Differences by seed", heads, lines)


def against(rows: Sequence[Row], wish: str, measures: Sequence[str]) -> Sheet:
    """The same for each other value of a setting, compared with the runs with KEY=VALUE.

    Of a value without pairs the lines say so. Raises InputError where none has any, and as `compared`.
    """
    _check(measures, rows)
    try:
        key, value = _wish(wish)
    except InputError as error:
        raise InputError(f"--against {error}") from None
    by_value: defaultdict[str, list[Row]] = defaultdict(list)
    for row in rows:
        by_value[_settings(row, [key]).get(key, "")].append(row)
    if value not in by_value or len(by_value) < 2:
        there = ", ".join(_plain(one) or "none" for one in sorted(by_value, key=_rank))
        raise InputError(
            f"--against {wish:.200}: there must be runs with it, and with another value; there are {there:.300}"
        )
    base, sheets = by_value.pop(value), []
    pairs = {other: _pairs(by_value[other], base, [key]) for other in sorted(by_value, key=_rank)}
    if not any(pairs.values()):
        raise InputError(f"--against {wish:.200}: no run with it and none with another value {ALIKE}")
    for other, those in pairs.items():
        sheet = _differences(those, measures)
        sheets.append(sheet._replace(lines=[[_plain(other), *line] for line in sheet.lines]))
    title = f"Differences by seed: {key}={', '.join(map(_plain, pairs))} less {_plain(value)}"
    return Sheet(title, [key, *sheets[0].heads], [line for one in sheets for line in one.lines])


def _by_point(rows: Sequence[Row], points: Sequence[Point], besides: Sequence[str]) -> dict[Point, Row]:
    """Runs by all but some settings. Raises InputError where two are alike."""
    found: dict[Point, Row] = {}
    for row, point in zip(rows, points, strict=True):
        if (other := found.setdefault(_without(point, besides), row)) is not row:
            one, two = _settings(row, besides), _settings(other, besides)
            if differ := [key for key in dict.fromkeys((*besides, *CONTENTS)) if one.get(key) != two.get(key)]:
                raise InputError(f"runs of a side differ only in {', '.join(differ)}: choose by DIR:{differ[0]}=VALUE")
            raise InputError(
                f"{row['key']} and {other['key']} are alike in all, seed and revision too: remove one of them"
            )
    return found


def _check(measures: Sequence[str], rows: Sequence[Row]) -> None:
    """Raise InputError for a measure that is a number, or missing, in none of the runs that did not fail."""
    columns = {name for row in rows if row["status"] == OK for name, value in row.items() if not isinstance(value, str)}
    for measure in measures:
        if columns and measure not in columns:
            raise InputError(f"--measure {measure:.100}: a result has {', '.join(sorted(columns)):.400}, ...")


def _without(point: Point, keys: Sequence[str]) -> Point:
    """The rest of the settings; a group's are left out with it."""
    return tuple(item for item in point if not any(f"{item[0]}.".startswith(f"{key}.") for key in keys))


def _varied(points: Sequence[Point]) -> list[str]:
    """Settings that not all have, or not with one value."""
    keys = sorted({key for point in points for key, _ in point})
    return [key for key in keys if len({dict(point).get(key) for point in points}) > 1]


def _rank(value: str) -> tuple[float, str]:
    """Where JSON stands in a table: nothing first, then numbers by size, then texts."""
    try:
        return (-math.inf, value) if value in ("", "null") else (float(value), value)
    except ValueError:
        return math.inf, value


def _plain(value: str) -> str:
    """JSON without the quotes of a text."""
    return value.strip('"')


def words(value: str | int | Estimate | None) -> str:
    """An entry as text; a figure with its interval, such as 0.95 [0.93, 0.97], or 0.95 [-] where there is none."""
    if isinstance(value, Estimate):
        ends = (value.low, value.high)
        return f"{_short(value.value)} [{', '.join(_short(end) for end in ends if end is not None) or '-'}]"
    return "-" if value is None else str(value)


def _short(value: float) -> str:
    return f"{value:.4g}".replace("inf", "∞")


def to_csv(sheet: Sheet) -> str:
    """Figures in three columns: NAME, NAME low and NAME high, the last two maybe empty; a time never reached is inf."""
    figures = {at for line in sheet.lines for at, value in enumerate(line) if isinstance(value, Estimate)}
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    spread = [[head, f"{head} low", f"{head} high"] if at in figures else [head] for at, head in enumerate(sheet.heads)]
    writer.writerow([head for heads in spread for head in heads])
    for line in sheet.lines:
        cells: list[str | float | None] = []
        for at, value in enumerate(line):
            if isinstance(value, Estimate):
                cells.extend(value)
            else:
                cells.extend(["", "", ""] if at in figures else [words(value)])
        writer.writerow(cells)
    return out.getvalue()


def to_latex(sheet: Sheet) -> str:
    """A tabular for the package booktabs."""
    rows: list[Sequence[str | int | Estimate | None]] = [sheet.heads, *sheet.lines]
    lines = [" & ".join(_tex(words(value)) for value in row) + r" \\" for row in rows]
    lines = [re.sub(r"^[\[*]", r"{\g<0>}", line) for line in lines]  # else it belongs to \\ or \midrule before it
    begin = r"\begin{tabular}{" + "l" * len(sheet.heads) + "}"
    return "\n".join([begin, r"\toprule", lines[0], r"\midrule", *lines[1:], r"\bottomrule", r"\end{tabular}", ""])


def _tex(text: str) -> str:
    special = {"∞": r"$\infty$", "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    return "".join(special.get(letter) or (f"\\{letter}" if letter in "_%&#${}" else letter) for letter in text)


def draw(sheet: Sheet, file: Path) -> None:
    """A PNG of the sheet's figures, if it has some. Raises UnwritableError."""
    columns = [at for at in range(len(sheet.heads)) if any(isinstance(line[at], Estimate) for line in sheet.lines)]
    if not columns:
        return
    settings = [at for at in range(min(columns)) if any(isinstance(line[at], str) for line in sheet.lines)]
    if "measure" in sheet.heads:
        settings.remove(sheet.heads.index("measure"))
    labels = [", ".join(words(line[at]) for at in settings) for line in sheet.lines]
    make = _panels_of_differences if "measure" in sheet.heads else _panels_of_medians
    picture.draw(sheet.title, ", ".join(sheet.heads[at] for at in settings), make(sheet, labels), file)


def _panels_of_medians(sheet: Sheet, labels: Sequence[str]) -> list[Panel]:
    """One for each measure."""
    panels = []
    for at in range(sheet.heads.index("failed") + 1, len(sheet.heads)):
        if isinstance(sheet.lines[0][at], int):
            continue  # of how many values the median before it is
        rows = []
        for number, (label, line) in enumerate(zip(labels, sheet.lines, strict=True)):
            figure = value if isinstance(value := line[at], Estimate) else None
            told = figure is not None and math.isfinite(figure.value)
            rows.append((label, figure, "" if told else sheet.unreached.get((number, at), "-")))
        panels.append(Panel(titled(sheet.heads[at]), rows))
    return panels


def _panels_of_differences(sheet: Sheet, labels: Sequence[str]) -> list[Panel]:
    """One for each measure, with P(better) in words."""
    at, never, chance = (sheet.heads.index(head) for head in ("measure", "neither reached", "P(better)"))
    rows: defaultdict[str, list[tuple[str, Estimate | None, str]]] = defaultdict(list)
    for label, line in zip(labels, sheet.lines, strict=True):
        off = line[sheet.heads.index("median difference")]
        told = f"P(better) {words(line[chance])}" if isinstance(off, Estimate) else "-"
        told += f", neither reached: {line[never]}" if line[never] else ""
        rows[str(line[at])].append((label, off if isinstance(off, Estimate) else None, told))
    return [Panel(titled(measure), those, 0.0) for measure, those in rows.items()]


def show(sheets: Sequence[Sheet], out: Path | None) -> None:
    """Print tables, and write each to out/TITLE as csv, tex and png. Raises InputError, UnwritableError."""
    if out is not None:
        make_folder(out)
    console = Terminal(stderr=False, least_width=WIDTH)
    for sheet in sheets:
        table = Table(*sheet.heads, title=sheet.title, title_justify="left", box=SIMPLE_HEAD)
        for line in sheet.lines:
            add_row(table, *map(words, line))
        console.print(table)
    if out is None:
        return
    stems = [out / sheet.title.split(" ")[0].lower() for sheet in sheets]
    for sheet, stem in zip(sheets, stems, strict=True):
        write_whole(stem.with_suffix(".csv"), to_csv(sheet))
        write_whole(stem.with_suffix(".tex"), to_latex(sheet))
    for sheet, stem in zip(sheets, stems, strict=True):  # last, as pictures take the longest
        draw(sheet, stem.with_suffix(".png"))
