"""Generated mazes of 8 to 20 m: none may hold a robot for ever."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import numpy as np

from deploy.bench.cases import Case, Figures, each
from deploy.bench.explored import measure_run
from deploy.bench.tables import Column, Outcomes, Row, Table, grouped, least, most, row_of, share
from world.maze import MAX_SIDE_M, MIN_SIDE_M, generate

MAZES = 50
CEILING_S_M2 = 4.5
"""Simulated seconds that a square metre of maze may take: 1000 s for 15 m x 15 m, half as much again as its bar."""


def measure_maze(seed: int) -> Figures:
    """One robot from a start drawn from the seed, in the maze of that seed."""
    rng = np.random.default_rng(seed)
    width, height = rng.uniform(MIN_SIDE_M, MAX_SIDE_M, 2).tolist()
    ceiling = CEILING_S_M2 * width * height
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "maze.yaml"
        path.write_text(json.dumps(generate(width, height, rng)), encoding="utf-8")
        found = measure_run(str(path), seed, ceiling, "random")
    return found | {"width_m": width, "height_m": height, "ceiling_s": ceiling}


def cases(quick: bool) -> list[Case]:
    """Every maze once."""
    return each("mazes/{seed}", measure_maze, seed=range(1 if quick else MAZES))


COLUMNS = [
    Column("mazes", "mazes"),
    Column("complete", "complete in time", share(lambda run: run["ended"] == "complete"), at_least=1.0, digits=2),
    Column("silent", "open, no reason", most, at_most=0),
    Column("wall_recall", "recall", least, at_least=0.99, digits=4),
    Column("wall_contacts", "wall contacts", most, at_most=0),
    Column(
        "share",
        "time of ceiling",
        lambda runs, _: max(run["ended_at"] / run["ceiling_s"] for run in runs),
        at_most=1.0,
        digits=2,
    ),
    Column("stuck", "stuck", most),
]


def _rows(figures: Outcomes) -> list[Row]:
    """All mazes in one row, and those that miss a bar by themselves."""
    groups = grouped(figures, "mazes/{mazes}")
    rows = [row_of(COLUMNS, runs, labels) for labels, runs in groups]
    bad = [row for row in rows if any(column.met(row[column.key]) is False for column in COLUMNS)]
    every = [run for _, runs in groups for run in runs]
    return [row_of(COLUMNS, every, {"mazes": f"all {len(every)}"}), *bad] if every else []


TABLES = [Table("mazes", "Generated mazes of 8 to 20 m, worst figures; below, each that misses", COLUMNS, _rows)]
