"""Whole runs of one robot: the bundled worlds and the real layouts, each from five starts drawn from the seed."""

from __future__ import annotations

from deploy.bench.cases import Case, each
from deploy.bench.explored import measure_run
from deploy.bench.layouts import FURNISHED, present
from deploy.bench.tables import (
    Column,
    Outcomes,
    Row,
    Table,
    at,
    by_label,
    count,
    least,
    median,
    most,
    row_of,
    share,
    spread,
)

BUNDLED = ["apartment", "hall", "maze-15", "office", "symmetric"]
SHARED = ["drlnav_stage7", "gbeltramo_building", "pal_passage_110cm_w", "tb3_dqn_stage4", "uday_building"]
SEEDS = 5
LIMIT_S = 4000.0
"""Simulated seconds after which a run counts as not finished: twice what the largest layout takes."""
MAZE_15_S = 600.0
"""Median time to complete in maze-15."""


def worlds(quick: bool) -> list[str]:
    """The layouts that are there."""
    return ["apartment"] if quick else BUNDLED + present(SHARED + FURNISHED)


def seeds(quick: bool) -> range:
    """Seeds of each layout; each seed is another start."""
    return range(1 if quick else SEEDS)


def cases(quick: bool) -> list[Case]:
    """Every layout from every start, all layouts once before any twice."""
    fixed = {"limit_s": LIMIT_S, "starts": "random"}
    return each("runs/{world}/{seed}", measure_run, fixed, seed=seeds(quick), world=worlds(quick))


complete = share(lambda run: run["ended"] == "complete" and run["reason"])
"""Share of runs that ended complete and said why."""


def _ends(name: str, title: str, furnished: bool, recall: float, precision: float) -> Table:
    columns = [
        Column("world", "world"),
        Column("runs", "runs", count),
        Column("complete", "complete", complete, at_least=1.0, digits=2),
        Column("silent", "open, no reason", most, at_most=0),
        Column("unreachable", "open, with reason", most),
        Column("wall_recall", "recall", least, at_least=recall, digits=4),
        Column("wall_precision", "precision", least, at_least=precision, digits=4),
        Column("wall_rmse_m", "wall rmse m", most, at_most=0.01, digits=4),
        Column("wall_contacts", "wall contacts", most, at_most=0),
        Column("stuck", "stuck", most),
    ]

    def rows(figures: Outcomes) -> list[Row]:
        groups = by_label(figures, "runs/{world}/*").items()
        return [row_of(columns, runs, {"world": w}) for w, runs in groups if (w in FURNISHED) == furnished]

    return Table(name, title, columns, rows, note="Worst of the runs; complete: share that ended so, with a reason.")


TIMES = {"t_90": "T_90 s", "t_99": "T_99 s", "ended_at": "complete s", "path_m": "path m"}

TABLES = [
    _ends("plain", "One robot in plain layouts, starts drawn from the seed", False, 0.99, 0.99),
    _ends("furnished", "... in furnished layouts", True, 0.96, 0.97),
    Table(
        "times",
        "Simulated seconds and path to 90 %, 99 % and complete",
        [
            Column("world", "world"),
            *(
                column
                for key, head in TIMES.items()
                for column in (
                    Column(key, f"{head} median", median, digits=0),
                    Column(f"{key}_spread", "least-most", at(key, spread)),
                )
            ),
        ],
        "runs/{world}/*",
    ),
    Table(
        "maze-15",
        "Time to complete",
        [
            Column("world", "world", lambda runs, _: "maze-15"),
            Column("ended_at", "complete s, median", median, at_most=MAZE_15_S, digits=0),
        ],
        "runs/maze-15/*",
    ),
]
