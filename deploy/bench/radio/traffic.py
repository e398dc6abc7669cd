"""Whole runs of three robots in the maze: bytes in every form, and what a bad radio does to the maps."""

import csv
import math
from collections import Counter
from collections.abc import Mapping
from statistics import fmean
from typing import Any

import numpy as np

from deploy.bandwidth.representations import NAMES
from deploy.bandwidth.representations import measure as measure_run
from deploy.bench.cases import Case, Figures
from deploy.bench.errors import false_of
from deploy.bench.explored import explore
from deploy.bench.tables import Outcomes, Row, Table, by_label, columns, mean, median, runs_of, total
from protocol.temporary import temporary_folder

BAD = [{"kind": "bernoulli", "loss": 0.3}, {"kind": "latency", "ticks": 5}, {"kind": "capacity", "bytes_per_s": 5000}]
"""30 % loss, 1 s of latency, 5 kB/s."""
JUDGED = "3 robots in maze-15"  # what the bars are for; in the smaller run of a quick bench first contacts weigh more


def cases(quick: bool) -> list[Case]:
    """Ten seeds, each with a perfect and with a bad radio."""
    world = {"world": "apartment" if quick else "maze-15", "robots": 2 if quick else 3}
    return [
        Case(f"{radio}/{seed}", measure_traffic, {"world": {**world, "seed": seed, "radio": {"models": models}}})
        for seed in range(1 if quick else 10)
        for radio, models in (("perfect", []), ("bad", BAD))
    ]


def measure_traffic(world: Mapping[str, Any]) -> Figures:
    """Bytes, recall, false merges and farthest delivery of one run."""
    with temporary_folder() as out:
        run = explore(world, {}, out=out)
        measurement = measure_run(out, run.episode.config)  # there are no figures where its books do not balance
        tracks = {robot: np.loadtxt(out / "trajectories" / f"{robot}.tum")[:, 1:3] for robot in run.robots}
        with (out / "radio.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    heard = [row for row in rows if row["outcome"] == "delivered"]
    away = [math.dist(*(tracks[row[end]][int(row["tick"])] for end in ("sender", "receiver"))) for row in heard]
    scores = [run.figures(robot) for robot in run.robots]
    merges = [(robot, event.data) for _, robot, event in run.events if event.event == "accepted"]
    return {
        "run": f"{len(run.robots)} robots in {world['world']}",
        "bytes": measurement.totals(),
        "viewpoint_bytes": measurement.viewpoint_bytes,
        "updates": len(measurement.updates),
        "kinds": dict(sorted(Counter(row["kind"] for row in rows).items())),
        "recall": [score["wall_recall"] for score in scores],
        "precision": [score["wall_precision"] for score in scores],
        "merges": len(merges),
        "false_merges": false_of(merges, {robot: run.frame(robot) for robot in run.robots}),
        "range_m": run.episode.config.radio.range_m,
        "farthest_m": max(away, default=0.0),
        "delivered": len(heard),
    }


def _run(figures: Outcomes) -> str:
    """What ran: robots and world."""
    return ", ".join(sorted({one["run"] for one in runs_of(figures, "perfect/*")}))


def _forms(figures: Outcomes) -> list[Row]:
    """Bytes of delta over those of each form, a row a seed and their median."""
    rows: list[Row] = []
    for seed, (one,) in by_label(figures, "perfect/{seed}").items():
        delta, full = one["bytes"]["delta"], one["bytes"]["full"]
        ratios = {name: delta / size if size else None for name, size in one["bytes"].items()}
        viewed = (delta + one["viewpoint_bytes"]) / full if full else None
        rows.append({"seed": seed, **ratios, "updates": one["updates"], "delta": delta, "viewed": viewed})
    known = {name: [row for row in rows if row[name] is not None] for name in (*NAMES, "updates", "viewed")}
    middle = {name: median(some, name) for name, some in known.items() if some}
    return [*rows, {"seed": "median", **middle, "judged": _run(figures) == JUDGED}] if rows else []


def _compared(figures: Outcomes) -> list[Row]:
    """The bad radio against the perfect one, a row a seed and one of them all."""
    rows: list[Row] = []
    bad = by_label(figures, "bad/{seed}")
    for seed, (good,) in sorted(by_label(figures, "perfect/{seed}").items(), key=lambda item: int(item[0])):
        for poor in bad.get(seed, ()):
            row: Row = {"seed": seed, "perfect": fmean(good["recall"]), "bad": fmean(poor["recall"])}
            row |= {"less": row["perfect"] - row["bad"], "precision": fmean(poor["precision"])}
            row |= {"merges": poor["merges"], "false_merges": poor["false_merges"] + good["false_merges"]}
            rows.append(row | {"delta": poor["bytes"]["delta"], "resent": poor["kinds"].get("resend", 0)})
    averages = {key: mean(rows, key) for key in ("perfect", "bad", "less", "precision", "delta")}
    totals = {key: total(rows, key) for key in ("merges", "false_merges", "resent")}
    return [*rows, {"seed": "all", **averages, **totals}] if rows else []


TABLES = [
    Table(
        "traffic",
        "Map traffic",
        _forms,
        f"seed; updates; delta: delta bytes; full <= {1 / 3}: delta / full; viewed: with viewpoints; json; "
        "grid_raw; grid_zlib <= 0.1; grid_delta_zlib <= 1; grid_png; scans_raw <= 0.001; scans_zlib; points",
        judged=lambda row: row["seed"] == "median",
        note=lambda figures: (
            f"{_run(figures)}: bytes of delta over those of each form. The median of the seeds is judged, for {JUDGED} "
            "only. `with viewpoints`: delta and what robots said of where they have looked from, over full alone."
        ),
    ),
    Table(
        "bad",
        "A bad radio against a perfect one",
        _compared,
        "seed; perfect: recall, perfect; bad: recall, bad; less <= 0.02; precision: precision, bad; "
        "merges: merges, bad; false_merges <= 0; delta: delta bytes; resent: sent again",
        note="Bad: 30 % loss, 1 s latency, 5 kB/s. Wall recall, mean of the robots. `merges`: accepted proposals.",
    ),
    Table(
        "range",
        "Range",
        "(?:perfect|bad)/*",
        columns(
            "runs count; delivered total; farthest_m most; beyond <= 0: runs with a delivery beyond the range",
            beyond=lambda runs, _: sum(run["farthest_m"] > run["range_m"] for run in runs),
        ),
        note="From trajectories/ and radio.csv; 50 more runs are in tests/world/radio/test_air.py.",
    ),
]
