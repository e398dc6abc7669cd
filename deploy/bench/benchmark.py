"""A benchmark: the declared cases and tables of its parts, measured, printed and written."""

import json
import os
import platform
from collections.abc import Container, Mapping, Sequence
from contextvars import copy_context
from dataclasses import replace
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

from deploy.bench.cases import Case, measure_all
from deploy.bench.tables import Outcomes, Section
from deploy.revision import WITH_BENCHMARKS, revision
from deploy.sensing import IDEAL_BENCHMARK, named
from deploy.terminal.console import Terminal
from protocol.errors import InputError
from protocol.files import check_has_folder, make_folder, write_whole
from protocol.messages import RobotSpec
from protocol.status import Status

WIDTH = 150  # characters of a file or pipe, enough for the widest table; on a terminal, wide tables are divided
PARTS = {
    "lidar": "lidar",
    "lockstep": "lockstep",
    "crowd": "crowd many",
    "filter": "filter.runs filter.trials filter.ambiguous filter.storage speed filter.cost filter.sweep",
    "exploration": "exploration.runs exploration.teams exploration.mazes exploration.tours exploration.dense speed",
    "alignment": "alignment.trials alignment.cost alignment.live alignment.exact alignment.thin alignment.forced "
    "alignment.hostile",
    "sensing": "sensing teams",
    "radio": "radio.codec radio.traffic radio.cost",
}
"""The modules of each benchmark. Each holds one question: `cases(quick)`, what is measured, where quick as little as
shows that all works; `TABLES`; and maybe `beforehand(quick)`, which makes what several of its cases need."""


class Benchmark:
    """All that `wireswarm bench NAME` measures."""

    def __init__(self, name: str, tables: Container[str] | None = None, part: str | None = None) -> None:
        """tables: only those parts that have one of these; None: all. part: only the part of that name.

        Raises InputError where no part is called so.
        """
        modules = {module.rpartition(".")[2]: module for module in PARTS[name].split()}
        if part is not None and part not in modules:
            raise InputError(f"--part {part}: {name} has no such part; its parts are {', '.join(modules)}")
        parts = [import_module(f"deploy.bench.{modules[chosen]}") for chosen in ([part] if part else modules)]
        self.name, self.part = name, part
        self.parts = [one for one in parts if tables is None or any(table.name in tables for table in one.TABLES)]

    def cases(self, quick: bool) -> list[Case]:
        """The cases of all parts."""
        return [case for part in self.parts for case in part.cases(quick)]

    def sections(self, figures: Outcomes) -> list[Section]:
        """All tables that have rows."""
        made = [table.section(figures) for part in self.parts for table in part.TABLES]
        return [section for section in made if section.rows]

    def stem(self, quick: bool, ideal: bool = False) -> str:
        """How the folder of its cases is called: -ideal and -quick appended to NAME where so."""
        return f"{self.name}{'-ideal' if ideal else ''}{'-quick' if quick else ''}"

    def file(self, folder: Path, quick: bool, ideal: bool = False) -> Path:
        """Of its tables, STEM.json; those of one part are in STEM-PART.json and leave that alone."""
        return folder / f"{self.stem(quick, ideal)}{f'-{self.part}' if self.part else ''}.json"

    def command(self, quick: bool, ideal: bool = False) -> str:
        """What makes its tables, but for the folder and the number of jobs, which change nothing."""
        part = f" --part {self.part}" if self.part else ""
        return f"wireswarm bench {self.name}{part}{' --ideal' if ideal else ''}{' --quick' if quick else ''}"

    def run(self, quick: bool, folder: Path, jobs: int | None, ideal: bool = False) -> Status:
        """Measure what is not in `folder` yet and print all tables; FAILURE where a case has no figures.

        Cases are kept under folder/STEM (`stem`), the tables in `file`. ideal: with the paper's sensing in all runs
        that do not set it themselves. quick: bars, which are for all cases, are shown, and nothing is judged by them.
        Raises InputError where these cannot be written.
        """
        stem, file = folder / self.stem(quick, ideal), self.file(folder, quick, ideal)
        make_folder(stem, "--results")
        drawn = [table for part in self.parts for table in part.TABLES if table.drawn is not None]
        for output in (file, *(picture(file, table.name) for table in drawn)):
            check_has_folder(output, "--results")
        made_by = {"command": self.command(quick, ideal), "revision": revision(WITH_BENCHMARKS)}
        measuring = copy_context()
        measuring.run(IDEAL_BENCHMARK.set, ideal)
        for part in self.parts:
            measuring.run(getattr(part, "beforehand", bool), quick)
        outcome = measure_all([replace(case, ideal=ideal) for case in self.cases(quick)], stem, jobs)
        sensing = "ideal" if ideal else named(RobotSpec())
        sections = [replace(section, quick=quick) for section in self.sections(outcome.figures)]
        report(stem.name, made_by, sensing, sections, outcome.failed, file)
        if outcome.failed:
            return Status.FAILURE
        return Status.NOT_MET if any(section.met is False for section in sections) else Status.OK


def picture(file: Path, table: str) -> Path:
    """The picture of a table, beside the file of all tables."""
    return file.with_name(f"{file.stem}-{table}.png")


def report(
    name: str,
    made_by: Mapping[str, str],
    sensing: str,
    sections: Sequence[Section],
    failed: Mapping[str, str],
    out: Path,
) -> None:
    """Print all tables and write them to `out`, with what made them and the machine, and pictures beside it.

    made_by: the command, and the revision of the sources. sensing: of the runs that do not set it themselves.
    """
    console = Terminal(stderr=False)
    if not console.is_terminal:
        console.width = max(console.width, WIDTH)
    for section in sections:
        section.print(console)
    for case, reason in failed.items():
        console.print(f"no figures of {case}: {reason}", style="red", markup=False, highlight=False)
    console.print(f"sensing is {sensing} where a table does not say otherwise")
    machine = {"python": platform.python_version(), "machine": platform.machine(), "cpus": os.cpu_count()}
    met = {section.table.name: section.met for section in sections}
    found = {section.table.name: section.as_dict(sensing) for section in sections}
    document: dict[str, Any] = {"bench": name, "version": version("wireswarm"), **made_by, "sensing": sensing}
    document |= {**machine, "met": met, "sections": found, "failed": dict(failed)}
    out.parent.mkdir(parents=True, exist_ok=True)
    write_whole(out, json.dumps(document, indent=1, allow_nan=False) + "\n")
    for section in sections:
        section.draw(picture(out, section.table.name))
    console.print(f"written to {out}", highlight=False)
