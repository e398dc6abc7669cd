"""The radio's benchmark: false merges are found, medians are judged, and a quick run has all its tables."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deploy.bench.benchmark import Benchmark
from deploy.bench.errors import errors, false_of
from deploy.bench.radio.traffic import JUDGED, TABLES
from deploy.bench.tables import Section
from protocol.status import Status

FRAMES = {"r1": (1.0, 2.0, 0.3), "r2": (4.0, 2.5, -1.0)}


def accepted(x: float = 0.0, y: float = 0.0, theta: float = 0.0) -> dict[str, Any]:
    """An event with the true transform of r2's frame into r1's, moved."""
    c, s = math.cos(0.3), math.sin(0.3)
    true = (c * 3.0 + s * 0.5, c * 0.5 - s * 3.0, -1.3)
    return {"robot": "r1", "peer": "r2", "transform": [true[0] + x, true[1] + y, true[2] + theta]}


def is_false(event: dict[str, Any]) -> bool:
    return false_of([("r1", event)], FRAMES) == 1


def traffic_sections(figures: dict[str, Any]) -> list[Section]:
    return [table.section(figures) for table in TABLES]


def test_a_merge_is_false_where_the_frames_are_elsewhere() -> None:
    assert not is_false(accepted())
    assert not is_false(accepted(0.1, -0.1, 2 * math.pi + 0.02))
    assert is_false(accepted(x=0.5)) and is_false(accepted(x=0.27))  # of the scorer's bounds
    assert is_false(accepted(theta=math.pi / 2))


def test_a_merge_is_judged_where_the_scorer_does_and_told_in_the_middle_of_the_map() -> None:
    """Live runs judged it in that middle: 0.56 m off 8 m away, by 4 degrees, which are right at the frame's origin."""
    event = accepted(theta=math.radians(4))
    assert errors(event["transform"], FRAMES["r1"], FRAMES["r2"], np.array([8.0, 0.0]))[0] > 0.5
    assert not is_false(event)


def run(delta: int, recall: float, farthest: float = 3.9, false_merges: int = 0, where: str = JUDGED) -> dict[str, Any]:
    sizes = {"full": 3000, "json": 10**5, "grid_raw": 10**6, "grid_zlib": 10**5, "grid_delta_zlib": 2000}
    sizes |= {"grid_png": 10**5, "scans_raw": 10**7, "scans_zlib": 10**7, "points": 10**6}
    return {
        "run": where,
        "bytes": {"delta": delta, **sizes}, "beacon_bytes": 1, "viewpoint_bytes": 300, "updates": 9,
        "kinds": {"resend": 2}, "links": 6,
        "recall": [recall, recall], "precision": [1.0, 1.0], "ended": ["complete"] * 2, "merges": 1,
        "false_merges": false_merges, "range_m": 4.0, "farthest_m": farthest, "delivered": 5, "ended_at": 100.0,
    }  # fmt: skip


def test_the_median_of_the_seeds_is_judged() -> None:
    deltas = (900, 950, 5000)
    figures = {f"perfect/{seed}": run(delta, 1.0) for seed, delta in enumerate(deltas)}
    traffic, bad, reach = traffic_sections(figures | {f"bad/{seed}": run(1000, 0.99) for seed in range(3)})
    assert traffic.met and traffic.rows[-1]["full"] == pytest.approx(950 / 3000)
    assert traffic.rows[-1]["viewed"] == pytest.approx(1250 / 3000)
    assert bad.met and reach.met
    worse = traffic_sections(figures | {"perfect/0": run(1200, 1.0), "bad/0": run(1, 0.9, 4.1, 1)})
    elsewhere = {name: {**one, "run": "2 robots in apartment"} for name, one in figures.items()}
    assert traffic_sections(elsewhere)[0].met is None
    assert worse[0].met is False and worse[1].met is False and worse[2].met is False


@pytest.mark.slow
def test_a_quick_run_has_all_tables(tmp_path: Path) -> None:
    assert Benchmark("radio").run(True, tmp_path, 1) == Status.OK  # a quick one is not judged
    document = json.loads((tmp_path / "radio-quick.json").read_text())
    assert set(document["sections"]) == {"codec", "traffic", "bad", "range", "cost", "wire"}
    assert document["met"]["codec"] and document["met"]["range"] and document["met"]["wire"]
