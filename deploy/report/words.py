"""Headline and subtitle of a run, and numbers as texts."""

from typing import Any, TypeGuard

from deploy.report.rundir import Run, mapping
from protocol.text import printable

NONE = "—"  # stands for a missing value
MAX_SHOWN = 1e15  # larger numbers of a file are no figures of a run


def headline(run: Run) -> str:
    """World and number of robots."""
    name = printable(run.world.name if run.world is not None else run.path.name)
    count = len(run.robots)
    return f"{name}: {count} robot{'' if count == 1 else 's'}"


def subtitle(run: Run) -> str:
    """How the run ended, and the team's figures."""
    team = mapping(run.summary.get("team"))
    pieces = [f"seed {run.manifest['seed']}"] if "seed" in run.manifest else []
    if isinstance(run.manifest.get("ended"), str):
        pieces.append(f"ended: {run.manifest['ended']}")
    scans = sum(map(len, run.poses.values()))
    pieces.append(f"{scans} scans" if run.of_logs else f"{run.duration:.0f} simulated seconds")
    if "coverage" in team:
        pieces.append(f"team coverage {share(team['coverage'])}")
    reached = [percent for percent in (90, 99) if team.get(f"t_{percent}") is not None]
    pieces += [f"{percent} % after {seconds(team[f't_{percent}'])}" for percent in reached]
    if "real_time_factor" in run.summary:
        pieces.append(f"{factor(run.summary['real_time_factor'])} times real time")
    return "  ·  ".join(pieces)


def number(value: Any, digits: int = 1, unit: str = "") -> str:
    """A number with so many decimals and its unit; NONE for anything else."""
    return f"{value:,.{digits}f} {unit}".rstrip() if is_figure(value) else NONE


def factor(value: Any) -> str:
    """A factor such as 0.0123, 12.3 or 1,234; NONE for anything else."""
    return f"{value:.3g}" if is_figure(value) and abs(value) < 100 else number(value, 0)


def is_figure(value: Any) -> TypeGuard[int | float]:
    """Whether a value of a file is a number that can be shown: robots and killed worlds leave others."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < MAX_SHOWN


def share(value: Any) -> str:
    """0.987 as 98.7 %."""
    return f"{100 * value:.1f} %" if is_figure(value) else NONE


def seconds(value: Any) -> str:
    """Simulated seconds."""
    return number(value, 0, "s")


def size(value: Any) -> str:
    """Bytes as B, kB or MB (powers of ten)."""
    for unit, scale in (("MB", 1e6), ("kB", 1e3)):
        if is_figure(value) and value >= scale:
            return number(value / scale, 1, unit)
    return number(value, 0, "B")
