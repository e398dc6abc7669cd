"""Generated mazes of 8 to 20 m: none may hold a robot for ever."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from deploy.bench.bars import Column, Section
from deploy.bench.cases import Case, Figures
from deploy.bench.exploration.runs import len_or, measure_run
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
        world = {"world": str(path), "robots": 1, "seed": seed, "starts": "random", "max_time_s": ceiling}
        found = measure_run(world, {})
    return found | {"width_m": width, "height_m": height, "ceiling_s": ceiling}


def cases(quick: bool) -> list[Case]:
    """Every maze once."""
    return [Case(f"mazes/{seed}", measure_maze, {"seed": seed}) for seed in range(1 if quick else MAZES)]


def sections(figures: Mapping[str, Figures]) -> list[Section]:
    """All mazes in one row, and those that miss a bar by themselves."""
    runs = {name: found for name, found in figures.items() if name.startswith("mazes/")}
    columns = [
        Column("mazes", "mazes"),
        Column("complete", "complete in time", at_least=1.0, digits=2),
        Column("silent", "open, no reason", at_most=0),
        Column("wall_recall", "recall", at_least=0.99, digits=4),
        Column("wall_contacts", "wall contacts", at_most=0),
        Column("share", "time of ceiling", at_most=1.0, digits=2),
        Column("stuck", "stuck"),
    ]
    rows = [{"mazes": name.removeprefix("mazes/"), **_row([found])} for name, found in runs.items()]
    bad = [row for row in rows if any(column.met(row.get(column.key)) is False for column in columns)]
    total = [{"mazes": f"all {len(runs)}", **_row(list(runs.values()))}] if runs else []
    return [
        Section("mazes", "Generated mazes of 8 to 20 m, worst figures; below, each that misses", columns, total + bad)
    ]


def _row(runs: list[Figures]) -> Figures:
    return {
        "complete": sum(run["ended"] == "complete" for run in runs) / len(runs),
        "silent": max(len_or(run["silent"]) for run in runs),
        "wall_recall": min(run["wall_recall"] for run in runs),
        "wall_contacts": max(run["wall_contacts"] for run in runs),
        "share": max(run["ended_at"] / run["ceiling_s"] for run in runs),
        "stuck": max(run["stuck"] for run in runs),
    }
