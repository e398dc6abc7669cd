"""Open ends as goals: what a robot found itself is not crowded out by what others tell, and nobody tries all anew."""

import numpy as np
import pytest

from agent.exploration.agenda import Task
from agent.exploration.config import DrivingConfig
from agent.exploration.goal_memory import REMEMBERED
from agent.exploration.goals import MOST_ENDS, MOST_HEARD_ENDS, Goals
from agent.exploration.planning import Roads
from agent.exploration.surroundings import Situation, Surroundings
from protocol.arrays import Floats
from protocol.messages import RobotSpec
from protocol.wireframe import Label, Wireframe
from tests.ideal import ideal_spec

SPEC = RobotSpec()
NONE = np.zeros((0, 4))


def strewn(own: int, heard: int) -> Wireframe:
    """Walls of 0.3 m with two open ends each, beside each other along y; the heard ones are nearer to the origin."""
    count = own + heard
    y = 0.5 * np.arange(count, 0, -1)
    start, end = np.column_stack([np.ones(count), y]), np.column_stack([np.full(count, 1.3), y])
    return Wireframe(
        np.stack((start, end), 1).reshape(-1, 2),
        np.full(2 * count, Label.FRONTIER, np.uint8),
        np.arange(2 * count, dtype=np.int32).reshape(-1, 2),
        np.ones(count, np.float32),
        np.arange(count) < own,
    )


def goals_of(wireframe: Wireframe, left_ends: Floats = NONE, spec: RobotSpec = SPEC) -> Goals:
    goals = Goals(2, spec)
    read(goals, wireframe, left_ends)
    return goals


def read(goals: Goals, wireframe: Wireframe, left_ends: Floats = NONE, version: int = 1) -> None:
    situation = Situation(1, wireframe, version, (0.0, 0.0, 0.0), Wireframe(), np.zeros((0, 2)), left_ends=left_ends)
    goals.read(Surroundings(DrivingConfig(), goals.spec).look(situation))


def test_many_near_ends_that_others_tell_of_do_not_crowd_out_far_own_ones() -> None:
    ends = goals_of(strewn(own=4, heard=100)).ends
    assert (~ends.heard).sum() == 8 and ends.heard.sum() == MOST_HEARD_ENDS
    assert ends.points[ends.heard, 1].max() <= 0.5 * MOST_HEARD_ENDS / 2  # the nearest


def test_few_ends_are_all_goals_whoever_saw_the_walls() -> None:
    assert len(goals_of(strewn(own=5, heard=MOST_HEARD_ENDS // 2)).ends.points) == 10 + MOST_HEARD_ENDS
    assert len(goals_of(strewn(own=MOST_ENDS, heard=0)).ends.points) == MOST_ENDS


def test_an_end_that_a_teammate_looked_at_in_vain_is_left_to_it() -> None:
    """The same place counts where the wall goes on the same way: not the other end at a corner, nor one farther on."""
    place, beside, other_way = (1.4, 0.55, 1.0, 0.0), (1.3, 0.75, 1.0, 0.0), (1.0, 0.5, 0.0, 1.0)
    goals = goals_of(strewn(own=2, heard=0), np.array((place, beside, other_way)))
    assert len(goals.ends.points) == 4
    left = {tuple(point) for point in goals.ends.points[goals.fresh()].round(1).tolist()}
    assert left == {(1.0, 0.5), (1.0, 1.0), (1.3, 1.0)}
    assert sum(map(bool, goals.reasons)) == 1 and not len(goals.again())


def test_an_end_that_two_robots_looked_at_in_vain_is_tried_again_by_both() -> None:
    """Each left it to the other, whatever changed in the map."""
    wall, goals = strewn(own=2, heard=0), goals_of(strewn(own=2, heard=0))
    here, along = goals.ends.points[0], goals.ends.along[0]
    goals.looked(Task("frontier", here, here + 0.5, along))
    goals.abandon(here, along, "still open seen from 1 standing points")
    read(goals, wall, np.array([(*here, *along)]), version=2)
    assert goals.again().tolist() == [0]
    assert goals.moved(Task("frontier", here, here + 0.5, along)) is not None


def test_no_more_open_ends_are_tried_than_are_remembered() -> None:
    """Each pushed out another one that was still open, which was tried anew: exploration never ended."""
    wall = strewn(own=REMEMBERED // 2 + 5, heard=0)
    goals, version = goals_of(wall), 1
    while len(rows := goals.fresh()) and version < REMEMBERED / MOST_ENDS + 5:
        for row in rows:
            goals.abandon(goals.ends.points[row], goals.ends.along[row], "no way to a standing point")
        version += 1
        read(goals, wall, version=version)
    assert not len(rows) and len(goals.memory.tried) == REMEMBERED
    assert len(goals.reasons) == REMEMBERED + 10 and all(goals.reasons)  # those that are too many, too
    closed = strewn(own=REMEMBERED // 2 + 4, heard=0)
    closed.points[:] += 0.0, 0.5  # the nearest one is there no more, so what was tried there makes room
    read(goals, closed, version=version + 1)
    assert len(goals.fresh())


@pytest.mark.parametrize(("own", "heard"), [(1 + MOST_ENDS // 2, 0), (0, 1 + MOST_HEARD_ENDS // 2)])
def test_ends_that_are_left_to_a_teammate_do_not_crowd_out_those_that_are_not(own: int, heard: int) -> None:
    """A robot was complete with open ends that nobody had looked at."""
    wall = strewn(own, heard)
    far = wall.points[:, 1].max()
    left = np.hstack((wall.points, np.tile(((-1.0, 0.0), (1.0, 0.0)), (own + heard, 1))))[wall.points[:, 1] < far]
    goals = goals_of(wall, left)
    assert sorted(goals.ends.points[goals.fresh()].tolist()) == [[1.0, far], [1.3, far]]


@pytest.mark.parametrize(("spec", "least_m", "most_m"), [(SPEC, 1.4, 2.0), (ideal_spec(), 0.2, 0.7)])
def test_a_robot_that_goes_by_what_it_sees_looks_on_from_off_the_wall(
    spec: RobotSpec, least_m: float, most_m: float
) -> None:
    """Along a wall of a wide hall nothing but the rest of the room tells it how far it has come."""
    wall = Wireframe(
        np.array(((-4.0, -0.4), (4.0, -0.4))),
        np.full(2, Label.FRONTIER, np.uint8),
        np.array(((0, 1),), np.int32),
        np.ones(1, np.float32),
        np.ones(1, np.bool_),
    )
    goals = goals_of(wall, spec=spec)
    tasks = goals.tasks(goals.fresh(), Roads(wall, np.array((1.0, 0.0)), 0.2))
    off_m = [float(task.stand[1]) + 0.4 for task in tasks]
    assert len(off_m) == 2 and all(least_m < off < most_m for off in off_m)


def test_an_end_is_told_once_somebody_has_looked_at_it_from_a_standing_point() -> None:
    goals = goals_of(strewn(own=2, heard=0))
    here, along = goals.ends.points[0], goals.ends.along[0]
    goals.abandon(here, along, "no way to a standing point")
    assert not goals.in_vain
    task = Task("frontier", here, here + 0.5, along)
    for _ in range(2):
        goals.looked(task)
        goals.abandon(here, along, "still open seen from 1 standing points")
    assert [told[:2] for told in goals.in_vain] == [tuple(here.tolist())]


def test_an_end_that_stays_open_is_looked_at_from_behind() -> None:
    """Where the tip of a thin wall does not show, nothing before it shows its back: half a building stayed unseen."""
    wall = Wireframe(
        np.array(((-4.0, 0.4), (-1.0, 0.4))),
        np.array((Label.FRONTIER, Label.OCCLUSION), np.uint8),
        np.array(((1, 0),), np.int32),  # its free side, and the robot, are below
        np.ones(1, np.float32),
        np.ones(1, np.bool_),
    )
    goals, roads, sides = goals_of(wall), Roads(wall, np.zeros(2), 0.2), []
    end = np.flatnonzero(~goals.ends.frontier)
    for _ in range(3):
        (task,) = goals.tasks(end, roads)
        sides.append(bool(task.stand[1] > 0.4))
        goals.looked(task)
    assert sides == [False, False, True]


def test_a_wall_that_is_looked_at_from_another_point_is_the_same_look() -> None:
    """It was begun anew whenever its path was, and a robot that goes on with it has its deadline."""
    goals, place = Goals(2, SPEC), np.array((0.0, 8.5))
    look = Task("look", place, place)
    assert goals.same(look, look._replace(stand=place + 0.3))
    assert not goals.same(look, look._replace(place=place + 0.3))
    assert not goals.same(look, Task("home", place, place))
