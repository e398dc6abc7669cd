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


def test_a_page_without_the_list_is_refused() -> None:
    with pytest.raises(ValueError, match="lacks"):
        renewed("# Results", "")
