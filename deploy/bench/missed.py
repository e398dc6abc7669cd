"""The list of bars that published results miss, made from their files: `python -m deploy.bench.missed`."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from deploy.bench.tables import Row, label, text_of
from deploy.revision import ROOT
from protocol.files import write_whole

PAGE = ROOT / "results" / "README.md"
BEGIN, END = "<!-- made by `python -m deploy.bench.missed` -->", "<!-- end of what is made -->"


def told(folder: Path) -> str:
    """A sentence and a Markdown table of all bars that the tables in a folder's JSON files miss."""
    files = sorted(folder.glob("*.json"))
    lines = [line for file in files for line in _lines(file)]
    short = len({file for file, *_ in lines})
    sentence = f"Of {len(files)} files, {short} have a missed bar. A line is a bar; the value is its worst row's."
    heads = ("file", "section", "bar", "worst value", "of", "rows that miss it")
    table = [heads, tuple("---" for _ in heads), *lines]
    return "\n".join([sentence, "", *(f"| {' | '.join(line)} |" for line in table)])


def _lines(file: Path) -> Iterator[Sequence[str]]:
    for name, section in json.loads(file.read_text(encoding="utf-8"))["sections"].items():
        judged = [row for row in section["rows"] if row["missed"] is not None]
        for key, bar in section["bars"].items():
            if missing := [row for row in judged if key in row["missed"]]:
                worst = _worst(missing, key, bar)
                row = "-" if next(iter(worst)) == key else label(worst)
                counts = f"{len(missing)} of {len(judged)}"
                yield f"`{file.name}`", name, f"`{key}` {bar}", text_of(worst.get(key)), row, counts


def _worst(rows: Sequence[Row], key: str, bar: str) -> Row:
    """The row farthest beyond the bar; one without a value is the worst."""
    if lacking := [row for row in rows if not isinstance(row.get(key), int | float)]:
        return lacking[0]
    return (min if bar.startswith(">=") else max)(rows, key=lambda row: row[key])


def renewed(page: str, list_of_bars: str) -> str:
    """The page with this list between BEGIN and END. Raises ValueError where it lacks one of them."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"the page lacks {BEGIN} or {END}")
    return f"{before}{BEGIN}\n{list_of_bars}\n{END}{after}"


if __name__ == "__main__":
    write_whole(PAGE, renewed(PAGE.read_text(encoding="utf-8"), told(PAGE.parent)))
