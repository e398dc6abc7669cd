"""What is left of a path while it is driven."""

import numpy as np
import pytest

from agent.exploration.path import ahead_of, length_of

CORNER = np.array([(-1.0, 0.2, 0.8, 0.2), (0.8, 0.2, 0.8, 3.0)])  # the inner side of a bend to the left
PATH = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 2.0)])
CLEARANCE_M = 0.19


def test_less_is_left_while_a_robot_passes_a_waypoint_at_some_distance() -> None:
    """More was, and a robot of 0.1 m/s took itself to be stuck eleven times in a building: 774 s instead of 481."""
    path, left = PATH, []
    for y in np.arange(-0.1, 1.0, 0.02):
        path = ahead_of(path, np.array((0.93, y)), CORNER, CLEARANCE_M)
        left.append(length_of(path))
    assert (np.diff(left) < 0).all()
    assert left[-1] == pytest.approx(1.02 + 0.07, abs=0.03)


def test_a_waypoint_is_left_out_where_the_next_one_is_in_reach_and_only_there() -> None:
    beside, wide = np.array((0.93, 0.1)), np.array((1.1, 0.1))
    assert len(ahead_of(PATH, beside, CORNER, CLEARANCE_M)) == 3
    assert len(ahead_of(PATH, wide, CORNER, CLEARANCE_M)) == 2


def test_what_is_left_begins_where_the_robot_can_go() -> None:
    """Beside a robot that was pushed behind a wall the path goes on, and that wall is between them."""
    behind = np.array((0.5, 1.0))
    assert ahead_of(PATH, behind, CORNER, CLEARANCE_M)[1] == pytest.approx(PATH[1])
