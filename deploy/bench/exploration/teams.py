"""Several robots: how often they touch each other, and whether two that meet in a narrow corridor both complete."""

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from deploy.bench.cases import Case, Figures, each
from deploy.bench.exploration.runs import LIMIT_S
from deploy.bench.explored import explore
from deploy.bench.layouts import written
from deploy.bench.tables import Table, least, most, total, whole

CORRIDOR = [
    *[[-5.0, -1.5], [-2.0, -1.5], [-2.0, -0.3], [2.0, -0.3], [2.0, -1.5], [5.0, -1.5]],
    *[[5.0, 1.5], [2.0, 1.5], [2.0, 0.3], [-2.0, 0.3], [-2.0, 1.5], [-5.0, 1.5], [-5.0, -1.5]],
]
"""Two rooms of 3 m x 3 m joined by a corridor of 4 m x 0.6 m."""
TEAMS, MEETINGS = 5, 10  # runs of each


def corridor(seed: int) -> dict[str, Any]:
    """World file of the corridor; the robots stand in its mouths, face each other, and must change rooms."""
    rng = np.random.default_rng(seed)
    (x, y), (u, v) = rng.uniform((1.0, -0.12), (2.4, 0.12), (2, 2)).tolist()
    walls = [[*a, *b] for a, b in pairwise(CORRIDOR)]
    return {"name": "corridor", "units": "m", "walls": walls, "spawns": [[-x, y, 0.0], [u, v, math.pi]]}


def measure_team(seed: int) -> Figures:
    """Contacts of each robot, and how each ended."""
    return _figures({"world": "maze-15", "robots": 5, "seed": seed, "starts": "random", "max_time_s": LIMIT_S})


def measure_meeting(seed: int) -> Figures:
    """Two robots that start head-on in the corridor."""
    return _figures({"world": written(corridor(seed)), "robots": 2, "seed": seed, "max_time_s": 1000.0})


def _figures(settings: Mapping[str, Any]) -> Figures:
    robots = list(explore(settings, {}).summary["robots"].values())
    return {
        "complete": sum(robot["ended"] == "complete" for robot in robots) / len(robots),
        "coverage": least(robots, "coverage"),
        "robot_contacts_all": total(robots, "robot_contacts"),
        **{key: most(robots, key) for key in ("robot_contacts", "wall_contacts", "t_99")},
    }


def cases(quick: bool) -> list[Case]:
    """Five robots in the maze from drawn starts, and meetings head-on."""
    return [
        *each("teams/maze-15/{seed}", measure_team, seed=range(0 if quick else TEAMS)),
        *each("head-on/{seed}", measure_meeting, seed=range(1 if quick else MEETINGS)),
    ]


TABLES = [
    Table(
        "teams",
        "Five robots in maze-15",
        whole("teams/maze-15/{seed}"),
        "seed; complete >= 1; robot_contacts <= 1: contacts of a robot; robot_contacts_all: of all; "
        "wall_contacts <= 0: with walls; coverage: least coverage",
    ),
    Table(
        "head-on",
        "Two robots head-on in a corridor of 0.6 m, worst run",
        "head-on/*",
        "runs count; complete least >= 1: both complete; coverage least >= 0.99: least coverage; "
        "robot_contacts most: contacts of a robot; wall_contacts most <= 0: with walls",
    ),
]
