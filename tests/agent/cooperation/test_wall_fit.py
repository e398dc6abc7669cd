"""A transform that is a little off is put right on the walls that both maps have, and says what it is worth."""

import math

import numpy as np
import pytest

from agent.cooperation.wall_fit import fit_on_walls
from agent.geometry.transform import compose, inverse
from deploy.bench.errors import distance
from protocol.wireframe import Wireframe, enclosed
from tests.agent.alignment.test_alignment import moved

FRAME = np.array([3.0, -7.0, 2.1])
T = inverse(FRAME)
"""The pose of the peer's frame, of FRAME in its own, in the robot's."""
ROOM = enclosed([np.array([(0.0, 0), (5, 0), (5, 3), (3, 3), (3, 4), (0, 4)])])
HALL = enclosed([np.array([(0.0, 0), (5, 0), (5, 3), (25, 3), (25, 9), (0, 9)])])
CENTRE = FRAME[:2]


@pytest.mark.parametrize("off", [(0.06, -0.04, 0.015), (-0.05, 0.05, -0.02)])
def test_a_transform_that_is_off_is_fitted_to_the_millimetre(off: tuple[float, float, float]) -> None:
    start = compose(np.array(off), T)
    fit = fit_on_walls(ROOM, moved(ROOM, FRAME), start)
    metres, radians = distance(fit.transform, T, CENTRE)
    assert metres < 0.003 and math.degrees(radians) < 0.05


def test_walls_of_one_map_alone_do_not_pull_and_what_lies_far_off_is_known_less() -> None:
    fit = fit_on_walls(ROOM, moved(HALL, FRAME), compose(np.array([0.02, 0.02, 0.003]), T))
    metres, radians = distance(fit.transform, T, CENTRE)
    assert metres < 0.01 and math.degrees(radians) < 0.1
    near, far = moved(HALL, FRAME).points[[0, 3]]
    assert fit.sd_at(near) < 0.05 < 2 * fit.sd_at(far)


def test_without_walls_in_common_the_transform_stays_and_is_known_as_before() -> None:
    empty = Wireframe()
    start = compose(T, np.array([0.02, 0.0, 0.0]))
    fit = fit_on_walls(empty, moved(ROOM, FRAME), start)
    assert np.allclose(fit.transform, start)
    assert fit_on_walls(ROOM, moved(ROOM, FRAME), T).sd_at(fit.centre) < 0.5 * fit.sd_at(fit.centre)


def test_a_corridor_holds_no_transform_along_itself() -> None:
    corridor = Wireframe(
        np.array([(0.0, 0), (8, 0), (8, 2), (0, 2)]),
        np.full(4, 2, np.uint8),
        np.array([(0, 1), (2, 3)], np.int32),
        np.ones(2, np.float32),
        np.ones(2, np.bool_),
    )
    fit = fit_on_walls(corridor, corridor, np.array([0.03, 0.03, 0.0]))
    assert abs(fit.transform[1]) < 0.002 and abs(fit.transform[0] - 0.03) < 0.001
    assert fit.covariance[0, 0] > 4 * fit.covariance[1, 1]
