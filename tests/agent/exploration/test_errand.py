"""The explorer drives to where a proposal is verified, and the errand itself says how that ended."""

import numpy as np

from agent.errand import Errand
from agent.exploration.surroundings import Situation
from protocol.wireframe import Wireframe
from tests.agent.exploration.test_explorer import NOBODY, explorer
from tests.agent.exploration.test_planning import chain

ROOM = chain([(-4, -2), (4, -2), (4, 2), (-4, 2), (-4, -2)])


def looked(robot, tick, errand, x=0.0):
    """A scene of the room, with the robot at x and the way that it takes, if any."""
    scene = robot.look(Situation(tick, ROOM, 1, (x, 0.0, 0.0), Wireframe(), NOBODY, errand=errand))
    return robot.place_of_contact(scene)


def test_an_errand_has_arrived_once_the_robot_stands_there():
    robot, errand = explorer(), Errand(np.array((2.0, 0.0)), 0)
    assert looked(robot, 0, errand) is not None and not errand.ended
    assert looked(robot, 1, errand, x=2.0) is None
    assert errand.ended == "arrived"


def test_an_errand_to_which_there_is_no_way_says_so():
    robot, errand = explorer(), Errand(np.array((20.0, 0.0)), 0)
    assert looked(robot, 0, errand) is None
    assert errand.ended == "no way"


def test_another_errand_to_the_same_place_begins_anew():
    """Errands were told apart by their places alone: what was left of the first drive's time and tries went on."""
    robot = explorer()
    first, second = (Errand(np.array((2.0, 0.0)), since) for since in (0, 5))
    target = looked(robot, 0, first)
    assert looked(robot, 1, first) is target
    assert looked(robot, 5, second) is not target and not second.ended
