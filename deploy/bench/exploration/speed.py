"""What a step costs and how fast whole runs are: no worse than after the filter, by the filter's own measures."""

from __future__ import annotations

from collections.abc import Mapping

from deploy.bench.bars import Column, Section
from deploy.bench.cases import Case, Figures
from deploy.bench.filter.cost import measure_speed, measure_stages


def cases(quick: bool) -> list[Case]:
    """Alone each: their figures are times."""
    world, limit_s = ("apartment", 60.0) if quick else ("maze-15", 3600.0)
    until = 60.0 if quick else "complete"
    return [
        Case("speed/stages", measure_stages, {"world": world, "limit_s": limit_s}, alone=True),
        Case("speed/run", measure_speed, {"world": world, "robots": 3, "until": until}, alone=True),
    ]


def sections(figures: Mapping[str, Figures]) -> list[Section]:
    """The stages of a step, and the whole run."""
    made = []
    if "speed/stages" in figures:
        found = figures["speed/stages"]
        rows = [{"stage": "whole step", **found["step"]}]
        rows += [{"stage": stage, **found[stage]} for stage in ("perception", "filter", "planning")]
        columns = [
            Column("stage", "stage"),
            Column("median", "median ms", at_most=5.0, digits=2),
            Column("mean", "mean ms", digits=2),
            Column("p99", "99 % ms", digits=2),
        ]
        note = f"Load of the machine {found['load']:g}."
        made.append(Section("stages", "A step of one robot", columns, rows, frozenset({1, 2, 3}), note))
    if "speed/run" in figures:
        columns = [
            Column("real_time_factor", "times real time", at_least=30.0, digits=1),
            Column("step_ms_median", "median step ms", digits=2),
            Column("ended", "ended"),
            Column("load", "load", digits=1),
        ]
        made.append(Section("speed", "wireswarm run, 3 robots", columns, [figures["speed/run"]]))
    return made
