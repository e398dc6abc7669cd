"""A board has a face at its tip, however thin it is, and its sides stay where they are."""

import numpy as np
import pytest

from agent.mapping.submaps.segments import moved
from agent.mapping.submaps.wireframe import records_of, wireframe_of
from protocol.geometry import seen_from
from protocol.wireframe import Label
from tests.agent.mapping.submaps.test_chain import segments

OVERRUN_M = 0.3


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (2.0, -1.0, 0.7), (-3.0, 5.0, 4.0)])
def test_a_board_ends_in_a_face_that_stands_square_to_its_sides(pose: tuple[float, float, float]) -> None:
    board = moved(segments((3.0, 0.1, 0.0, 0.1), (0.0, 0.0, 3.06, 0.0)), np.array(pose))
    wireframe = wireframe_of(board, OVERRUN_M)
    wireframe.check()
    corners = seen_from(pose, wireframe.points[wireframe.labels == Label.NOMINAL])
    assert len(wireframe.edges) == 4
    assert sorted(corners.round(6).tolist()) == [[0.0, 0.0], [0.0, 0.1], [3.03, 0.0], [3.03, 0.1]]


@pytest.mark.parametrize("thick_m", [0.0, 1e-6, 0.04])
def test_sides_nearer_than_any_wall_is_long_share_their_tips(thick_m: float) -> None:
    wireframe = wireframe_of(segments((3.0, thick_m, 0.0, thick_m), (0.0, 0.0, 3.0, 0.0)), OVERRUN_M)
    wireframe.check()
    assert len(wireframe.edges) == 2 and len(wireframe.points) == 2


def test_walls_in_a_row_have_no_face_between_them() -> None:
    assert len(wireframe_of(segments((0.0, 0.0, 3.0, 0.0), (3.05, 0.02, 6.0, 0.02)), OVERRUN_M).edges) == 2


def test_scans_that_follow_tell_a_driving_robot_of_tips() -> None:
    assert len(records_of(segments((3.0, 0.1, 0.0, 0.1), (0.0, 0.0, 3.06, 0.0)))) == 2
