"""Whole runs of one robot: bundled and real layouts, each from five starts drawn from the seed, and default states."""

from itertools import product
from typing import get_args

from agent.exploration.config import DefaultState
from deploy.bench.cases import Case, each
from deploy.bench.explored import measure_run
from deploy.bench.layouts import FURNISHED, PLAIN, present
from deploy.bench.tables import Table, columns, completed_at, median, share, spread, times

BUNDLED = ["apartment", "hall", "maze-15", "office", "symmetric"]
SEEDS = 5
LIMIT_S = 4000.0  # simulated seconds after which a run counts as not finished: twice what the largest layout takes
MAZE_15_S = 600.0  # median time to complete in maze-15
STATE_WORLDS = ["hall", "maze-15"]  # for default states: with free pillars out of range from the walls, and without
STATE_SEEDS = 3


def worlds(quick: bool) -> list[str]:
    """The layouts that are there."""
    return ["apartment"] if quick else BUNDLED + present(PLAIN + FURNISHED)


def seeds(quick: bool) -> range:
    """Seeds of each layout; each seed is another start."""
    return range(1 if quick else SEEDS)


def cases(quick: bool) -> list[Case]:
    """Every layout from every start, all layouts once before any twice; some with each default state."""
    fixed = {"limit_s": LIMIT_S, "starts": "random"}
    made = each("runs/{world}/{seed}", measure_run, fixed, seed=seeds(quick), world=worlds(quick))
    for world, state in product([] if quick else STATE_WORLDS, get_args(DefaultState)):
        own = {**fixed, "world": world, "agent": {"exploration": {"default_state": state}}}
        made += each(f"policies/{world}/{state}/{{seed}}", measure_run, own, seed=range(STATE_SEEDS))
    return made


complete = share(lambda run: run["ended"] == "complete" and run["reason"])  # runs that ended complete and said why


def _ends(name: str, title: str, furnished: bool, recall: float, precision: float) -> Table:
    """How the runs of some layouts ended."""
    heads = columns(
        "world; runs count; complete >= 1; silent most <= 0: open, no reason; unreachable most: open, with reason; "
        f"wall_recall least >= {recall}: recall; wall_precision least >= {precision}: precision; "
        "wall_rmse_m most <= 0.01; wall_contacts most <= 0; stuck most",
        complete=complete,
    )
    which = f"(?{'=' if furnished else '!'}(?:{'|'.join(FURNISHED)})/)"
    note = "Worst of the runs; complete: share that ended so, with a reason."
    return Table(name, title, f"runs/{which}{{world}}/*", heads, note=note)


TABLES = [
    _ends("plain", "One robot in plain layouts, starts drawn from the seed", False, 0.99, 0.99),
    _ends("furnished", "... in furnished layouts", True, 0.96, 0.97),
    Table(
        "times",
        "Simulated seconds and path to 90 %, 99 % and complete",
        "runs/{world}/*",
        columns(
            "world; t_90 median: T_90 s, median; t_90_spread spread: least-most; t_99 median: T_99 s, median; "
            "t_99_spread spread: least-most; ended_at: complete s, median; ended_at_spread: least-most; "
            "path_m median: path m, median; path_m_spread spread: least-most",
            ended_at=times(median, completed_at),
            ended_at_spread=times(spread, completed_at),
        ),
        note="∞: a run did not get so far.",
    ),
    Table(
        "maze-15",
        "Time to complete",
        "runs/maze-15/*",
        columns(
            f"world; ended_at <= {MAZE_15_S}: complete s",
            world=lambda runs, _: "maze-15",
            ended_at=times(median, completed_at),
        ),
    ),
    Table(
        "policies",
        "Default states; times and paths are medians",
        "policies/{world}/{state}/*",
        columns(
            "world; state: default state; complete >= 1; wall_recall least: recall, worst; "
            "ended_at: complete s; path_m median",
            complete=complete,
            ended_at=times(median, completed_at),
        ),
    ),
]
