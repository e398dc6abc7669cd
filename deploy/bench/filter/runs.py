"""Whole exploration runs of one robot: plain and furnished layouts, noisy ranges, noisy odometry."""

import re

from deploy.bench.cases import Case, each
from deploy.bench.explored import measure_run
from deploy.bench.layouts import FURNISHED, PLAIN, present
from deploy.bench.tables import Table, columns

BUNDLED = ["apartment", "maze-15", "office", "symmetric"]
NOISY_RANGES = {"lidar": {"noise_m": 0.03, "dropout": 0.02}}
NOISY_ODOMETRY = {"odometry": {"noisy": True}}
LIMIT_S = 3600.0  # simulated seconds: no layout takes one robot longer, and one that turns in circles is cut off here
LOST_S = 1500.0  # as LIMIT_S with noisy odometry: without correction a map never closes


def cases(quick: bool) -> list[Case]:
    """All whole runs but those of the sweep."""
    seeds, few, fixed = range(1 if quick else 5), range(1 if quick else 3), {"limit_s": LIMIT_S}
    plain = ["apartment"] if quick else BUNDLED + present(PLAIN)
    ranges = present(["tb3_dqn_stage4"] if quick else [*BUNDLED, "tb3_dqn_stage4"])
    odometry = ["apartment"] if quick else ["maze-15", "office", "apartment", *present(["pal_passage_110cm_w"])]
    made = each("plain/{world}/{seed}", measure_run, fixed, world=plain, seed=seeds)
    made += each("furnished/{world}/{seed}", measure_run, fixed, world=present([] if quick else FURNISHED), seed=few)
    made += each("ranges/{world}/{seed}", measure_run, {**fixed, "spec": NOISY_RANGES}, world=ranges, seed=few)
    for world in odometry:
        for how, limit_s in (("corrected", LIMIT_S), ("uncorrected", 200.0 if quick else LOST_S)):
            agent = {"filter": {"correct_pose": how == "corrected"}}
            own = {"world": world, "limit_s": limit_s, "spec": NOISY_ODOMETRY, "agent": agent}
            made += each(f"odometry/{world}/{how}/{{seed}}", measure_run, own, seed=seeds)
    return made


WORST = (
    "wall_recall least >=", "wall_precision least >=", "wall_rmse_m most <=", "corner_recall least >=",
    "corner_precision least >=", "corner_rmse_m most <=", "repeated most <=",
)  # fmt: skip
"""Figures of maps, of which each table shows the worst and judges some."""


def _table(name: str, title: str, bars: tuple[float | None, ...], beside: str = "") -> Table:
    """One row for each layout; bars of WORST, None where there is none, and none for worlds like `beside`."""
    worst = [figure[:-3] if bar is None else f"{figure} {bar}" for figure, bar in zip(WORST, bars, strict=True)]
    heads = columns(
        f"world; runs count; complete; {'; '.join(worst)}; coverage least; ended_at most; filter_bytes most; "
        "step_ms_median most",
        complete=lambda runs, _: sum(run["ended"] == "complete" for run in runs),
    )
    judged, note = lambda row: not re.fullmatch(beside, row["world"]), "Each figure is the worst of the runs."
    return Table(name, title, name + "/{world}/*", heads, judged=judged, note=note)


# uday_building has steps of a few centimetres, which the bar is not for
TABLES = [
    _table("plain", "Plain layouts, default noise", (0.99, 0.99, None, 0.97, 0.97, 0.005, 1.1), "uday_building"),
    _table("furnished", "Furnished layouts", (0.95, 0.97, None, None, None, 0.025, None)),
    _table("ranges", "Range noise 0.03 m, 2 % dropouts", (0.97, 0.97, *[None] * 5)),
    _table(
        "odometry",
        "Odometry noise, with and without correction",
        (0.95, 0.95, 0.03, *[None] * 4),
        "pal_passage.*|.*/uncorrected",
    ),
]
