"""What a step costs and how fast whole runs are: no worse than after the filter, by the filter's own measures."""

from __future__ import annotations

from collections.abc import Mapping

from deploy.bench.bars import Section
from deploy.bench.cases import Case, Figures
from deploy.bench.filter.cost import measure_speed, measure_stages, speed_section, stages_section


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
    tables = {"speed/stages": stages_section, "speed/run": speed_section}
    return [table(figures[name]) for name, table in tables.items() if name in figures]
