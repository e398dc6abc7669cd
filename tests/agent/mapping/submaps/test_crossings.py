"""Walls end where others cross them, and a partition stands between two walls."""

import numpy as np
import pytest

from agent.mapping.submaps.crossings import MOST_OVERRUN_M, ended, overrun_of
from agent.mapping.submaps.wireframe import wireframe_of
from protocol.arrays import Floats, Records
from protocol.messages import LidarSpec
from protocol.wireframe import Label
from tests.agent.mapping.submaps.test_chain import segments

OVERRUN_M = 0.3
SICK = LidarSpec(beams=180, field_of_view_deg=180.0, range_max_m=80.0, noise_share=0.0)


def tips(walls: Records) -> list[tuple[float, float, float, float]]:
    """Tail and head of walls (n,), to the millimetre, in order."""
    ends = [(w["x"] + t * w["ux"], w["y"] + t * w["uy"]) for w in walls for t in (w["low"], w["high"])]
    return sorted((*a, *b) for a, b in np.array(ends).round(3).reshape(-1, 2, 2).tolist())


def corners(walls: Records, overrun_m: float = OVERRUN_M) -> Floats:
    """(n, 2) corners of the map of walls."""
    wireframe = wireframe_of(walls, overrun_m)
    wireframe.check()
    return wireframe.points[wireframe.labels == Label.NOMINAL].round(3)


def test_walls_of_a_room_that_run_on_end_at_its_corners() -> None:
    room = segments((-0.2, 0, 6.25, 0), (6, -0.15, 6, 3.2), (6.2, 3, -0.25, 3), (0, 3.15, 0, -0.2))
    assert len(corners(room)) == 4 and not len(corners(room, 0.0))
    assert tips(ended(room, OVERRUN_M)) == [(0, 0, 6, 0), (0, 3, 0, 0), (6, 0, 6, 3), (6, 3, 0, 3)]


def test_a_wall_is_two_where_a_partition_stands_on_it() -> None:
    """One face was seen too far, the other is a little short; no scan saw what is behind the partition's end."""
    walls = segments((0, 0, 6, 0), (3.0, -0.2, 3.0, 2), (3.0, 2, 3.15, 2), (3.15, 2, 3.15, 0.08))
    assert tips(ended(walls, OVERRUN_M))[:1] == [(0, 0, 3, 0)] and (3.15, 0, 6, 0) in tips(ended(walls, OVERRUN_M))
    assert {(3.0, 0.0), (3.15, 0.0)} <= set(map(tuple, corners(walls).tolist()))


@pytest.mark.parametrize("faces", [((3.0, -0.1, 3.0, 2),), ((3.0, -0.1, 3.0, 2), (3.9, 2, 3.9, -0.1))])
def test_it_stays_one_where_a_face_is_unknown(faces: tuple[tuple[float, float, float, float], ...]) -> None:
    """Two faces far apart may be of two partitions."""
    walls = ended(segments((0, 0, 6, 0), *faces), OVERRUN_M)
    assert len(walls) == 1 + len(faces) and (0, 0, 6, 0) in tips(walls)
    assert all(0.0 in (a[1], a[3]) for a in tips(walls))  # the faces end on it


def test_partitions_side_by_side_leave_the_walls_between_them() -> None:
    faces = [(x, -0.1, x, 2) for x in (1.0, 3.0)] + [(x, 2, x, -0.1) for x in (1.15, 3.15)]
    walls = tips(ended(segments((0, 0, 6, 0), *faces), OVERRUN_M))
    assert [wall for wall in walls if wall[1] == wall[3] == 0.0] == [(0, 0, 1, 0), (1.15, 0, 3, 0), (3.15, 0, 6, 0)]


def test_a_face_behind_a_wall_does_not_end_it() -> None:
    """Where two partitions form an L, its outer faces meet 0.15 m beyond where the inner ones cross them."""
    walls = segments((0, 0.2, 0, 3.2), (0, 3, 4, 3), (4, 2.85, 0.1, 2.85), (0.15, 2.9, 0.15, 0.2))
    assert (0, 0.2, 0, 3) in tips(ended(walls, OVERRUN_M))


@pytest.mark.parametrize(
    "other",
    [
        (5.5, -1, 5.5, 3),  # 0.5 m before its end
        (4.0, 0.8, 8.0, -0.8),  # at a flat angle
        (5.9, 1, 5.9, 3),  # far from it
        (6.1, 3, 6.1, -3),  # faces the other way, and goes on behind it
    ],
)
def test_what_crosses_elsewhere_leaves_a_wall_as_it_is(other: tuple[float, float, float, float]) -> None:
    assert (0, 0, 6, 0) in tips(ended(segments((0, 0, 6, 0), other), OVERRUN_M))


def test_no_walls_have_no_ends() -> None:
    assert len(ended(segments((0, 0, 1, 0))[:0], OVERRUN_M)) == 0


def test_walls_run_on_as_far_as_the_lidars_ranges_scatter() -> None:
    assert overrun_of(LidarSpec()) == pytest.approx(5 * 0.0175 * 3.5)
    assert overrun_of(SICK) == pytest.approx(0.05)
    assert overrun_of(LidarSpec(range_max_m=12.0)) == MOST_OVERRUN_M
