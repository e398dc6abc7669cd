"""How many particles: quality and cost side by side, over a few cases of every hard kind."""

from deploy.bench.cases import Case, each
from deploy.bench.explored import measure_run
from deploy.bench.filter.cost import PARTICLES
from deploy.bench.filter.faults import KINDS
from deploy.bench.filter.runs import NOISY_ODOMETRY, NOISY_RANGES
from deploy.bench.filter.trials import SCOPES, counts_of, gone_percent, measure_faults
from deploy.bench.layouts import present
from deploy.bench.tables import Outcomes, Row, Runs, Table, mean, runs_of


def cases(quick: bool) -> list[Case]:
    """Whole runs and faults by number of particles; ambiguous walls and cost come from their own cases."""
    made = []
    trials, limit_s = (1, 60.0) if quick else (10, 600.0)
    faults = {"trials": trials, "scopes": list(SCOPES[:2]), "limit_s": limit_s}
    for n in PARTICLES[:2] if quick else PARTICLES:
        for kind, spec, worlds in (
            ("ranges", NOISY_RANGES, ["office", *present(["tb3_dqn_stage4"])]),
            ("odometry", NOISY_ODOMETRY, ["maze-15", "apartment"]),
        ):
            fixed = {"spec": spec, "agent": {"filter": {"particles": n}}, "limit_s": 60.0 if quick else 1500.0}
            name, seeds = f"sweep/{n}/{kind}/{{world}}/{{seed}}", range(1 if quick else 2)
            made += each(name, measure_run, fixed, world=["apartment"] if quick else worlds, seed=seeds)
        made += each("sweep/{particles}/faults/{world}", measure_faults, faults, particles=[n], world=["apartment"])
    return made


def _rows(figures: Outcomes) -> list[Row]:
    """One row per number of particles; figures are means over the cases."""
    rows = []
    for n in PARTICLES:
        ranges, odometry = (runs_of(figures, f"sweep/{n}/{noise}/*/*") for noise in ("ranges", "odometry"))
        faults = runs_of(figures, f"sweep/{n}/faults/*")
        if not ranges:
            continue
        cost = figures.get(f"cost/particles/{n}", {})
        ambiguous = [found[str(n)] for found in runs_of(figures, "ambiguous/*") if str(n) in found]
        row = {
            "particles": n,
            **{f"ranges_{what}": mean(ranges, f"wall_{what}") for what in ("recall", "precision")},
            **{f"odometry_{what}": mean(odometry, f"wall_{what}") for what in ("recall", "precision")},
            "ranges_corner": _mean_of_known(ranges, "corner_rmse_m"),
            "odometry_rmse": _mean_of_known(odometry, "wall_rmse_m"),
            "half": gone_percent(counts_of(faults, KINDS, SCOPES[1])),
            "ambiguous": mean(ambiguous, "along_walls"),
            "update_ms": cost.get("median"),
            "filter_bytes": cost.get("bytes"),
        }
        rows.append(row | {kind: gone_percent(counts_of(faults, [kind], SCOPES[0])) for kind in KINDS})
    return rows


def _mean_of_known(runs: Runs, key: str) -> float | None:
    """Mean over the runs that have a figure: a map without corners has no error of them."""
    known: float | None = mean([run for run in runs if run[key] is not None], key)
    return known


TABLES = [
    Table(
        "sweep",
        "How many particles: noise and ambiguity",
        _rows,
        "particles; ranges_recall: noisy ranges recall; ranges_precision: noisy ranges precision; "
        "ranges_corner: noisy ranges corner rmse m; odometry_recall: noisy odometry recall; "
        "odometry_precision: noisy odometry precision; odometry_rmse: noisy odometry wall rmse m; "
        "ambiguous: ambiguous walls F1 along",
        note="Means over the cases. Of ambiguous walls, ideal sensing.",
    ),
    Table(
        "sweep-faults",
        "How many particles: faults and cost",
        _rows,
        f"particles; {'; '.join(f'{kind}: {kind} gone %' for kind in KINDS)}; half: faults in half gone %; "
        "update_ms: filter update ms; filter_bytes",
        note="Gone: within 50 scans that see the place. Of faults, ideal sensing.",
        sensing="ideal",
    ),
]
