"""Who of a team does which task."""

import itertools

import numpy as np

from agent.exploration.agenda import TOUR_TASKS, agenda_of
from agent.exploration.auction import auction, own_share
from agent.exploration.config import DrivingConfig
from agent.exploration.surroundings import Situation, Surroundings
from protocol.messages import RobotSpec
from protocol.wireframe import Wireframe
from tests.agent.exploration.test_agenda import end, roads_from

NOBODY = np.zeros((0, 3))


def distances(starts: np.ndarray, stands: np.ndarray) -> np.ndarray:
    return np.hypot(*(starts[:, None] - stands[None]).transpose(2, 0, 1))


def by_the_rule(starts: np.ndarray, between: np.ndarray) -> list[int]:
    """The auction as it is defined: each bid is the shortest tour with the task put in, all worked out anew."""

    def length(robot: int, tour: list[int]) -> float:
        steps = sum(between[a, b] for a, b in itertools.pairwise(tour))
        return float(starts[robot, tour[0]] + steps)

    tours: list[list[int]] = [[] for _ in starts]
    owner = [-1] * len(between)
    while -1 in owner:
        bids = [
            (length(robot, new), robot, task, new)
            for robot, tour in enumerate(tours)
            for task in range(len(owner))
            if owner[task] < 0
            for new in ([*tour[:k], task, *tour[k:]] for k in range(len(tour) + 1))
        ]
        _, robot, task, tours[robot] = min(bids, key=lambda bid: bid[:3])
        owner[task] = robot
    return owner


def test_an_auction_follows_its_rule() -> None:
    rng = np.random.default_rng(0)
    for count in range(1, 9):
        robots, stands = rng.uniform(0, 10, (rng.integers(1, 5), 2)), rng.uniform(0, 10, (count, 2))
        starts, between = distances(robots, stands), distances(stands, stands)
        assert auction(starts, between).tolist() == by_the_rule(starts, between)


def share(here: tuple[float, float], partners: object = NOBODY, silent: object = NOBODY) -> list[float]:
    """Where (x) the robot's own share is of ends at both sides of the origin."""
    roads = roads_from(*here)
    agenda = agenda_of([end(x, 0.0) for x in (-6.0, -5.0, 5.0, 6.0)], roads)
    mine = own_share(agenda, roads, np.array(partners), np.array(silent))
    return sorted(float(task.stand[0]) for task in mine.tasks)


def test_of_two_robots_side_by_side_each_goes_its_way() -> None:
    assert share((-0.1, 0.0), [(0.1, 0.0, 0.0)]) == [-6.0, -5.0]
    assert share((0.1, 0.0), [(-0.1, 0.0, 0.0)]) == [5.0, 6.0]
    assert share((0.2, 0.0), [(0.3, 0.0, 0.0)]) == [-6.0, -5.0]  # though the other one is farther from all of these


def test_the_task_that_is_begun_is_among_those_that_are_divided() -> None:
    tasks = [*(end(0.1 * k, 5.0) for k in range(TOUR_TASKS)), end(30.0, 0.0, begun=True)]
    roads = roads_from(0.0, 0.0)
    mine = own_share(agenda_of(tasks, roads), roads, np.array([(0.0, 4.9, 0.0)]), NOBODY)
    assert mine.tasks[0].begun and len(mine.tasks) < TOUR_TASKS


def test_a_robot_alone_does_all_and_one_whose_teammates_are_nearer_nothing() -> None:
    assert share((0.0, 0.0)) == [-6.0, -5.0, 5.0, 6.0]
    assert share((0.0, 9.0), [(-5.5, 0.0, 0.0), (5.5, 0.0, 0.0)]) == []


def test_a_silent_teammate_has_what_it_is_nearer_to() -> None:
    assert share((0.2, 0.0), silent=[(0.3, 0.0, 0.0)]) == [-6.0, -5.0]
    assert share((-0.2, 0.0), silent=[(0.3, 0.0, 1.0)]) == [-6.0, -5.0, 5.0, 6.0]  # it may have gone since
    assert share((0.4, 0.0), [(0.3, 0.0, 0.0)], [(-7.0, 0.0, 0.0)]) == [5.0, 6.0]


def test_a_teammate_that_stands_in_sight_bids_like_one_that_drives() -> None:
    """Who stands for 2 s is planned around, and so had no way to any task: robots took the work of such a teammate."""
    spec, mate = RobotSpec(), np.array([(1.0, 0.0, 0.0)])
    around, shares = Surroundings(DrivingConfig(), spec), []
    for tick in range(12):
        scene = around.look(Situation(tick, Wireframe(), 1, (0.0, 0.0, 0.0), Wireframe(), mate[:, :2]))
        for roads in around.ways(scene):
            agenda = agenda_of([end(x, 0.0) for x in (-6.0, -5.0, 5.0, 6.0)], roads)
            for partners, silent in ((mate, NOBODY), (NOBODY, mate)):
                shares.append([float(task.stand[0]) for task in own_share(agenda, roads, partners, silent).tasks])
    assert around.teammates.in_the_way(tick)
    assert all(sorted(share) == [-6.0, -5.0] for share in shares)
