"""Headline and subtitle of a run, and numbers as texts."""

import math
from typing import Any

from deploy.report.rundir import Run

NONE = "—"
"""Stands for a missing value."""


def headline(run: Run) -> str:
    """World and number of robots."""
    name = run.world.name if run.world is not None else run.path.name
    count = len(run.robots)
    return f"{name}: {count} robot{'' if count == 1 else 's'}"


def subtitle(run: Run) -> str:
    """How the run ended, and the team's figures."""
    team = run.summary.get("team")
    team = team if isinstance(team, dict) else {}
    pieces = [
        f"seed {run.manifest['seed']}" if "seed" in run.manifest else "",
        f"ended: {run.manifest['ended']}" if isinstance(run.manifest.get("ended"), str) else "",
        f"{run.duration:.0f} simulated seconds",
        f"team coverage {share(team['coverage'])}" if "coverage" in team else "",
        f"90 % after {seconds(team['t_90'])}" if team.get("t_90") is not None else "",
        f"99 % after {seconds(team['t_99'])}" if team.get("t_99") is not None else "",
        f"{number(run.summary.get('real_time_factor'), 0)} times real time"
        if "real_time_factor" in run.summary
        else "",
    ]
    return "  ·  ".join(piece for piece in pieces if piece)


def number(value: Any, digits: int = 1) -> str:
    """A number with so many decimals; NONE for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return NONE
    return f"{value:,.{digits}f}"


def share(value: Any) -> str:
    """0.987 as 98.7 %."""
    return NONE if number(value) == NONE else f"{100 * value:.1f} %"


def seconds(value: Any) -> str:
    """Simulated seconds."""
    return NONE if number(value) == NONE else f"{number(value, 0)} s"


def size(value: Any) -> str:
    """Bytes as B, kB or MB (powers of ten)."""
    if number(value) == NONE:
        return NONE
    for unit, scale in (("MB", 1e6), ("kB", 1e3)):
        if value >= scale:
            return f"{value / scale:,.1f} {unit}"
    return f"{value:,.0f} B"
