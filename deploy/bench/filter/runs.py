"""Whole exploration runs of one robot: plain and furnished layouts, noisy ranges, noisy odometry."""

from __future__ import annotations

from collections.abc import Callable

from deploy.bench.cases import Case, each
from deploy.bench.explored import measure_run
from deploy.bench.layouts import FURNISHED, present
from deploy.bench.tables import Column, Row, Runs, Table, count, least, most

PLAIN = ["apartment", "maze-15", "office", "symmetric"]
PLAIN_SHARED = ["drlnav_stage7", "pal_passage_110cm_w", "tb3_dqn_stage4", "uday_building", "gbeltramo_building"]
NOISY_RANGES = {"lidar": {"noise_m": 0.03, "dropout": 0.02}}
NOISY_ODOMETRY = {"odometry": {"noisy": True}}
LIMIT_S = 3600.0
"""Simulated seconds: no layout takes one robot longer, and one that turns in circles is cut off here."""
LOST_S = 1500.0
"""As LIMIT_S with noisy odometry: without correction a map never closes."""


def cases(quick: bool) -> list[Case]:
    """All whole runs but those of the sweep."""
    seeds, few, fixed = range(1 if quick else 5), range(1 if quick else 3), {"limit_s": LIMIT_S}
    plain = ["apartment"] if quick else PLAIN + present(PLAIN_SHARED)
    furnished = [] if quick else present(FURNISHED)
    ranges = present(["tb3_dqn_stage4"] if quick else [*PLAIN, "tb3_dqn_stage4"])
    odometry = ["apartment"] if quick else ["maze-15", "office", "apartment", *present(["pal_passage_110cm_w"])]
    made = each("plain/{world}/{seed}", measure_run, fixed, world=plain, seed=seeds)
    made += each("furnished/{world}/{seed}", measure_run, fixed, world=furnished, seed=few)
    made += each("ranges/{world}/{seed}", measure_run, {**fixed, "spec": NOISY_RANGES}, world=ranges, seed=few)
    for world in odometry:
        for how, limit_s in (("corrected", LIMIT_S), ("uncorrected", 200.0 if quick else LOST_S)):
            agent = {"filter": {"correct_pose": how == "corrected"}}
            own = {"world": world, "limit_s": limit_s, "spec": NOISY_ODOMETRY, "agent": agent}
            made += each(f"odometry/{world}/{how}/{{seed}}", measure_run, own, seed=seeds)
    return made


def complete(runs: Runs, key: str) -> int:
    """Runs that ended complete."""
    return sum(run["ended"] == "complete" for run in runs)


def _table(
    name: str,
    title: str,
    recall: float,
    precision: float,
    rmse_m: float | None = None,
    corner: float | None = None,
    corner_rmse_m: float | None = None,
    repeated: float | None = None,
    judged: Callable[[Row], bool] = lambda row: True,
) -> Table:
    """One row for each layout, with bars on the walls, on the corners and on walls that are mapped repeatedly."""
    columns = [
        Column("world", "world"),
        Column("runs", "runs", count),
        Column("complete", "complete", complete),
        Column("wall_recall", "recall", least, at_least=recall),
        Column("wall_precision", "precision", least, at_least=precision),
        Column("wall_rmse_m", "wall rmse m", most, at_most=rmse_m, digits=4),
        Column("corner_recall", "corner recall", least, at_least=corner),
        Column("corner_precision", "corner precision", least, at_least=corner),
        Column("corner_rmse_m", "corner rmse m", most, at_most=corner_rmse_m, digits=4),
        Column("repeated", "repeated", most, at_most=repeated),
        Column("coverage", "coverage", least),
        Column("ended_at", "ended s", most, digits=0),
        Column("filter_bytes", "filter bytes", most),
        Column("step_ms_median", "step ms", most, digits=2),
    ]
    return Table(name, title, columns, name + "/{world}/*", judged=judged, note="Each figure is the worst of the runs.")


def _plain_enough(row: Row) -> bool:
    """uday_building has steps of a few centimetres: it is shown, and in no issue's bar."""
    return bool(row["world"] != "uday_building")


def _correctable(row: Row) -> bool:
    return not row["world"].endswith("/uncorrected") and not row["world"].startswith("pal_passage")


TABLES = [
    _table("plain", "Plain layouts, default noise", 0.99, 0.99, None, 0.97, 0.005, 1.1, _plain_enough),
    _table("furnished", "Furnished layouts", 0.95, 0.97, corner_rmse_m=0.025),
    _table("ranges", "Range noise 0.03 m, 2 % dropouts", 0.97, 0.97),
    _table("odometry", "Odometry noise, with and without correction", 0.95, 0.95, 0.03, judged=_correctable),
]
