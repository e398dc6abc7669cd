"""`wireswarm bench radio`: bytes of maps on the radio, what a bad radio does to them, and what the radio costs."""

from __future__ import annotations

from pathlib import Path

from deploy.bench.bars import report
from deploy.bench.cases import measure_all
from deploy.bench.radio import codec, cost, traffic

PARTS = (codec, traffic, cost)
"""Each has the cases of one question, and their tables."""


def measure(quick: bool, folder: Path, jobs: int | None) -> bool:
    """Measure what is not in `folder` yet and print all tables; whether every case has figures, whatever they say.

    Cases are kept under folder/radio and the tables in folder/radio.json, with -quick appended where quick.
    """
    name = "radio-quick" if quick else "radio"
    outcome = measure_all([case for part in PARTS for case in part.cases(quick)], folder / name, jobs)
    sections = [section for part in PARTS for section in part.sections(outcome.figures) if section.rows]
    report(name, sections, outcome.failed, folder / f"{name}.json")
    return not outcome.failed
