"""What is seen from where."""

import math

import numpy as np
import pytest

from agent.geometry.visibility import hidden_by, visible_ring
from tests.sight import all_seen

WALLS = np.array([[1.0, -1.0, 1.0, 1.0], [-5.0, -5.0, -5.0, 5.0]])


def test_a_wall_hides_what_lies_behind_it() -> None:
    assert hidden_by(0.0, 0.0, 2.0, 0.0, WALLS) == 0
    eyes, targets = np.zeros((3, 2)), np.array([[2.0, 0.0], [0.9, 0.0], [2.0, 3.0]])
    assert all_seen(eyes, targets, WALLS).tolist() == [False, True, True]


def test_the_ring_of_what_is_seen_ends_at_walls_and_at_the_range() -> None:
    ring = visible_ring(0.0, 0.0, WALLS, 2.0, 90)
    radius, angle = np.hypot(*ring.T), np.arctan2(ring[:, 1], ring[:, 0])
    before = np.abs(angle) < math.pi / 4 - 1e-3
    assert ring[before, 0] == pytest.approx(1.0)
    assert radius[np.abs(angle) > math.pi / 4 + 1e-3] == pytest.approx(2.0)
