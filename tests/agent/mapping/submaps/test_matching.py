"""Scans against walls: what holds a heading where few walls are known."""

import math

import numpy as np
import pytest

from agent.mapping.submaps.matching import refine, tiles_of
from agent.mapping.submaps.segments import samples_along
from agent.mapping.submaps.tracking import ROUNDS, TRACKING_GATES_M
from tests.agent.mapping.submaps.test_chain import segments

PRIOR_SD = np.array((0.1, 0.1, math.radians(4.4)))  # of odometry after a metre and a quarter turn


@pytest.mark.parametrize(("metres", "left"), [(1.0, 0.4), (2.0, 0.08)])
def test_a_short_wall_takes_most_of_the_error_of_a_heading(metres: float, left: float) -> None:
    """Without the direction of the line, half and a sixth of it would be left."""
    wall, off = segments((3.0, 0.0, 3.0, metres)), math.radians(3.0)
    found = refine(
        samples_along(wall),
        tiles_of(wall),
        np.array((0.0, 0.0, off)),
        np.diag(PRIOR_SD**-2.0),
        TRACKING_GATES_M,
        ROUNDS,
    )
    assert abs(found.pose[2]) < left * off


def test_a_wall_that_is_another_one_turns_the_heading_little() -> None:
    """A cupboard's front, 15 degrees off the wall that is known there."""
    seen, known = segments((3.0, 0.0, 3.0, 1.5)), segments((3.2, 0.0, 2.8, 1.5))
    prior = np.diag((0.1, 0.1, math.radians(2.5))) ** 2
    found = refine(samples_along(seen), tiles_of(known), np.zeros(3), np.linalg.inv(prior), TRACKING_GATES_M, ROUNDS)
    assert abs(found.pose[2]) < math.radians(6.0)
