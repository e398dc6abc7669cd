"""What a robot does first: tours through its tasks, and that it does not dither between them."""

import itertools

import numpy as np
import pytest

from agent.exploration.agenda import TOUR_TASKS, Task, agenda_of, first_of_tour, open_tour, tour_cost
from agent.exploration.config import ExplorationConfig
from agent.exploration.planning import Roads
from protocol.wireframe import Wireframe

HASTE = ExplorationConfig().haste


def roads_from(x: float, y: float) -> Roads:
    """The ways over a plane without walls."""
    return Roads(Wireframe(), np.array([x, y]), 0.18)


def end(x: float, y: float, begun: bool = False) -> Task:
    return Task("frontier", np.array([x, y]), np.array([x, y]), begun=begun)


def sweep(x: float, y: float, begun: bool = False) -> Task:
    return end(x, y, begun)._replace(kind="sweep")


def first(tasks: list[Task], haste: float = HASTE, detour_m: float = 4.0) -> tuple[float, float]:
    x, y = first_of_tour(agenda_of(tasks, roads_from(0, 0)), detour_m, haste).stand
    return float(x), float(y)


@pytest.mark.parametrize("haste", [0.0, 0.25, 0.9])
def test_tours_are_good(haste: float) -> None:
    """Within 10 % of the best open tour of eight random places, by trying all orders."""
    rng = np.random.default_rng(0)
    for _ in range(5):
        places = rng.uniform(0, 10, (8, 2))
        waits = rng.random(8) < 0.5
        cost = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
        order = open_tour(cost, waits, haste)
        assert order[0] == 0
        assert sorted(order) == list(range(8))
        best = min(tour_cost(np.array((0, *rest)), cost, waits, haste) for rest in itertools.permutations(range(1, 8)))
        assert tour_cost(order, cost, waits, haste) <= 1.1 * best


def test_the_cost_of_a_tour_is_its_length_or_twice_the_mean_way_to_what_waits() -> None:
    cost = np.abs(np.subtract.outer(*2 * [np.array([0.0, 1.0, 3.0])]))
    order, both, last = np.arange(3), np.array([False, True, True]), np.array([False, False, True])
    assert tour_cost(order, cost, both, 0.0) == pytest.approx(3.0)
    assert tour_cost(order, cost, both, 1.0) == pytest.approx(2.0 * (1.0 + 3.0) / 2.0)
    assert tour_cost(order, cost, last, 1.0) == pytest.approx(2.0 * 3.0)


def test_what_is_begun_is_left_only_for_a_tour_that_is_better_by_the_gain() -> None:
    def goes_on(behind_m: float, haste: float = HASTE) -> bool:
        return first([end(3.0, 0, begun=True), end(-behind_m, 0)], haste) == (3.0, 0)

    assert first([end(3.0, 0), end(-2.9, 0)]) == (-2.9, 0)
    assert goes_on(2.9)
    assert not goes_on(0.5)
    assert goes_on(1.55, haste=0.0)  # turning first would save 1.45 m
    assert not goes_on(1.45, haste=0.0)  # and here 1.55 m
    crowd = [end(-0.02 * k, 2.0) for k in range(TOUR_TASKS + 1)]
    assert first([end(2.2, 0), *crowd]) != (2.2, 0)
    assert first([end(2.2, 0, begun=True), *crowd]) == (2.2, 0)  # though so many are nearer


def test_with_haste_open_ends_come_before_sweeps_and_many_before_one() -> None:
    hasty, calm = 0.9, 0.0
    a_sweep_behind = [sweep(-1.0, 0), end(1.2, 0)]
    assert first(a_sweep_behind, calm) == (-1.0, 0)
    assert first(a_sweep_behind, hasty) == (1.2, 0)
    three_ahead = [end(-2.0, 0), *(end(2.2, y) for y in (-0.5, 0.0, 0.5))]
    assert first(three_ahead, calm) == (-2.0, 0)
    assert first(three_ahead, hasty)[0] == 2.2


def test_no_open_end_waits_for_a_sweep_far_off_the_way() -> None:
    tasks = [end(6.0, 0), sweep(0, -2.0), sweep(6.0, -1.0)]
    assert first(tasks, detour_m=1.0) == (6.0, 0)
    assert first(tasks, detour_m=8.0) == (0, -2.0)
    assert first(tasks[1:], detour_m=1.0) == (0, -2.0)


@pytest.mark.parametrize("haste", [0.0, HASTE])
@pytest.mark.parametrize("seed", [0, 9, 26])
def test_a_robot_between_many_tasks_does_not_dither(seed: int, haste: float) -> None:
    """With the nearest 12 and no haste, seeds 9 and 26 turned at every step, for ever: on the way the 12 changed."""
    rng = np.random.default_rng(seed)
    left, here, begun, turns, path = rng.uniform(2, 18, (20, 2)), np.array([10.0, 10.0]), -1, 0, 0.0
    while len(left):
        assert path < 100
        tasks = [end(x, y, begun=k == begun) for k, (x, y) in enumerate(left)]
        stand = first_of_tour(agenda_of(tasks, roads_from(*here)), 4.0, haste).stand
        goal = int(np.flatnonzero((left == stand).all(1))[0])
        turns += begun not in (-1, goal)
        way = stand - here
        step = min(0.4, float(np.hypot(*way)))
        arrives = step < 0.4
        here = stand if arrives else here + way * (step / np.hypot(*way))
        path += step
        begun = -1 if arrives else goal
        left = np.delete(left, goal, 0) if arrives else left
    assert turns <= 2
