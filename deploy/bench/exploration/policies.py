"""The default states: the four of the paper, and ours. What each finds after the last frontier, and at what cost."""

from __future__ import annotations

from collections.abc import Mapping
from typing import get_args

from agent.exploration.config import DefaultState
from deploy.bench.bars import Column, Section
from deploy.bench.cases import Case, Figures
from deploy.bench.exploration.runs import grouped, measure_run, median, settings

WORLDS = ["hall", "maze-15"]
"""One with pillars that stand free and are out of range from the walls, and one without."""
SEEDS = 3


def cases(quick: bool) -> list[Case]:
    """Every state in every world. Sweeps on the way belong to the states that sweep, not to the others."""
    return [
        Case(
            f"policies/{world}/{state}/{seed}",
            measure_run,
            {"world": settings(world, seed), "agent": {"exploration": {"default_state": state}}},
        )
        for world in ([] if quick else WORLDS)
        for state in get_args(DefaultState)
        for seed in range(SEEDS)
    ]


def sections(figures: Mapping[str, Figures]) -> list[Section]:
    """One row for each state and world; `ours` must find all."""
    columns = [
        Column("world", "world"),
        Column("state", "default state"),
        Column("complete", "complete", at_least=1.0, digits=2),
        Column("wall_recall", "recall, worst", digits=4),
        Column("ended_at", "complete s", digits=0),
        Column("path_m", "path m", digits=0),
    ]
    rows = []
    for group, runs in grouped(figures, "policies").items():
        world, state = group.split("/")
        rows.append(
            {
                "world": world,
                "state": state,
                "complete": sum(run["ended"] == "complete" and bool(run["reason"]) for run in runs) / len(runs),
                "wall_recall": min(run["wall_recall"] for run in runs),
                "ended_at": median(runs, "ended_at"),
                "path_m": median(runs, "path_m"),
            }
        )
    return [Section("policies", "Default states; times and paths are medians", columns, rows)]
