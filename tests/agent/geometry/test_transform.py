"""Rigid transforms of the plane: composed, inverted, fitted and compared."""

import math

import numpy as np
import pytest

from agent.geometry.transform import apart, compose, fit_on_points, inverse, move
from deploy.bench.errors import distance
from protocol.geometry import apply


def test_transforms_compose_invert_and_fit() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        a, b = rng.uniform(-3, 3, (2, 3))
        points = rng.uniform(-5, 5, (6, 2))
        assert apply(compose(a, b), points) == pytest.approx(apply(a, apply(b, points)))
        assert apply(inverse(a), apply(a, points)) == pytest.approx(points)
        assert apply(fit_on_points(points, apply(a, points), 6), points) == pytest.approx(apply(a, points))


def test_a_point_moves_as_points_do() -> None:
    t = np.array([2.0, -1.0, 0.7])
    assert move(t, 3.0, 4.0) == pytest.approx(apply(t, np.array([[3.0, 4.0]]))[0])


def test_transforms_are_compared_at_the_centre_of_the_map_that_they_move() -> None:
    centre = np.array([10.0, 0.0])
    turned = compose(np.array([*centre, math.radians(3.0)]), np.array([*-centre, 0.0]))
    metres, radians = distance(turned, np.zeros(3), centre)
    assert metres == pytest.approx(0.0, abs=1e-9) and radians == pytest.approx(math.radians(3.0))
    assert apart(turned, np.zeros(3), np.zeros(2), 0.3, 1.0)
    assert not apart(turned, np.zeros(3), centre, 0.3, 1.0)
    assert apart(turned, np.zeros(3), centre, 0.3, math.radians(2.0))
