"""Whole exploration runs of one robot: plain and furnished layouts, noisy ranges, noisy odometry."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from deploy.bench.bars import Column, Section
from deploy.bench.cases import Case, Figures
from deploy.bench.explored import explore
from deploy.bench.layouts import present

PLAIN = ["apartment", "maze-15", "office", "symmetric"]
PLAIN_SHARED = ["drlnav_stage7", "pal_passage_110cm_w", "tb3_dqn_stage4", "uday_building", "gbeltramo_building"]
FURNISHED = ["drlnav_house_tomas", "hurtado_apartment", "pal_home_w"]
NOISY_RANGES = {"lidar": {"noise_m": 0.03, "dropout": 0.02}}
NOISY_ODOMETRY = {"odometry": {"noisy": True}}
LIMIT_S = 3600.0
"""Simulated seconds: no layout takes one robot longer, and one that turns in circles is cut off here."""
LOST_S = 1500.0
"""As LIMIT_S with noisy odometry: without correction a map never closes."""


def run_case(
    name: str,
    world: str,
    seed: int,
    spec: Mapping[str, Any] | None = None,
    agent: Mapping[str, Any] | None = None,
    limit_s: float = LIMIT_S,
) -> Case:
    """A case of one whole run."""
    settings = {"world": world, "robots": 1, "seed": seed, "spec": spec or {}, "max_time_s": limit_s}
    return Case(name, measure_run, {"world": settings, "agent": agent or {}})


def measure_run(world: Mapping[str, Any], agent: Mapping[str, Any]) -> Figures:
    """Figures of one run."""
    return explore(world, agent).figures()


def cases(quick: bool) -> list[Case]:
    """All whole runs but those of the sweep."""
    made = []
    seeds = range(1 if quick else 5)
    for world in ["apartment"] if quick else PLAIN + present(PLAIN_SHARED):
        made += [run_case(f"plain/{world}/{seed}", world, seed) for seed in seeds]
    for world in [] if quick else present(FURNISHED):
        made += [run_case(f"furnished/{world}/{seed}", world, seed) for seed in range(3)]
    for world in present(["tb3_dqn_stage4"] if quick else [*PLAIN, "tb3_dqn_stage4"]):
        made += [run_case(f"ranges/{world}/{seed}", world, seed, NOISY_RANGES) for seed in list(seeds)[:3]]
    for world in ["apartment"] if quick else ["maze-15", "office", "apartment", *present(["pal_passage_110cm_w"])]:
        for how, correct in (("corrected", True), ("uncorrected", False)):
            agent = {"filter": {"correct_pose": correct}}
            limit_s = (200.0 if quick else LOST_S) if not correct else LIMIT_S
            made += [
                run_case(f"odometry/{world}/{how}/{seed}", world, seed, NOISY_ODOMETRY, agent, limit_s)
                for seed in seeds
            ]
    return made


def walls(recall: float | None, precision: float | None, rmse_m: float | None = None) -> list[Column]:
    """Columns of the walls' score with their bars."""
    return [
        Column("wall_recall", "recall", at_least=recall),
        Column("wall_precision", "precision", at_least=precision),
        Column("wall_rmse_m", "wall rmse m", at_most=rmse_m, digits=4),
    ]


def corners(recall: float | None, precision: float | None, rmse_m: float | None) -> list[Column]:
    """Columns of the corners' score with their bars."""
    return [
        Column("corner_recall", "corner recall", at_least=recall),
        Column("corner_precision", "corner precision", at_least=precision),
        Column("corner_rmse_m", "corner rmse m", at_most=rmse_m, digits=4),
    ]


WORLD = [Column("world", "world"), Column("runs", "runs"), Column("complete", "complete")]
TIMES = [
    Column("coverage", "coverage"),
    Column("ended_at", "ended s", digits=0),
    Column("filter_bytes", "filter bytes"),
    Column("step_ms_median", "step ms", digits=2),
]


def worst(runs: Iterable[Figures], columns: Iterable[Column]) -> dict[str, Any]:
    """The worst of each figure over runs: the least where more is better, else the most; None where one is missing."""
    found = list(runs)
    row: dict[str, Any] = {"runs": len(found), "complete": sum(run["ended"] == "complete" for run in found)}
    for column in columns:
        values = [run[column.key] for run in found if run.get(column.key) is not None]
        least = column.at_least is not None or column.key.endswith(("recall", "precision")) or column.key == "coverage"
        row[column.key] = (min if least else max)(values) if values and len(values) == len(found) else None
    return row


def table(
    name: str, title: str, groups: Mapping[str, list[Figures]], columns: list[Column], beside: Iterable[str] = ()
) -> Section:
    """One row for each group of runs, worst of its seeds; groups named in `beside` are not judged."""
    rows = [{"world": group, **worst(runs, [*columns, *TIMES])} for group, runs in groups.items()]
    aside = frozenset(number for number, group in enumerate(groups) if group in set(beside))
    note = "Each figure is the worst of the runs."
    return Section(name, title, [*WORLD, *columns, *TIMES], rows, aside, note)


def grouped(figures: Mapping[str, Figures], prefix: str) -> dict[str, list[Figures]]:
    """Figures of the cases prefix/GROUP.../SEED by GROUP."""
    groups: dict[str, list[Figures]] = {}
    for name, found in figures.items():
        if name.startswith(f"{prefix}/"):
            groups.setdefault(name.removeprefix(f"{prefix}/").rpartition("/")[0], []).append(found)
    return groups


def sections(figures: Mapping[str, Figures]) -> list[Section]:
    """The tables of these cases."""
    odometry = grouped(figures, "odometry")
    aside = [group for group in odometry if group.endswith("/uncorrected") or group.startswith("pal_passage")]
    return [
        table(
            "plain",
            "Plain layouts, default noise",
            grouped(figures, "plain"),
            [
                *walls(0.99, 0.99),
                *corners(0.97, 0.97, 0.005),
                Column("repeated", "repeated", at_most=1.1),
            ],
            ["uday_building"],  # steps of a few centimetres: shown, and in no issue's bar
        ),
        table(
            "furnished",
            "Furnished layouts",
            grouped(figures, "furnished"),
            [*walls(0.95, 0.97), *corners(None, None, 0.025), Column("repeated", "repeated")],
        ),
        table(
            "ranges",
            "Range noise 0.03 m, 2 % dropouts",
            grouped(figures, "ranges"),
            [*walls(0.97, 0.97), *corners(None, None, None), Column("repeated", "repeated")],
        ),
        table(
            "odometry",
            "Odometry noise, with and without correction",
            odometry,
            [*walls(0.95, 0.95, 0.03), *corners(None, None, None), Column("repeated", "repeated")],
            aside,
        ),
    ]
