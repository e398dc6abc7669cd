"""`wireswarm bench exploration`: whether exploration finishes, what it costs, and the bars it must meet."""

from __future__ import annotations

from pathlib import Path

from deploy.bench.bars import report
from deploy.bench.cases import measure_all
from deploy.bench.exploration import dense, mazes, policies, runs, speed, teams, tours

PARTS = (runs, teams, mazes, policies, tours, dense, speed)
"""Each has the cases of one question, and their tables."""


def measure(quick: bool, folder: Path, jobs: int | None) -> bool:
    """Measure what is not in `folder` yet and print all tables; whether every case has figures, whatever they say.

    Cases are kept under folder/exploration and the tables in folder/exploration.json, with -quick appended where
    quick.
    """
    name = "exploration-quick" if quick else "exploration"
    outcome = measure_all([case for part in PARTS for case in part.cases(quick)], folder / name, jobs)
    sections = [section for part in PARTS for section in part.sections(outcome.figures) if section.rows]
    report(name, sections, outcome.failed, folder / f"{name}.json")
    return not outcome.failed
