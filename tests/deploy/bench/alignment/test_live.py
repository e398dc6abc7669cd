"""What sharing and division are worth, of runs that did not all reach 99 %."""

import json
from pathlib import Path
from typing import Any

from deploy.bench.alignment import live
from deploy.bench.tables import Section
from deploy.revision import ROOT

PAIRED = range(live.PAIRED_SEEDS)


def section(name: str, figures: dict[str, Any]) -> Section:
    return next(table for table in live.TABLES if table.name == name).section(figures)


def sharing(on: list[float | None], off: list[float | None]) -> Section:
    figures = {f"live/maze-15/{seed}": {"t_99": t} for seed, t in enumerate(on)}
    return section(
        "sharing", figures | {f"unshared/{seed}": {"world": "maze-15", "t_99": t} for seed, t in enumerate(off)}
    )


def division(divided: list[float | None], alone: list[float | None]) -> Section:
    figures: dict[str, Any] = {f"live/maze-15/{seed}": {"team": t} for seed, t in enumerate(divided)}
    for seed in PAIRED:
        figures[f"undivided/3/{seed}"] = {"team": 200.0}
        figures |= {f"alone/{seed}/{start}": {"team": alone[seed]} for start in range(3)}
    return section("division", figures)


def test_published_ratios_come_out_again() -> None:
    kept = json.loads((ROOT / "results/alignment-live.json").read_text())["sections"]["sharing"]
    *seeds, _ = kept["rows"]
    made = sharing([row["on"] for row in seeds], [row["off"] for row in seeds]).as_dict()
    assert made["rows"] == kept["rows"] and made["title"] == kept["title"] and made["met"] == kept["met"]


def test_division_is_judged_by_the_seeds_that_failed_too() -> None:
    """The one of ten that reached it met the bars."""
    assert division([100.0] * 10, [500.0] * 10).met is True
    failed = division([100.0] + [None] * 9, [500.0] * 10)
    assert failed.met is False and failed.rows[0]["ratio"] is None and failed.rows[0]["seeds"] == 10
    assert division([100.0] * 10, [None] * 6 + [500.0] * 4).rows[0]["ratio"] == 0.0
    neither = division([100.0] * 9 + [None], [500.0] * 9 + [None])
    assert neither.met is None and neither.rows[0]["seeds"] == 9


def test_division_is_drawn_where_no_robot_alone_reached_it(tmp_path: Path) -> None:
    division([100.0] * 10, [None] * 10).draw(drawn := tmp_path / "division.png")
    assert drawn.stat().st_size


def test_sharing_is_not_blamed_for_runs_that_fail_without_it() -> None:
    late = sharing([200.0] * 10, [None] * 6 + [500.0] * 4)
    assert late.met is True and late.rows[-1]["ratio"] == 0.0
    assert sharing([None] * 6 + [200.0] * 4, [500.0] * 10).rows[-1] == {
        "seed": "median",
        "ratio": None,
        "spread": "0.40 to ∞",
    }
    assert sharing([None] + [200.0] * 9, [None] + [500.0] * 9).met is None
