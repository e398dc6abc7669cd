"""What noise draws beside walls, before them and across them is none; what is built there stays."""

import math

import numpy as np
import pytest

from agent.mapping.submaps.segments import moved
from agent.mapping.submaps.smears import lie_across
from agent.mapping.submaps.wireframe import records_of, wireframe_of
from tests.agent.mapping.submaps.test_chain import segments

OVERRUN_M = 0.3


def across(turn_deg: float, before: float = 0.5, size: float = 0.4) -> tuple[float, float, float, float]:
    """A line across a wall along x, turned by so much against it, with that share of it before the wall."""
    x, y = size * math.cos(math.radians(turn_deg)), size * math.sin(math.radians(turn_deg))
    return 3.0 - before * x, before * y, 3.0 + (1 - before) * x, -(1 - before) * y


@pytest.mark.parametrize(
    ("line", "times", "is_smear"),
    [
        (across(40.0), 4.0, True),
        (across(40.0), 3.9, False),  # seen too often
        (across(65.0), 4.0, True),
        (across(75.0), 4.0, False),  # square: the face of a partition's tip
        (across(40.0, 0.85), 4.0, True),
        (across(40.0, 0.95), 4.0, False),  # runs on past the wall
        (across(40.0, 0.05), 4.0, False),
        (across(40.0, 0.5, 0.59), 4.0, True),
        (across(40.0, 0.5, 0.61), 4.0, False),  # longer than noise draws
        ((2.0, 0.4, 2.3, 0.2), 4.0, False),  # before the wall
        ((5.9, 0.1, 6.2, -0.1), 4.0, False),  # past its end
    ],
)
def test_a_line_obliquely_across_a_wall_that_was_seen_more_often_is_none(
    line: tuple[float, float, float, float], times: float, is_smear: bool
) -> None:
    walls = segments((0, 0, 6, 0), line)
    walls["hits"][0] *= times + 1e-9
    for turn in np.arange(0.0, 6.3, 0.3):
        turned = moved(walls, np.array((1.0, -2.0, turn)))
        assert lie_across(turned, OVERRUN_M).tolist() == [False, is_smear]
        assert lie_across(turned[::-1].copy(), OVERRUN_M).tolist() == [is_smear, False]
        assert len(wireframe_of(turned, OVERRUN_M).edges) == 2 - is_smear


@pytest.mark.parametrize(
    ("line", "hits", "kept"),
    [
        ((2, 0.1, 4, 0.2), 0.1, False),  # one look in twenty
        ((2, 0.1, 4, 0.2), 0.2, True),  # a cupboard, seen now and then
        ((2, 0.4, 4, 0.5), 0.1, True),  # farther from the wall than such lines are
        ((4, 0.2, 2, 0.1), 0.1, True),  # faces it
        ((2, -0.3, 4, -0.2), 0.1, True),  # behind it, perhaps in another room
        ((5.5, 0.1, 8.5, 0.2), 0.1, True),  # for the most part beside it
    ],
)
def test_a_wall_that_would_hide_one_seen_far_more_often_is_none(
    line: tuple[float, float, float, float], hits: float, kept: bool
) -> None:
    walls = segments((0, 0, 6, 0), line)
    walls["hits"][1] *= hits / 2.1
    assert len(wireframe_of(walls, OVERRUN_M).edges) == 1 + kept
    assert len(records_of(walls)) == 2  # a filter that goes on with these walls decides by its scans
