"""Several robots that do not know of each other: who touches whom, and whether two in a narrow corridor both get on."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from deploy.bench.bars import Column, Section
from deploy.bench.cases import Case, Figures
from deploy.bench.exploration.runs import LIMIT_S, grouped
from deploy.bench.explored import explore

CORRIDOR = [
    *[[-5.0, -1.5], [-2.0, -1.5], [-2.0, -0.3], [2.0, -0.3], [2.0, -1.5], [5.0, -1.5]],
    *[[5.0, 1.5], [2.0, 1.5], [2.0, 0.3], [-2.0, 0.3], [-2.0, 1.5], [-5.0, 1.5], [-5.0, -1.5]],
]
"""Two rooms of 3 m x 3 m joined by a corridor of 4 m x 0.6 m."""
MEETINGS = 10


def corridor(seed: int) -> dict[str, Any]:
    """World file of the corridor; the robots stand in its mouths, face each other, and must change rooms."""
    rng = np.random.default_rng(seed)
    (x, y), (u, v) = rng.uniform((1.0, -0.12), (2.4, 0.12), (2, 2)).tolist()
    walls = [[*a, *b] for a, b in pairwise(CORRIDOR)]
    return {"name": "corridor", "units": "m", "walls": walls, "spawns": [[-x, y, 0.0], [u, v, math.pi]]}


def measure_team(world: Mapping[str, Any]) -> Figures:
    """Contacts of each robot, and how each ended."""
    return _figures(explore(world, {}).summary)


def measure_meeting(seed: int) -> Figures:
    """Two robots that start head-on in the corridor."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "corridor.yaml"
        path.write_text(json.dumps(corridor(seed)), encoding="utf-8")
        return _figures(explore({"world": str(path), "robots": 2, "seed": seed, "max_time_s": 1000.0}, {}).summary)


def _figures(summary: Mapping[str, Any]) -> Figures:
    robots = summary["robots"].values()
    return {
        "complete": sum(robot["ended"] == "complete" for robot in robots) / len(robots),
        "coverage": min(robot["coverage"] for robot in robots),
        "robot_contacts": max(robot["robot_contacts"] for robot in robots),
        "robot_contacts_all": sum(robot["robot_contacts"] for robot in robots),
        "wall_contacts": max(robot["wall_contacts"] for robot in robots),
        "t_99": max((robot["t_99"] or math.inf) for robot in robots) if all(r["t_99"] for r in robots) else None,
    }


def cases(quick: bool) -> list[Case]:
    """Five robots in the maze from drawn starts, and meetings head-on."""
    if quick:
        return [Case("head-on/0", measure_meeting, {"seed": 0})]
    teams = [
        {"world": "maze-15", "robots": 5, "seed": seed, "starts": "random", "max_time_s": LIMIT_S} for seed in range(5)
    ]
    made = [Case(f"teams/maze-15/{world['seed']}", measure_team, {"world": world}) for world in teams]
    return made + [Case(f"head-on/{seed}", measure_meeting, {"seed": seed}) for seed in range(MEETINGS)]


def sections(figures: Mapping[str, Figures]) -> list[Section]:
    """One row for each run of the team, and one for all meetings."""
    columns = [
        Column("seed", "seed"),
        Column("complete", "complete", at_least=1.0, digits=2),
        Column("robot_contacts", "contacts of a robot", at_most=1),
        Column("robot_contacts_all", "of all"),
        Column("wall_contacts", "with walls", at_most=0),
        Column("coverage", "least coverage", digits=4),
    ]
    runs = grouped(figures, "teams").get("maze-15", [])
    rows = [{"seed": str(seed), **run} for seed, run in enumerate(runs)]
    made = [Section("teams", "Five robots in maze-15", columns, rows)]
    meetings = [found for name, found in figures.items() if name.startswith("head-on/")]
    if meetings:
        row = {
            "complete": min(run["complete"] for run in meetings),
            "coverage": min(run["coverage"] for run in meetings),
            "robot_contacts": max(run["robot_contacts"] for run in meetings),
            "wall_contacts": max(run["wall_contacts"] for run in meetings),
            "runs": len(meetings),
        }
        head = [
            Column("runs", "runs"),
            Column("complete", "both complete", at_least=1.0, digits=2),
            Column("coverage", "least coverage", at_least=0.99, digits=4),
            Column("robot_contacts", "contacts of a robot"),
            Column("wall_contacts", "with walls", at_most=0),
        ]
        made.append(Section("head-on", "Two robots head-on in a corridor of 0.6 m, worst run", head, [row]))
    return made
