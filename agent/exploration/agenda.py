"""What is worth going to, and what of it comes first (ours)."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from agent.exploration.config import ExplorationConfig
from agent.exploration.planning import Roads
from agent.exploration.tour import open_tour, tour_cost
from protocol.arrays import Floats

Kind = Literal["frontier", "occlusion", "sweep", "edge", "vertex", "perimeter", "errand", "retreat", "park"]

_FAR_M = 1e6
"""Stands for no way, as a tour cannot add up infinities."""


class Task(NamedTuple):
    """Something to look at, and from where."""

    kind: Kind
    place: Floats
    """(2,) what is to be seen, metres."""
    stand: Floats
    """(2,) where to stand for it."""
    along: Floats = np.zeros(2)
    """(2,) unit, of an open end: where its wall goes on."""
    extra_m: float = 0.0
    """Metres of path that this standing point is worse than its place tells."""
    samples: Floats | None = None
    """(n, 2) samples of free area that a sweep is to see from there."""
    begun: bool = False
    """Whether the robot is on its way there."""


def is_end(task: Task) -> bool:
    """Whether the task is an open end of a wall."""
    return task.kind in ("frontier", "occlusion")


def not_nearer_to(rivals: Floats, tasks: list[Task], roads: Roads) -> list[Task]:
    """Tasks that no teammate is nearer to by path.

    rivals: (k, 3) places of teammates, and metres by which each must be nearer to have a task.
    """
    if not len(rivals) or not tasks:
        return tasks
    stands = np.array([task.stand for task in tasks])
    mine, kept = roads.costs(stands), np.ones(len(tasks), np.bool_)
    for x, y, ahead in rivals:
        kept &= mine <= roads.starting_at(np.array([x, y])).costs(stands) + ahead
    return [task for task, keep in zip(tasks, kept, strict=True) if keep]


def first_of_tour(tasks: list[Task], roads: Roads, config: ExplorationConfig, detour_m: float) -> Task:
    """The task that a short tour through the nearest of them does first.

    An open end is not kept waiting for a sweep that is more than detour_m (metres) off the way to it. The task that
    is begun is left only where the best tour is better by config.switch_gain_m than the best that goes on with it.
    """
    stands = np.array([task.stand for task in tasks])
    costs = np.minimum(roads.costs(stands) + np.array([task.extra_m for task in tasks]), _FAR_M)
    near: list[int] = np.lexsort((costs, [not task.begun for task in tasks]))[: config.tour].tolist()
    table = np.zeros((len(near) + 1, len(near) + 1))
    table[0, 1:] = costs[near]
    for k, stand in enumerate(stands[near]):
        table[k + 1, 1:] = np.minimum(roads.starting_at(stand).costs(stands[near]), _FAR_M)
    ends = np.array([False, *(is_end(tasks[k]) for k in near)])
    order = open_tour(table, ends, config.haste)
    if tasks[near[0]].begun:
        going_on = np.append(0, 1 + open_tour(table[1:, 1:], ends[1:], config.haste))
        best = tour_cost(order, table, ends, config.haste)
        if tour_cost(going_on, table, ends, config.haste) <= best + config.switch_gain_m:
            return tasks[near[0]]
    visits: list[int] = order.tolist()
    first_end = next((k for k in visits if ends[k]), 0)
    for k in visits[1:]:
        if not first_end or table[0, k] + table[k, first_end] - table[0, first_end] <= detour_m:
            return tasks[near[k - 1]]
    raise AssertionError("the first open end ends the loop")
