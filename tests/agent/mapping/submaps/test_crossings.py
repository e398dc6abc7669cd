"""Walls end where others cross them, and a partition stands between two walls."""

import math

import numpy as np
import pytest

from agent.mapping.edges import MIN_WALL_M
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
    return np.asarray(wireframe.points[wireframe.labels == Label.NOMINAL].round(3), np.float64)


def test_walls_of_a_room_that_run_on_end_at_its_corners() -> None:
    room = segments((-0.2, 0, 6.25, 0), (6, -0.15, 6, 3.2), (6.2, 3, -0.25, 3), (0, 3.15, 0, -0.2))
    assert len(corners(room)) == 4 and not len(corners(room, 0.0))
    assert tips(ended(room, OVERRUN_M)) == [(0, 0, 6, 0), (0, 3, 0, 0), (6, 0, 6, 3), (6, 3, 0, 3)]


def test_at_a_corner_that_stands_out_both_walls_run_on_into_the_room() -> None:
    assert tips(ended(segments((0, 0, 6.2, 0), (6, 0.2, 6, -3)), OVERRUN_M)) == [(0, 0, 6, 0), (6, 0, 6, -3)]


def test_a_wall_is_two_where_a_partition_stands_on_it() -> None:
    """One face was seen too far, the other is a little short; no scan saw what is behind the partition's end."""
    walls = segments((0, 0, 6, 0), (3.0, -0.2, 3.0, 2), (3.0, 2, 3.15, 2), (3.15, 2, 3.15, 0.08))
    assert tips(ended(walls, OVERRUN_M))[:1] == [(0, 0, 3, 0)] and (3.15, 0, 6, 0) in tips(ended(walls, OVERRUN_M))
    assert {(3.0, 0.0), (3.15, 0.0)} <= set(map(tuple, corners(walls).tolist()))


@pytest.mark.parametrize(
    "faces",
    [
        ((3.0, -0.1, 3.0, 2),),
        ((3.0, -0.1, 3.0, 2), (3.55, 2, 3.55, -0.1)),  # may be of two partitions
        ((3.0, 2, 3.0, -0.1), (3.15, 2, 3.15, -0.1)),  # one face, mapped twice
    ],
)
def test_it_stays_one_where_a_face_is_unknown(faces: tuple[tuple[float, float, float, float], ...]) -> None:
    walls = ended(segments((0, 0, 6, 0), *faces), OVERRUN_M)
    assert len(walls) == 1 + len(faces) and (0, 0, 6, 0) in tips(walls)
    assert all(0.0 in (a[1], a[3]) for a in tips(walls))  # the faces end on it


def test_partitions_side_by_side_leave_the_walls_between_them() -> None:
    faces = [(x, -0.1, x, 2) for x in (1.0, 3.0)] + [(x, 2, x, -0.1) for x in (1.15, 3.15)]
    room = [(0, 0, 6, 0), *faces]
    walls = tips(ended(segments(*room, *((a, b + 5, c, d + 5) for a, b, c, d in room)), OVERRUN_M))
    for y in (0, 5):
        assert [wall for wall in walls if wall[1] == wall[3] == y] == [(0, y, 1, y), (1.15, y, 3, y), (3.15, y, 6, y)]


def test_a_face_behind_a_wall_does_not_end_it() -> None:
    """Where two partitions form an L, its outer faces meet 0.15 m beyond where the inner ones cross them."""
    walls = segments((0, 0.2, 0, 3.12), (0, 3, 4, 3), (4, 2.85, 0.1, 2.85), (0.15, 2.9, 0.15, 0.2))
    assert (0, 0.2, 0, 3) in tips(ended(walls, OVERRUN_M))


def test_walls_of_the_room_behind_end_none() -> None:
    """Two rooms, one wall of 0.15 m between them, and the walls that stand on it 0.2 m apart."""
    here = [(0, 0, 4, 0), (4, 0, 4, 3), (4, 3, 0, 3), (0, 3, 0, 0)]
    behind = [(3.8, -3, 8, -3), (8, -3, 8, -0.15), (8, -0.15, 3.8, -0.15), (3.8, -0.15, 3.8, -3)]
    assert tips(ended(segments(*here, *behind), OVERRUN_M)) == sorted(here + behind)


@pytest.mark.parametrize(
    "other",
    [
        (5.65, -1, 5.65, 3),  # 0.35 m before its end
        (3.8, 0.8, 7.8, -0.8),  # at a flat angle
        (5.8, 0.3, 5.8, 3),  # begins before it
        (6.1, 3, 6.1, -3),  # faces the other way, and goes on behind it
        (5.8, 0.28, 5.8, 0.08),  # ends before it
        (5.8, -0.2, 5.8, 0.2),  # may be before it only as it runs on
    ],
)
def test_what_crosses_elsewhere_leaves_a_wall_as_it_is(other: tuple[float, float, float, float]) -> None:
    assert (0, 0, 6, 0) in tips(ended(segments((0, 0, 6, 0), other), OVERRUN_M))


def test_a_wall_ends_before_the_first_face_and_keeps_half_of_itself() -> None:
    faces = (5.9, -1, 5.9, 3), (5.75, -1, 5.75, 3)
    for order in (faces, faces[::-1]):
        assert (0, 0, 5.75, 0) in tips(ended(segments((0, 0, 6, 0), *order), OVERRUN_M))
    assert (0, 0, 0.4, 0) in tips(ended(segments((0, 0, 0.4, 0), (0.15, -1, 0.15, 3)), OVERRUN_M))


def test_ends_do_not_depend_on_what_is_elsewhere() -> None:
    """Walls are found by tiles, which begin at the leftmost one."""
    room = [(0, 0, 6.25, 0), (6, -0.25, 6, 3)]
    for left in np.arange(-2.0, -0.5, 0.05):
        assert (0, 0, 6, 0) in tips(ended(segments(*room, (left, 5, left, 8)), OVERRUN_M)), left


def test_partitions_are_found_in_every_order_of_walls() -> None:
    """A slanted face that comes back to a wall is itself two, where a small partition stands on it."""
    slant, along = math.sin(math.radians(10.0)), math.cos(math.radians(10.0))
    down = [(5 + slant * a, along * a) for a in (9.0, -0.1, 3.0, 3.15)]
    face = (*down[0], *down[1])
    small = [(*down[k], down[k][0] + along, down[k][1] - slant) for k in (3, 2)]
    small[1] = (*small[1][2:], *small[1][:2])
    walls = [(0, 0, 8, 0), face, (4.85, -0.1, 4.85, 9), *small]
    found = [tips(ended(segments(*order), OVERRUN_M)) for order in (walls, walls[::-1])]
    assert found[0] == found[1] and {(0, 0, 4.85, 0), (5, 0, 8, 0)} <= set(found[0]) and len(found[0]) == 7


def test_no_part_of_a_wall_is_shorter_than_a_wall() -> None:
    """Such walls came out turned round."""
    walls = segments((2.417, 0.993, 1.434, 1.048), (1.789, 1.02, 2.385, 0.984), (2.173, 1.219, 2.195, 1.016))
    parts = ended(walls, OVERRUN_M)
    assert len(parts) == 3 and (parts["high"] - parts["low"] >= MIN_WALL_M).all()
    faces = [(x, -0.1, x, 2) for x in (1.0, 1.18)] + [(x, 2, x, -0.1) for x in (1.15, 1.3)]  # 3 cm of wall between them
    assert sum(a[1] == a[3] == 0.0 for a in tips(ended(segments((0, 0, 6, 0), *faces), OVERRUN_M))) == 2


def test_no_walls_have_no_ends() -> None:
    assert len(ended(segments((0, 0, 1, 0))[:0], OVERRUN_M)) == 0


def test_walls_run_on_as_far_as_the_lidars_ranges_scatter() -> None:
    assert overrun_of(LidarSpec()) == pytest.approx(5 * 0.0175 * 3.5)
    assert overrun_of(SICK) == pytest.approx(0.05)
    assert overrun_of(LidarSpec(range_max_m=12.0)) == MOST_OVERRUN_M
