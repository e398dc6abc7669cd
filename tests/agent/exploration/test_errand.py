"""The explorer drives to where a proposal is verified, and the errand itself says how that ended."""

import math

import numpy as np
import pytest

from agent.errand import Errand
from agent.exploration.surroundings import Situation
from protocol.geometry import compose, seen_from
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


@pytest.mark.parametrize("aside_m", [0.02, 0.1, 0.25])
@pytest.mark.parametrize("sight_m", [9.0, 2.5])
def test_an_errand_to_where_the_peer_stands_ends_beside_it(aside_m: float, sight_m: float) -> None:
    """What stands for 2 s is planned around: no drive to a peer that had parked arrived, and right proposals went."""
    robot, errand, mate = explorer(), Errand(np.array((2.0, 0.0)), 15), np.array([(2.0, aside_m)])
    pose = (-1.5, 0.0, 0.0)
    for tick in range(150):
        discs = seen_from(pose, mate)
        discs = discs[np.hypot(*discs.T) < sight_m]
        told = errand if tick >= errand.since else None
        scene = robot.look(Situation(tick, ROOM, 1, pose, Wireframe(), discs, errand=told))
        target = robot.place_of_contact(scene)
        if target is not None:
            motion = robot.drive(scene, target)
            ahead_m, turn = 0.2 * motion.speed_mps, 0.2 * motion.turn_rps
            pose = compose(pose, (ahead_m * math.cos(turn / 2), ahead_m * math.sin(turn / 2), turn))
    assert errand.ended == "arrived"
    assert 0.2 < math.dist(pose[:2], mate[0]) < 1.0
