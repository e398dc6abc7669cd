"""What noise draws beside walls, before them and across them is none; what is built there stays."""

import numpy as np
import pytest

from agent.mapping.submaps.smears import lie_across
from agent.mapping.submaps.wireframe import wireframe_of
from tests.agent.mapping.submaps.test_chain import segments

OVERRUN_M = 0.3


@pytest.mark.parametrize(
    ("line", "times", "is_smear"),
    [
        ((3.0, 0.1, 3.3, -0.1), 4.0, True),
        ((3.0, 0.1, 3.3, -0.1), 3.9, False),  # seen too often
        ((3.1, 0.1, 3.1, -0.1), 4.0, False),  # square: the face of a partition's tip
        ((3.0, 0.2, 3.3, 0.05), 4.0, False),  # before the wall
        ((2.8, 0.2, 3.4, -0.1), 4.0, False),  # longer than noise draws
        ((5.9, 0.1, 6.2, -0.1), 4.0, False),  # past the wall's end
    ],
)
def test_a_line_obliquely_across_a_wall_that_was_seen_more_often_is_a_smear(
    line: tuple[float, float, float, float], times: float, is_smear: bool
) -> None:
    for walls in (segments((0, 0, 6, 0), line), segments((0, 0, 6, 0), line)[::-1]):
        walls["hits"] = (walls["high"] - walls["low"]) * np.where(walls["high"] - walls["low"] > 1, times, 1.0)
        assert lie_across(walls, OVERRUN_M).tolist() == [is_smear and wall["high"] < 1.0 for wall in walls]


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
    assert len(wireframe_of(walls, 0.0).edges) == 2
