"""What is worth going to, and what of it comes first (ours)."""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from agent.exploration.planning import Roads
from agent.exploration.tour import open_tour, tour_cost
from protocol.arrays import Floats

Kind = Literal["frontier", "occlusion", "sweep", "edge", "vertex", "perimeter", "errand", "retreat", "wait", "park"]

TOUR_TASKS = 40
"""Most tasks that are put in the best order, the nearest ones.

There are 8 in the median and 15 at most in maze-15, 21 and 34 in gbeltramo_building. With 12 of 20 and no haste a
robot may turn for ever, as those behind it drop out of the twelve on its way to those ahead.
"""
SWITCH_GAIN_M = 1.5
"""A tour that begins with another task must be this much better than one that goes on with the task begun, in metres
of path, or a robot between two tasks turns for ever."""
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
    """Metres of path that the view from this standing point is worse than a view from close by."""
    samples: Floats | None = None
    """(n, 2) samples of free area that a sweep is to see from there."""
    begun: bool = False
    """Whether the robot is on its way there."""


@dataclass(slots=True)
class Target:
    """The task under way."""

    task: Task
    path: Floats
    """(k, 2) from the robot to the standing point."""
    clearance: float
    """Distance that the path keeps from walls, metres."""
    deadline: float = math.inf
    """Tick at which it is given up."""
    looks_due: float = math.inf
    """Scans to be taken at the standing point before it is done."""
    looks: int = 0
    """Scans taken there."""
    stands: int = 1
    """Standing points tried, this one included."""
    stuck: int = 0
    """How often the robot stuck on the way."""

    @property
    def reason(self) -> str:
        """Why the robot goes there, in a few words."""
        return {"park": "complete", "wait": "wait for a teammate"}.get(self.task.kind, self.task.kind)


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
    left = roads.costs(stands) <= roads.costs_from(rivals[:, :2], stands) + rivals[:, 2:]
    return [task for task, keep in zip(tasks, np.all(left, axis=0), strict=True) if keep]


def first_of_tour(tasks: list[Task], roads: Roads, detour_m: float, haste: float) -> Task:
    """The task that a short tour through the nearest of them does first.

    An open end is not kept waiting for a sweep that is more than detour_m (metres) off the way to it. The task that
    is begun is left only where the best tour is better by SWITCH_GAIN_M than the best that goes on with it.
    haste: of `tour_cost`.
    """
    stands = np.array([task.stand for task in tasks])
    costs = np.minimum(roads.costs(stands) + np.array([task.extra_m for task in tasks]), _FAR_M)
    near: list[int] = np.lexsort((costs, [not task.begun for task in tasks]))[:TOUR_TASKS].tolist()
    table = np.zeros((len(near) + 1, len(near) + 1))
    table[0, 1:] = costs[near]
    table[1:, 1:] = np.minimum(roads.costs_from(stands[near], stands[near]), _FAR_M)
    ends = np.array([False, *(is_end(tasks[k]) for k in near)])
    order = open_tour(table, ends, haste)
    if tasks[near[0]].begun:
        going_on = np.append(0, 1 + open_tour(table[1:, 1:], ends[1:], haste))
        if tour_cost(going_on, table, ends, haste) <= tour_cost(order, table, ends, haste) + SWITCH_GAIN_M:
            return tasks[near[0]]
    visits: list[int] = order.tolist()
    first_end = next((k for k in visits if ends[k]), 0)
    for k in visits[1:]:
        if not first_end or table[0, k] + table[k, first_end] - table[0, first_end] <= detour_m:
            return tasks[near[k - 1]]
    raise AssertionError("the first open end ends the loop")
