"""What is worth going to, and what of it comes first (ours)."""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from agent.exploration.planning import Roads
from agent.kernels import kernel, shared_kernel
from protocol.arrays import Bools, Floats, Ints

TaskKind = Literal[
    "frontier",
    "occlusion",
    "sweep",
    "glimpse",
    "edge",
    "vertex",
    "perimeter",
    "home",
    "look",
    "lap",
    "errand",
    "retreat",
    "wait",
    "park",
]

TOUR_TASKS = 40
"""Most tasks that are put in order, the nearest ones. maze-15 has 15 at most, gbeltramo_building 34.

Among the nearest 12 of 20, without haste, a robot may turn to and fro for ever: tasks behind it leave the twelve while
it drives to others.
"""
SWITCH_GAIN_M = 1.5  # m by which a tour must beat the best that begins with the task under way; else robots dither
FAR_M = 1e6  # stands for no way, as a tour cannot add up infinities
_LEAST_GAIN = 1e-9  # a change must make the tour this much cheaper, or rounding errors could go on for ever


class Task(NamedTuple):
    """Something to look at, and from where; or a place to be at, as home."""

    kind: TaskKind
    place: Floats  # (2,) what is to be seen, metres
    stand: Floats  # (2,) where to stand for it
    along: Floats = np.zeros(2)  # (2,) unit, of an open end: where its wall goes on
    extra_m: float = 0.0  # added to the path, metres: how much worse the view from there is than one from close by
    samples: Floats | None = None  # (n, 2) samples of free area that a sweep is to see from there
    begun: bool = False  # whether the robot is on its way there


class Agenda(NamedTuple):
    """Tasks that are put in order, and the costs of paths between them, metres."""

    tasks: list[Task]  # n of them
    costs: Floats  # (n,) to each from where the robot is; inf where there is no path
    between: Floats  # (n, n) to each from each; FAR_M where there is no path

    @property
    def stands(self) -> Floats:
        """(n, 2) where to stand for each."""
        return np.array([task.stand for task in self.tasks])

    def of(self, rows: Ints) -> "Agenda":
        """The tasks of some rows (k,) only."""
        return Agenda([self.tasks[k] for k in rows], self.costs[rows], self.between[np.ix_(rows, rows)])


@dataclass(slots=True)
class Target:
    """The task under way. Its ticks are those of `Scene.awake`."""

    task: Task
    path: Floats  # (k, 2) from the robot to the standing point
    clearance: float  # distance that the path keeps from walls, metres
    deadline: float = math.inf  # tick at which it is given up
    looks_due: float = math.inf  # scans to be taken at the standing point before it is done
    looks: int = 0  # scans taken there
    stands_tried: int = 1  # standing points, this one included
    stuck: int = 0  # how often the robot was stuck on the way
    chosen: int = 0  # tick at which it became the target

    def within(self, metres: float, here: Floats) -> bool:
        """Whether the standing point is no farther from here (2,) than that."""
        return math.hypot(*(self.task.stand - here)) <= metres


def is_end(task: Task) -> bool:
    """Whether the task is an open end of a wall."""
    return task.kind in ("frontier", "occlusion")


@shared_kernel
def tour_cost(order: Ints, cost: Floats, waits: Bools, haste: float) -> float:
    """Cost of a tour: its length where haste is 0, twice the mean way to the places that wait where haste is 1.

    order: (k,) rows of cost (n, n); waits: (n,) the places whose ways are averaged. Where no place waits, the cost
    is the length times 1 - haste.
    """
    left = 0
    for k in range(1, order.shape[0]):
        left += waits[order[k]]
    each = 2.0 * haste / max(left, 1)
    total = 0.0
    for k in range(order.shape[0] - 1):
        total += cost[order[k], order[k + 1]] * (1.0 - haste + each * left)
        left -= waits[order[k + 1]]
    return total


@kernel
def open_tour(cost: Floats, waits: Bools, haste: float) -> Ints:
    """Order (n,) in which to visit all rows of cost (n, n), starting from row 0 and ending anywhere.

    Nearest neighbour, then reversals of stretches (2-opt) and moves of single places until none makes the tour
    cheaper by `tour_cost`.
    """
    n = cost.shape[0]
    order, left = np.zeros(n, np.int64), np.ones(n, np.bool_)
    for k in range(1, n):
        left[order[k - 1]] = False
        rest = np.flatnonzero(left)
        order[k] = rest[cost[order[k - 1]][rest].argmin()]
    best = tour_cost(order, cost, waits, haste)
    improved = True
    while improved:
        improved = False
        for i in range(1, n):
            for j in range(1, n):
                for reverses in (True, False):
                    if i == j or (reverses and i > j):
                        continue
                    new = order.copy()
                    if reverses:
                        new[i : j + 1] = order[i : j + 1][::-1]
                    else:
                        new[i:j], new[j + 1 : i + 1] = order[i + 1 : j + 1], order[j:i]
                        new[j] = order[i]
                    total = tour_cost(new, cost, waits, haste)
                    if total < best - _LEAST_GAIN:
                        order, best, improved = new, total, True
                        break
    return order


def agenda_of(tasks: list[Task], roads: Roads) -> Agenda:
    """The nearest of some tasks, at least one, that which is begun first, and the costs of paths between them."""
    stands = np.array([task.stand for task in tasks])
    costs = roads.costs(stands)
    near = np.lexsort((with_extra(costs, tasks), np.array([not task.begun for task in tasks])))[:TOUR_TASKS]
    between = np.minimum(roads.costs_from(stands[near], stands[near]), FAR_M)
    return Agenda([tasks[k] for k in near], costs[near], between)


def with_extra(costs: Floats, tasks: list[Task]) -> Floats:
    """Costs (..., n) of paths to tasks, more where the view from there is worse, FAR_M at most."""
    return np.asarray(np.minimum(costs + np.array([task.extra_m for task in tasks]), FAR_M))


def first_of_tour(agenda: Agenda, detour_m: float, haste: float) -> Task:
    """The task that a short tour through all of an agenda does first.

    An open end is not kept waiting for a sweep that is more than detour_m (metres) off the way to it. The task that
    is begun is left only where the best tour is better by SWITCH_GAIN_M than the best that goes on with it.
    haste: of `tour_cost`.
    """
    tasks, n = agenda.tasks, len(agenda.tasks)
    table = np.zeros((n + 1, n + 1))
    table[0, 1:], table[1:, 1:] = with_extra(agenda.costs, tasks), agenda.between
    ends = np.array([False, *map(is_end, tasks)])
    order = open_tour(table, ends, haste)
    if tasks[0].begun:
        going_on = np.append(0, 1 + open_tour(agenda.between, ends[1:], haste))
        if tour_cost(going_on, table, ends, haste) <= tour_cost(order, table, ends, haste) + SWITCH_GAIN_M:
            return tasks[0]
    visits: list[int] = order.tolist()
    first_end = next((k for k in visits if ends[k]), 0)
    for k in visits[1:]:
        if not first_end or table[0, k] + table[k, first_end] - table[0, first_end] <= detour_m:
            return tasks[k - 1]
    raise AssertionError("the first open end ends the loop")
