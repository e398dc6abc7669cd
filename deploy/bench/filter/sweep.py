"""How many particles: quality and cost side by side, over a few cases of every hard kind."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from deploy.bench.bars import Column, Section
from deploy.bench.cases import Case, Figures
from deploy.bench.filter.cost import PARTICLES
from deploy.bench.filter.faults import KINDS
from deploy.bench.filter.runs import NOISY_ODOMETRY, NOISY_RANGES, run_case
from deploy.bench.filter.trials import SCOPES, fault_case
from deploy.bench.layouts import present


def cases(quick: bool) -> list[Case]:
    """Whole runs and faults by number of particles; ambiguous walls and cost come from their own cases."""
    made = []
    for n in PARTICLES[:2] if quick else PARTICLES:
        agent = {"filter": {"particles": n}}
        for kind, spec, worlds in (
            ("ranges", NOISY_RANGES, ["office", *present(["tb3_dqn_stage4"])]),
            ("odometry", NOISY_ODOMETRY, ["maze-15", "apartment"]),
        ):
            for world in ["apartment"] if quick else worlds:
                for seed in range(1 if quick else 2):
                    name, limit_s = f"sweep/{n}/{kind}/{world}/{seed}", 60.0 if quick else 1500.0
                    made.append(run_case(name, world, seed, spec, agent, limit_s))
        trials, limit_s = (1, 60.0) if quick else (10, 600.0)
        made.append(fault_case(f"sweep/{n}/faults/apartment", "apartment", trials, n, SCOPES[:2], limit_s))
    return made


NOISE = [
    Column("particles", "particles"),
    Column("ranges_recall", "noisy ranges recall", digits=4),
    Column("ranges_precision", "noisy ranges precision", digits=4),
    Column("ranges_corner", "noisy ranges corner rmse m", digits=4),
    Column("odometry_recall", "noisy odometry recall", digits=4),
    Column("odometry_precision", "noisy odometry precision", digits=4),
    Column("odometry_rmse", "noisy odometry wall rmse m", digits=4),
    Column("ambiguous", "ambiguous walls F1 along", digits=4),
]
FAULTS = [
    Column("particles", "particles"),
    *(Column(kind, f"{kind} gone %", digits=0) for kind in KINDS),
    Column("half", "faults in half gone %", digits=0),
    Column("update_ms", "filter update ms", digits=2),
    Column("filter_bytes", "filter bytes"),
]


def sections(figures: Mapping[str, Figures]) -> list[Section]:
    """One row per number of particles; figures are means over the cases."""
    rows = []
    for n in PARTICLES:
        ranges, odometry, faults = (_of(figures, f"sweep/{n}/{kind}/") for kind in ("ranges", "odometry", "faults"))
        if not ranges:
            continue
        cost = figures.get(f"cost/particles/{n}", {})
        ambiguous = [found[str(n)] for found in _of(figures, "ambiguous/") if str(n) in found]
        row: dict[str, Any] = {
            "particles": n,
            "ranges_recall": _mean(ranges, "wall_recall"),
            "ranges_precision": _mean(ranges, "wall_precision"),
            "ranges_corner": _mean(ranges, "corner_rmse_m"),
            "odometry_recall": _mean(odometry, "wall_recall"),
            "odometry_precision": _mean(odometry, "wall_precision"),
            "odometry_rmse": _mean(odometry, "wall_rmse_m"),
            "half": _gone(faults, KINDS, SCOPES[1]),
            "ambiguous": _mean(ambiguous, "along_walls"),
            "update_ms": cost.get("median"),
            "filter_bytes": cost.get("bytes"),
        }
        rows.append(row | {kind: _gone(faults, [kind], SCOPES[0]) for kind in KINDS})
    gone = "Gone: within 50 scans that see the place."
    return [
        Section("sweep", "How many particles: noise and ambiguity", NOISE, rows, note="Means over the cases."),
        Section("sweep-faults", "How many particles: faults and cost", FAULTS, rows, note=gone),
    ]


def _of(figures: Mapping[str, Figures], prefix: str) -> list[Figures]:
    return [found for name, found in figures.items() if name.startswith(prefix)]


def _mean(found: Sequence[Figures], key: str) -> float | None:
    values = [one[key] for one in found if one.get(key) is not None]
    return float(np.mean(values)) if values else None


def _gone(found: Sequence[Figures], kinds: Iterable[str], scope: str) -> float | None:
    counts = [count for one in found for kind in kinds for count in one["found"][kind].get(scope, [])]
    return 100.0 * sum(count is not None for count in counts) / len(counts) if counts else None
