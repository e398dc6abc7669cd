"""Poses, points and angles."""

import math

import numpy as np
import pytest

from protocol.geometry import apply, compose, relative, seen_from, wrapped


def test_angles_are_wrapped_to_half_a_period_with_its_upper_end() -> None:
    assert wrapped(3 * math.pi) == pytest.approx(math.pi)
    assert wrapped(-math.pi) == math.pi
    assert wrapped(0.3, 0.5) == pytest.approx(-0.2)
    assert wrapped(np.array([-7.0, 0.0, 7.0])) == pytest.approx([2 * math.pi - 7.0, 0.0, 7.0 - 2 * math.pi])


def test_relative_undoes_compose() -> None:
    a, b = (2.0, 3.0, 2.5), (-1.0, 0.5, 1.5)
    assert relative(a, compose(a, b)) == pytest.approx(b)
    assert compose(a, b)[2] == pytest.approx(4.0 - 2 * math.pi)


def test_points_go_into_the_frame_of_a_pose_and_back() -> None:
    pose, points = (2.0, 3.0, math.pi / 2), np.array([[1.0, 0.0], [-4.0, 2.0]])
    assert apply(pose, points)[0] == pytest.approx((2.0, 4.0))
    assert seen_from(pose, apply(pose, points)) == pytest.approx(points)
