"""`wireswarm bench alignment`: pairs of partial maps, our features against 4PCS and ICP, and robots that merge."""

from __future__ import annotations

from pathlib import Path

from deploy.bench.alignment import cost, forced, hostile, live, plots, tables, trials
from deploy.bench.bars import report
from deploy.bench.cases import measure_all


def measure(quick: bool, folder: Path, jobs: int | None) -> bool:
    """Measure what is not in `folder` yet and print all tables; whether every case has figures, whatever they say.

    Cases are kept under folder/alignment and the tables in folder/alignment.json, with -quick appended where quick.
    """
    name = "alignment-quick" if quick else "alignment"
    trials.recorded(quick)
    parts = (trials, cost, live, forced, hostile)
    outcome = measure_all([case for part in parts for case in part.cases(quick)], folder / name, jobs)
    tables_of = (tables, cost, live, forced, hostile)
    sections = [section for part in tables_of for section in part.sections(outcome.figures) if section.rows]
    report(name, sections, outcome.failed, folder / f"{name}.json")
    plots.draw(sections, folder / name)
    return not outcome.failed
