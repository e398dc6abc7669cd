"""Ambiguous associations: many walls 0.15 to 0.3 m apart at 0.03 m range noise, filters of several sizes on one record.

Every filter gets the same scans of the same run, so that the maps differ by the filter alone and not by the way
driven. A map is judged all along the run, not only at its end, where one hypothesis has had time to mend itself.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from deploy.bench.cases import Case, Figures, each
from deploy.bench.filter.recording import HERE, ScanRecording, record
from deploy.bench.layouts import written
from deploy.bench.tables import Outcomes, Row, Table, mean, runs_of
from deploy.metrics import Truth, score
from protocol.wireframe import Wireframe

NOISE_M = 0.03
EVERY_TICKS = 50  # between two judgements of the map: 10 simulated seconds


def double_walls() -> dict[str, Any]:
    """Fields of a world file: a room of 7 m by 5 m with stairs, niches, ribs and plates before its walls.

    Steps, depths and distances go from 0.15 to 0.30 m, so that at 0.03 m noise a hit on one wall may be taken for one
    on the wall behind.
    """
    boxes: list[list[float]] = [[3.5, y, 0.0, 7.2, 0.1] for y in (-0.05, 5.05)]
    boxes += [[x, 2.5, 0.0, 0.1, 5.2] for x in (-0.05, 7.05)]
    depth = 0.0
    for step, rise in enumerate((0.15, 0.2, 0.25, 0.3)):  # stairs along the lower wall
        depth += rise
        boxes.append([1.0 + 0.8 * step, depth / 2, 0.0, 0.8, depth])
    for rib, deep in enumerate((0.15, 0.2, 0.25, 0.3)):  # ribs and niches along the upper wall
        boxes.append([1.0 + 1.2 * rib, 5.0 - deep / 2, 0.0, 0.5, deep])
    for plate, away in enumerate((0.15, 0.2, 0.25)):  # thin plates before the right wall
        boxes.append([7.0 - away, 0.8 + 1.5 * plate, 0.0, 0.03, 0.9])
    for k, gap in enumerate((0.15, 0.3)):  # two pairs of parallel plates in the room
        boxes += [[2.2 + 2.2 * k, y, 0.0, 0.8, 0.03] for y in (2.9, 2.9 + gap)]
    return {"name": "double-walls", "units": "m", "boxes": boxes, "spawns": [[1.0, 2.0, 0.3]]}


def measure_ambiguous(seed: int, particles: Sequence[int], limit_s: float) -> Figures:
    """Figures by size of the filter."""
    run = record(written(double_walls()), seed, NOISE_M, limit_s)
    return {str(n): _replay(run, n) for n in particles}


def _replay(run: ScanRecording, particles: int) -> Figures:
    mind = run.new_filter(particles)
    along: list[Figures] = []
    for tick in range(len(run.scans)):
        run.show(mind, tick)
        if tick % EVERY_TICKS == EVERY_TICKS - 1:
            along.append(_judge(mind.wireframe(), run.truth))
    end = _judge(mind.wireframe(), run.truth)
    return {**end, **{f"along_{key}": float(np.mean([one[key] for one in along])) for key in ("walls", "corners")}}


def _judge(wireframe: Wireframe, truth: Truth) -> Figures:
    """The score, and its recall and precision as one figure each for walls and corners (F1)."""
    got = score(wireframe, HERE, truth)
    rates = {"walls": (got.wall_recall, got.wall_precision), "corners": (got.corner_recall, got.corner_precision)}
    known = {key: (recall or 0.0, precision or 0.0) for key, (recall, precision) in rates.items()}
    return got._asdict() | {key: 2 * r * p / max(r + p, 1e-9) for key, (r, p) in known.items()}


def cases(quick: bool) -> list[Case]:
    """One hypothesis against several sizes of filter."""
    fixed = {"particles": [1, 5, 10] if quick else [1, 5, 10, 30, 100], "limit_s": 60.0 if quick else 400.0}
    return each("ambiguous/{seed}", measure_ambiguous, fixed, seed=range(1 if quick else 10))


def _rows(figures: Outcomes) -> list[Row]:
    """Means over the runs by size of the filter."""
    runs = runs_of(figures, "ambiguous/*")
    rows: list[Row] = []
    for n in runs[0] if runs else ():
        means = {key: mean([run[n] for run in runs], key) for key in runs[0][n]}
        pairs = [(run[n][key], run["1"][key]) for run in runs for key in ("along_walls", "along_corners")]
        wins = [0.5 if ours == one else float(ours > one) for ours, one in pairs]
        ahead = {} if n == "1" else {"ahead": 100.0 * sum(wins) / len(wins)}
        rows.append({"particles": int(n), "runs": len(runs), **means, **ahead})
    return rows


TABLES = [
    Table(
        "ambiguous",
        f"Parallel walls 0.15 to 0.3 m apart, {NOISE_M} m range noise",
        _rows,
        "particles; runs; wall_recall: recall; wall_precision: precision; wall_rmse_m; corners: corner F1; repeated; "
        "along_walls: walls F1, along; along_corners: corner F1, along; ahead >= 50.1: ahead of one, along %",
        judged=lambda row: row["particles"] != 1,
        note="Means over runs; along: mean over the run, every 10 s. Ahead: share of runs and figures, a tie is half. "
        "But for the noise, ideal sensing.",
        sensing=f"ideal, but {NOISE_M} m range noise",
    )
]
