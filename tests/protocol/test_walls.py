"""Walls as arrays."""

import numpy as np
import pytest

from protocol.walls import directions, lengths, neighbours, points_along

WALLS = np.array([[0.0, 0.0, 3.0, 4.0], [1.0, 1.0, 1.0, 1.0], [2.0, 0.0, 0.0, 0.0]])


def test_a_wall_has_a_length_and_a_direction_and_one_of_no_length_has_none() -> None:
    assert lengths(WALLS) == pytest.approx([5.0, 0.0, 2.0])
    assert directions(WALLS) == pytest.approx(np.array([[0.6, 0.8], [0.0, 0.0], [-1.0, 0.0]]))


def test_points_along_walls_are_the_middles_of_equal_pieces() -> None:
    points, wall = points_along(WALLS, np.array([1, 0, 2]))
    assert wall.tolist() == [0, 2, 2]
    assert points == pytest.approx(np.array([[1.5, 2.0], [1.5, 0.0], [0.5, 0.0]]))


def test_neighbours_follow_the_edges_and_ends_have_none() -> None:
    before, after = neighbours(np.array([[0, 2], [2, 1]]), 4)
    assert before.tolist() == [-1, 2, 0, -1] and after.tolist() == [2, -1, 1, -1]
