"""Pose and walls are known together: what is learned of one moves all that err with it."""

import math

import numpy as np
import pytest

from agent.corner_scan import OCCLUSION
from agent.mapping.edges import EDGE, TENTATIVE, WALL, cut_out, line_sd, related
from agent.mapping.joint import WALLS, carry, hold_corners, know_walls, move_walls, place_end, relate, row_of
from agent.mapping.kalman import observe
from protocol.arrays import Floats, Records
from protocol.geometry import Pose

POSE: Pose = (0.5, -0.3, 0.7)
NOISE = 0.01
NOT_TENTATIVE = np.zeros(4, np.bool_)


def mapped() -> tuple[Records, Floats]:
    """Two walls at right angles, placed from a pose that is known to 0.1 m and 0.02 rad, and the covariance of all."""
    edges, joint = np.zeros(4, EDGE), np.zeros((row_of(4), row_of(4)))
    joint[:3, :3] = np.diag((0.1, 0.1, 0.02)) ** 2
    for wall, (x, y, ux, uy) in zip(edges, ((0.0, 2.0, -1.0, 0.0), (2.0, 0.0, 0.0, 1.0)), strict=False):
        wall["kind"], wall["hits"], wall["x"], wall["y"], wall["ux"], wall["uy"] = WALL, 100.0, x, y, ux, uy
        wall["xx"], wall["xy"], wall["yy"] = 30.0 * ux * ux, 30.0 * ux * uy, 30.0 * uy * uy
        wall["tip"], wall["link"] = [(x - ux, y - uy), (x + ux, y + uy)], -1
    assert know_walls(edges, 2, joint, POSE, NOISE, NOT_TENTATIVE).tolist() == [0, 1]
    return edges, joint


def test_walls_move_with_the_pose_that_they_were_placed_from() -> None:
    edges, joint = mapped()
    shift = np.zeros(len(joint))
    for row, off in ((0, 0.08), (1, -0.05)):
        observe(joint, shift, np.array((row,)), np.array((1.0,)), off, 1e-8, math.inf)
    before = edges.copy()
    move_walls(edges, shift)
    assert shift[:3] == pytest.approx((0.08, -0.05, 0.0), abs=1e-3)
    assert edges["y"][0] - before["y"][0] == pytest.approx(-0.05, abs=2e-3)
    assert edges["x"][1] - before["x"][1] == pytest.approx(0.08, abs=2e-3)
    assert edges["tip"][1, :, 0] - before["tip"][1, :, 0] == pytest.approx((0.08, 0.08), abs=2e-3)


def test_a_wall_is_known_better_from_where_it_was_seen_than_in_the_map() -> None:
    edges, joint = mapped()
    assert joint[row_of(0), row_of(0)] > 0.1**2
    relate(edges, 2, joint, POSE)
    assert line_sd(edges[0], 0.0, NOISE) < 0.002
    elsewhere = joint.copy()
    elsewhere[:3], elsewhere[:, :3] = 0.0, 0.0  # a robot that knows where it is, but not where that wall is
    relate(edges, 2, elsewhere, POSE)
    assert line_sd(edges[0], 0.0, NOISE) > 0.1


def test_an_end_is_known_along_its_wall_from_where_it_was_seen() -> None:
    """A corner as the wall is that it shares with another, an end of one wall by its own row, others not at all."""
    edges, joint = mapped()
    edges["link"][0, 0], edges["link"][1, 1] = 1, 0
    edges["label"][0, 1], edges["strength"][0, 1] = OCCLUSION, 9.0
    end, along_it = row_of(0) + 3, np.array((edges["ux"][0], edges["uy"][0], 0.0))
    x, y = edges["tip"][0, 1] - POSE[:2]
    along_it[2] = along_it[1] * x - along_it[0] * y
    place_end(joint, end, np.array((0, 1, 2)), along_it, 0.02**2)
    relate(edges, 2, joint, POSE)
    assert edges["tip_sd"][0] == pytest.approx((line_sd(edges[1], 2.0, NOISE), 0.02), rel=0.05)
    assert edges["tip_sd"][1] == pytest.approx((0.0, line_sd(edges[0], -2.0, NOISE)), rel=0.05)
    joint[:3], joint[:, :3] = 0.0, 0.0  # elsewhere
    relate(edges, 2, joint, POSE)
    assert (edges["tip_sd"][0] > 0.1).all()


@pytest.mark.parametrize("spare", [0, 8])
def test_what_a_cut_leaves_without_rows_is_known_by_its_hits_alone(spare: int) -> None:
    """It had the numbers of the wall that it was cut off: an exact wall, in rows beyond the last or of zeros."""
    edges, joint = mapped()
    edges["kind"][2:], edges["tip"][2:, 1] = WALL, 1.0
    edges = np.append(edges, edges[:1])
    new, count = cut_out(edges, 4, 0, -0.1, 0.1)
    assert (new, count) == (4, 5)
    know_walls(edges, count, joint, POSE, NOISE, np.zeros(4, np.bool_))
    joint = np.pad(joint, (0, spare))
    relate(edges, count, joint, POSE)
    assert related(edges[0]) and not related(edges[4])
    assert edges["twin"][4] == 0


def test_how_all_is_turned_and_shifted_together_stays_unknown_as_estimates_move() -> None:
    edges, joint = mapped()
    joint[:] = 0.0
    joint[row_of(0) + 3, row_of(0) + 3] = 1.0  # an end that is known by itself
    modes = together(edges, POSE)
    joint += modes @ modes.T
    shift = np.zeros(len(joint))
    shift[:3] = 0.2, -0.1, 0.05
    shift[row_of(0) : row_of(0) + 4] = 0.1, 0.2, 0.0, 0.3
    shift[row_of(1) : row_of(1) + 2] = -0.3, -0.1
    carry(edges, joint, shift, POSE)
    move_walls(edges, shift)
    x, y, heading = np.array(POSE) + shift[:3]
    modes = together(edges, (x, y, heading))
    joint[row_of(0) + 3, row_of(0) + 3] -= 1.0
    assert joint == pytest.approx(modes @ modes.T, abs=1e-9)


def together(edges: Records, pose: Pose) -> Floats:
    """(m, 3) errors of pose, two walls and the head of the first as all is turned about the origin, or shifted."""
    modes = np.zeros((row_of(4), 3))
    modes[:3] = [[-pose[1], 1.0, 0.0], [pose[0], 0.0, 1.0], [1.0, 0.0, 0.0]]
    for e in range(2):
        x, y, ux, uy = (float(edges[name][e]) for name in ("x", "y", "ux", "uy"))
        modes[row_of(e) : row_of(e) + 2] = [[ux * x + uy * y, -uy, ux], [1.0, 0.0, 0.0]]
        if e == 0:
            modes[row_of(e) + 3] = uy * x - ux * y, ux, uy
    return modes


def test_a_number_far_from_what_is_known_counts_little() -> None:
    _, joint = mapped()
    shift, rows, one = np.zeros(len(joint)), np.array((0,)), np.array((1.0,))
    observe(joint, shift, rows, one, 0.0, 0.001**2, math.inf)
    observe(joint, shift, rows, one, 1.0, 0.001**2, math.inf)
    assert abs(shift[0]) < 0.01


def test_a_number_of_something_else_counts_nothing() -> None:
    _, joint = mapped()
    shift, known = np.zeros(len(joint)), joint.copy()
    for off, moves in ((0.49, True), (36.0, False)):  # the pose is known to 0.1 m
        shift[:], joint[:] = 0.0, known
        observe(joint, shift, np.array((0,)), np.array((1.0,)), off, 0.01**2, 5.0)
        assert (shift[0] != 0.0) == moves
    assert np.array_equal(joint, known)


def test_both_parts_of_a_wall_that_is_cut_lie_on_one_line() -> None:
    edges, joint = mapped()
    edges[2] = edges[0]
    edges[2]["twin"] = 1
    assert len(know_walls(edges, 3, joint, POSE, NOISE, NOT_TENTATIVE)) == 0
    assert edges[2]["twin"] == 0
    shift = np.zeros(len(joint))
    observe(joint, shift, np.array((row_of(0),)), np.array((1.0,)), 0.05, 1e-8, math.inf)
    assert shift[row_of(2) : row_of(2) + 2] == pytest.approx(shift[row_of(0) : row_of(0) + 2])


def test_what_is_no_wall_any_more_has_no_rows() -> None:
    edges, joint = mapped()
    edges[1]["kind"] = 0
    know_walls(edges, 2, joint, POSE, NOISE, NOT_TENTATIVE)
    assert related(edges[0])
    assert not joint[row_of(1) :].any() and not joint[:, row_of(1) :].any()
    assert (np.linalg.eigvalsh(joint) > -1e-12).all() and joint[WALLS, WALLS] > 0


def test_a_steady_tentative_wall_holds_the_robot_and_is_new_once_it_is_a_wall() -> None:
    edges, joint = mapped()
    edges[2] = edges[0]
    edges[2]["kind"], edges[2]["relative"], edges[2]["seen"], edges[2]["due"] = TENTATIVE, 0.0, 8.0, 10.0
    assert len(know_walls(edges, 3, joint, POSE, NOISE, NOT_TENTATIVE)) == 0
    assert related(edges[2])
    known = joint[row_of(2) : row_of(2) + 2].copy()
    edges[2]["kind"] = WALL
    assert know_walls(edges, 3, joint, POSE, NOISE, np.array((False, False, True))).tolist() == [2]
    assert np.array_equal(joint[row_of(2) : row_of(2) + 2], known)


def test_a_tentative_wall_that_comes_and_goes_holds_no_robot() -> None:
    edges, joint = mapped()
    edges[1]["kind"], edges[1]["seen"], edges[1]["due"] = TENTATIVE, 4.0, 10.0
    know_walls(edges, 2, joint, POSE, NOISE, NOT_TENTATIVE)
    assert not related(edges[1])
    assert not joint[row_of(1) :].any()


def test_a_known_end_that_becomes_a_corner_says_where_the_other_wall_lies() -> None:
    """A new wall is known as the pose is that it was seen from, and the end that it meets was seen from the start."""
    edges, joint = mapped()
    wall, other = edges[0], edges[1]  # y = 2, from x = 1 to -1, and x = 2, whose head meets the tail of the first
    end = row_of(0) + 2
    wall["tip"][0], other["tip"][1], wall["held"][0] = (1.9, 2.0), (2.0, 2.0), 1
    joint[end, end] = 1e-6
    before = edges[:2].copy()
    wall["link"][0], other["link"][1], wall["tip"][0] = 1, 0, (2.0, 2.0)
    joint[row_of(0) : row_of(0) + 2] = joint[:, row_of(0) : row_of(0) + 2] = 0.0
    joint[row_of(0), row_of(0)] = joint[row_of(0) + 1, row_of(0) + 1] = 1e-8
    relate(edges, 2, joint, POSE)
    shift = np.zeros(len(joint))
    hold_corners(edges, before, joint, shift, NOISE)
    assert shift[row_of(1)] == pytest.approx(0.1, abs=0.02)  # to the left of a wall that goes up: to x = 1.9
    assert math.sqrt(joint[row_of(1), row_of(1)]) < 0.05
    assert not joint[end].any()
