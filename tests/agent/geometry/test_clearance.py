"""Distances to walls, and motions that keep clear of them."""

import math

import numpy as np
import pytest

from agent.geometry.clearance import crosses, distance_to_walls, distances_to_walls, keeps_clear, path_clear

WALL = np.array([[0.0, 0.0, 2.0, 0.0]])


def test_the_nearest_place_of_a_wall_counts_and_its_ends_are_places() -> None:
    assert distances_to_walls(np.array([[1.0, 0.5], [3.0, 0.0], [-3.0, 4.0]]), WALL) == pytest.approx([0.5, 1.0, 5.0])
    assert distance_to_walls(0.0, 0.0, np.zeros((0, 4))) == math.inf


def test_segments_that_meet_cross_and_parallel_ones_do_not() -> None:
    assert crosses(1.0, -1.0, 1.0, 1.0, *WALL[0])
    assert crosses(1.0, -1.0, 1.0, 0.0, *WALL[0])
    assert not crosses(1.0, -1.0, 1.0, -0.1, *WALL[0])
    assert not crosses(0.0, 0.0, 2.0, 0.0, *WALL[0])


def test_a_motion_keeps_clear_only_with_all_of_its_way() -> None:
    assert keeps_clear(-1.0, 0.3, 3.0, 0.3, WALL, 0.29)
    assert not keeps_clear(-1.0, 0.3, 3.0, 0.3, WALL, 0.31)
    assert not keeps_clear(1.0, -1.0, 1.0, 1.0, WALL, 0.01)
    corner = np.array([[-1.0, 1.0], [3.0, 1.0], [3.0, -1.0]])
    assert path_clear(corner, WALL, 0.9) and not path_clear(corner[:, ::-1].copy(), WALL, 0.9)
