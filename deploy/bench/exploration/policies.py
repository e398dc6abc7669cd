"""The default states: the four of the paper, and ours. What each finds after the last frontier, and at what cost."""

from itertools import product
from typing import get_args

from agent.exploration.config import DefaultState
from deploy.bench.cases import Case, each
from deploy.bench.exploration.runs import LIMIT_S, complete
from deploy.bench.explored import measure_run
from deploy.bench.tables import Table, columns

WORLDS = ["hall", "maze-15"]
"""One with pillars that stand free and are out of range from the walls, and one without."""
SEEDS = 3


def cases(quick: bool) -> list[Case]:
    """Every state in every world. Sweeps on the way belong to the states that sweep, not to the others."""
    made = []
    for world, state in product([] if quick else WORLDS, get_args(DefaultState)):
        fixed = {"world": world, "limit_s": LIMIT_S, "starts": "random"}
        fixed |= {"agent": {"exploration": {"default_state": state}}}
        made += each(f"policies/{world}/{state}/{{seed}}", measure_run, fixed, seed=range(SEEDS))
    return made


TABLES = [
    Table(
        "policies",
        "Default states; times and paths are medians",
        "policies/{world}/{state}/*",
        columns(
            "world; state: default state; complete >= 1; wall_recall least: recall, worst; "
            "ended_at median: complete s; path_m median",
            complete=complete,
        ),
    )
]
