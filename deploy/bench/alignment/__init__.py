"""`wireswarm bench alignment`: pairs of partial maps, our features against 4PCS and ICP, and robots that merge."""

from __future__ import annotations

from pathlib import Path

from deploy.bench.alignment import cost, tables, trials
from deploy.bench.bars import report
from deploy.bench.cases import measure_all


def measure(quick: bool, folder: Path, jobs: int | None) -> bool:
    """Measure what is not in `folder` yet and print all tables; whether every case has figures, whatever they say.

    Cases are kept under folder/alignment and the tables in folder/alignment.json, with -quick appended where quick.
    """
    name = "alignment-quick" if quick else "alignment"
    trials.recorded(quick)
    outcome = measure_all([*trials.cases(quick), *cost.cases(quick)], folder / name, jobs)
    sections = [section for part in (tables, cost) for section in part.sections(outcome.figures) if section.rows]
    report(name, sections, outcome.failed, folder / f"{name}.json")
    return not outcome.failed
