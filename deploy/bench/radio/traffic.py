"""Whole runs of three robots in the maze: bytes in every form, and what a bad radio does to the maps."""

from __future__ import annotations

import csv
import json
import math
import tempfile
from collections.abc import Mapping
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np

from deploy.bandwidth.books import read_books
from deploy.bandwidth.representations import NAMES
from deploy.bandwidth.representations import measure as measure_run
from deploy.bench.bars import Column, Section
from deploy.bench.cases import Case, Figures
from deploy.bench.explored import explore
from protocol.geometry import Pose, relative, wrapped

BAD = [
    {"kind": "bernoulli", "loss": 0.3},
    {"kind": "latency", "ticks": 5},
    {"kind": "capacity", "bytes_per_s": 5000},
]
"""30 % loss, 1 s of latency, 5 kB/s."""
JUDGED = "3 robots in maze-15"
"""What the bars on bytes are for; a quick bench has a smaller run, in which first contacts weigh more."""
FALSE_M, FALSE_DEG = 0.3, 5.0
"""An accepted transform farther off than this is false: walls of two rooms are farther apart."""


def cases(quick: bool) -> list[Case]:
    """Ten seeds, each with a perfect and with a bad radio."""
    world = {"world": "apartment" if quick else "maze-15", "robots": 2 if quick else 3}
    made = []
    for seed in range(1 if quick else 10):
        for radio, models in (("perfect", []), ("bad", BAD)):
            settings = {**world, "seed": seed, "radio": {"models": models}}
            made.append(Case(f"{radio}/{seed}", measure_traffic, {"world": settings}))
    return made


def measure_traffic(world: Mapping[str, Any]) -> Figures:
    """Bytes, recall, false merges and farthest delivery of one run."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        run = explore(world, {}, out=out)
        books = read_books(out)  # which balance, or there are no figures
        measurement = measure_run(out, run.episode.config)
        tracks = {robot: np.loadtxt(out / "trajectories" / f"{robot}.tum")[:, 1:3] for robot in run.robots}
        with (out / "radio.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        events = [json.loads(line) for line in (out / "events.jsonl").read_text(encoding="utf-8").splitlines()]
    heard = [row for row in rows if row["outcome"] == "delivered"]
    away = [math.dist(*(tracks[row[end]][int(row["tick"])] for end in ("sender", "receiver"))) for row in heard]
    scores = {robot: run.figures(robot) for robot in run.robots}
    merges = [event for event in events if event["event"] == "accepted"]
    return {
        "run": f"{len(run.robots)} robots in {world['world']}",
        "bytes": measurement.totals(),
        "beacon_bytes": measurement.beacon_bytes,
        "viewpoint_bytes": measurement.viewpoint_bytes,
        "updates": len(measurement.updates),
        "kinds": {kind: sum(row["kind"] == kind for row in rows) for kind in sorted({row["kind"] for row in rows})},
        "links": len(books["links"]),
        "recall": [score["wall_recall"] for score in scores.values()],
        "precision": [score["wall_precision"] for score in scores.values()],
        "ended": [score["ended"] for score in scores.values()],
        "merges": len(merges),
        "false_merges": sum(_is_false(event, {robot: run.frame(robot) for robot in run.robots}) for event in merges),
        "range_m": run.episode.config.radio.range_m,
        "farthest_m": max(away, default=0.0),
        "delivered": len(heard),
        "ended_at": run.episode.t,
    }


def _is_false(event: Mapping[str, Any], frames: Mapping[str, Pose]) -> bool:
    true = relative(frames[event["robot"]], frames[event["peer"]])
    x, y, theta = event["transform"]
    turn = wrapped(theta - true[2])
    return math.hypot(x - true[0], y - true[1]) > FALSE_M or abs(math.degrees(turn)) > FALSE_DEG


def sections(figures: Mapping[str, Figures]) -> list[Section]:
    """Bytes against the other forms; the bad radio against the perfect one; range."""
    perfect, bad = (
        {name.partition("/")[2]: one for name, one in figures.items() if name.startswith(f"{radio}/")}
        for radio in ("perfect", "bad")
    )
    return [_forms(perfect), _bad_radio(perfect, bad), _range(perfect, bad)]


def _forms(perfect: Mapping[str, Figures]) -> Section:
    rows: list[dict[str, Any]] = []
    for seed, one in perfect.items():
        ratios = {name: one["bytes"]["delta"] / size if size else None for name, size in one["bytes"].items()}
        delta, full = one["bytes"]["delta"], one["bytes"]["full"]
        viewed = (delta + one["viewpoint_bytes"]) / full if full else None
        rows.append({"seed": seed, **ratios, "updates": one["updates"], "delta": delta, "viewed": viewed})
    if rows:
        known = {name: [row[name] for row in rows if row[name] is not None] for name in [*NAMES, "updates", "viewed"]}
        rows.append({"seed": "median", **{name: median(values) for name, values in known.items() if values}})
    columns = [
        Column("seed", "seed"),
        Column("updates", "updates", digits=0),
        Column("delta", "delta\nbytes", digits=0),
        Column("full", "delta /\nfull", at_most=1 / 3),
        Column("viewed", "with view-\npoints"),
        Column("json", "json", digits=4),
        Column("grid_raw", "grid_raw", digits=5),
        Column("grid_zlib", "grid_zlib", at_most=0.1, digits=4),
        Column("grid_delta_zlib", "grid_delta\n_zlib", at_most=1, digits=4),
        Column("grid_png", "grid_png", digits=4),
        Column("scans_raw", "scans_raw", at_most=0.001, digits=5),
        Column("scans_zlib", "scans_zlib", digits=5),
        Column("points", "points", digits=5),
    ]
    runs = ", ".join(sorted({one["run"] for one in perfect.values()}))
    judged = runs == JUDGED
    note = f"{runs}: bytes of delta over those of each form. The median of the seeds is judged, for {JUDGED} only. "
    note += "`with viewpoints`: delta and what robots said of where they have looked from, over full alone."
    return Section("traffic", "Map traffic", columns, rows, frozenset(range(len(rows) - judged)), note)


def _bad_radio(perfect: Mapping[str, Figures], bad: Mapping[str, Figures]) -> Section:
    rows: list[dict[str, Any]] = []
    for seed in perfect.keys() & bad.keys():
        good, poor = perfect[seed], bad[seed]
        row = {"seed": seed, "perfect": mean(good["recall"]), "bad": mean(poor["recall"])}
        row |= {"less": row["perfect"] - row["bad"], "precision": mean(poor["precision"]), "merges": poor["merges"]}
        row |= {"false_merges": poor["false_merges"] + good["false_merges"], "delta": poor["bytes"]["delta"]}
        row["resent"] = poor["kinds"].get("resend", 0)
        rows.append(row)
    rows.sort(key=lambda row: int(row["seed"]))
    if rows:
        averages = {key: mean(row[key] for row in rows) for key in ("perfect", "bad", "less", "precision", "delta")}
        totals = {key: sum(row[key] for row in rows) for key in ("merges", "false_merges", "resent")}
        rows.append({"seed": "all", **averages, **totals})
    columns = [
        Column("seed", "seed"),
        Column("perfect", "recall,\nperfect", digits=4),
        Column("bad", "recall,\nbad", digits=4),
        Column("less", "less", at_most=0.02, digits=4),
        Column("precision", "precision,\nbad", digits=4),
        Column("merges", "merges,\nbad"),
        Column("false_merges", "false\nmerges", at_most=0),
        Column("delta", "delta\nbytes", digits=0),
        Column("resent", "sent\nagain"),
    ]
    note = "Bad: 30 % loss, 1 s latency, 5 kB/s. Wall recall, mean of the robots. `merges` counts accepted proposals."
    return Section("bad", "A bad radio against a perfect one", columns, rows, note=note)


def _range(perfect: Mapping[str, Figures], bad: Mapping[str, Figures]) -> Section:
    runs = [*perfect.values(), *bad.values()]
    beyond = sum(one["farthest_m"] > one["range_m"] for one in runs)
    row = {"runs": len(runs), "delivered": sum(one["delivered"] for one in runs), "beyond": beyond}
    row["farthest_m"] = max((one["farthest_m"] for one in runs), default=None)
    columns = [
        Column("runs", "runs"),
        Column("delivered", "delivered"),
        Column("farthest_m", "farthest m", digits=4),
        Column("beyond", "runs with a delivery beyond the range", at_most=0),
    ]
    note = "From trajectories/ and radio.csv; 50 more runs are in tests/world/test_air.py."
    return Section("range", "Range", columns, [row] if runs else [], note=note)
