"""The list of missed bars is that of the committed files, and none of theirs is left out."""

import json
from pathlib import Path

import pytest

from deploy.bench.missed import PAGE, renewed, told
from deploy.bench.tables import Table


def test_the_page_of_results_lists_the_bars_that_are_missed_now() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert page == renewed(page, told(PAGE.parent)), "run `python -m deploy.bench.missed`"


def test_every_section_that_is_not_met_is_listed() -> None:
    listed = told(PAGE.parent)
    for file in PAGE.parent.glob("*.json"):
        for section, met in json.loads(file.read_text(encoding="utf-8"))["met"].items():
            assert (f"| `{file.name}` | {section} |" in listed) == (met is False), (file.name, section)


def test_a_bar_is_listed_once_with_its_worst_row(tmp_path: Path) -> None:
    rows = [{"world": "a", "t": 4, "share": 1.0}, {"world": "b", "t": 9, "share": None}, {"world": "c", "t": 1}]
    section = Table("one", "One", lambda _: [dict(row) for row in rows], "world; t <= 3; share >= 0.5").section({})
    document = {"sections": {"one": section.as_dict(), "none": {"bars": {}, "rows": [{"x": 1, "missed": None}]}}}
    (tmp_path / "some.json").write_text(json.dumps(document))
    (tmp_path / "met.json").write_text(json.dumps({"sections": {}}))
    assert told(tmp_path).splitlines()[0].startswith("Of 2 files, 1 have a missed bar.")
    assert told(tmp_path).splitlines()[4:] == [
        "| `some.json` | one | `t` <= 3 | 9 | b | 2 of 3 |",
        "| `some.json` | one | `share` >= 0.5 | - | b | 2 of 3 |",
    ]


def test_the_docs_tell_of_sharing_and_division_what_the_results_say() -> None:
    kept = json.loads((PAGE.parent / "alignment-live.json").read_text(encoding="utf-8"))["sections"]
    page = (PAGE.parents[1] / "docs/cooperation.md").read_text(encoding="utf-8")
    said = page.partition("### What sharing and division buy")[2]
    *seeds, sharing = kept["sharing"]["rows"]
    verdict = {True: ": missed", False: ": met"}
    rows = [(3, len(seeds), sharing, "ratio", sharing["spread"], kept["sharing"]["bars"]["ratio"])]
    for key in ("ratio", "sooner"):
        for row in kept["division"]["rows"]:
            spread = row["spread"] if key == "ratio" else "not kept"
            bar = "none" if row["missed"] is None else kept["division"]["bars"][key]
            rows.append((row["robots"], row["seeds"], row, key, spread, bar))
    for robots, n, row, key, spread, bar in rows:
        judged = "" if bar == "none" else verdict[key in row["missed"]]
        assert f"| {robots} | {n} | {row[key]:.2f} | {spread} | {bar}{judged} |" in said


def test_a_page_without_the_list_is_refused() -> None:
    with pytest.raises(ValueError, match="lacks"):
        renewed("# Results", "")
