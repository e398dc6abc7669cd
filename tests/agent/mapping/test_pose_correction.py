"""What pieces of walls, and their ends, tell of the robot's place."""

import math

import numpy as np
import pytest

from agent.corner_scan import NOMINAL, OCCLUSION, PIECE
from agent.mapping.association import OFFSET_GATE_M, Gates
from agent.mapping.edges import EDGE, WALL
from agent.mapping.joint import AXIS, BEGIN, end_at, know_walls, relate, row_of
from agent.mapping.kalman import Innovation
from agent.mapping.pose_correction import Axis, axis_of, correct_pose, hold_axis
from agent.mapping.strain import strain
from protocol.arrays import Floats, Records

POSE, NOISE = (0.0, 0.0, 0.0), 0.01
NOT_TENTATIVE = np.zeros(2, np.bool_)
OFF_M = 0.05


def moved_by(
    side: int, off: float, face: float = 0.0, hits: float = 30.0, stray: bool = False, slack: float = 0.01
) -> float:
    """By how much the robot moves along a wall from 2 to 4 m ahead, one end of which (side) is seen `off` m farther.

    It knows its place to 0.1 m and the wall well. face: metres of the piece that may be of the face beyond, by a slack
    in metres. hits: beams of the piece, as near ones count. stray: whether the end is that of a stray.
    """
    edges, joint = np.zeros(2, EDGE), np.zeros((row_of(2), row_of(2)))
    wall = edges[0]
    wall["kind"], wall["hits"], wall["x"], wall["y"], wall["ux"], wall["xx"] = WALL, 100.0, 3.0, -1.0, 1.0, 30.0
    wall["tip"], wall["link"], wall["label"], wall["strength"] = [(2.0, -1.0), (4.0, -1.0)], -1, OCCLUSION, 20.0
    joint[:3, :3] = np.diag((1e-9, 1e-9, 1e-9))
    know_walls(edges, 1, joint, POSE, NOISE, NOT_TENTATIVE)
    end = row_of(0) + 2 + side
    joint[end, end] = 1e-6
    joint[0, 0] = 0.1**2
    relate(edges, 1, joint, POSE)
    pieces = np.zeros(1, PIECE)
    piece = pieces[0]
    piece["hits"], piece["x"], piece["y"], piece["ux"], piece["spread"], piece["moment"] = (
        hits,
        3.0,
        -1.0,
        1.0,
        9.0,
        1.0,
    )
    piece["end"], piece["label"] = (-1.0, 1.0), -1
    piece["end"][side] += off
    piece["label"][side], piece["slack"][side], piece["face"][side] = OCCLUSION, slack, face
    piece["stray"][side] = stray
    shift = np.zeros(len(joint))
    gates = Gates(NOISE, OFFSET_GATE_M)
    correct_pose(edges, 1, pieces, np.zeros(1, np.int64), POSE, joint, shift, Axis(0.0, math.inf), gates)
    return float(shift[0])


@pytest.mark.parametrize("hits", [30.0, 0.2])
@pytest.mark.parametrize("side", [0, 1])
def test_an_end_holds_the_robot_along_its_wall_however_few_beams_show_it(side: int, hits: float) -> None:
    assert moved_by(side, OFF_M, hits=hits) == pytest.approx(-OFF_M, abs=0.008)


def test_an_end_beyond_which_hits_may_be_of_the_next_face_does_not() -> None:
    """It seems too far out, and pulled the robot along."""
    assert moved_by(0, OFF_M, face=0.002) == 0.0


@pytest.mark.parametrize("slack", [0.01, 0.1, 0.3, 0.6])
def test_an_end_is_farther_out_in_its_slack_the_flatter_it_is_seen(slack: float) -> None:
    """As seen flat, ends in the middle of their slack seemed too near, and corridors of rooms came out too short."""
    assert moved_by(1, -end_at(slack) * slack, slack=slack) == pytest.approx(0.0, abs=1e-9)
    assert [end_at(flat) for flat in (0.0, 0.2, 0.3, 0.5, 2.0)] == pytest.approx([0.53, 0.53, 0.63, 0.83, 0.83])


def test_an_end_by_a_stray_does_not() -> None:
    assert moved_by(1, OFF_M, stray=True) == 0.0


def test_an_end_in_the_middle_of_a_wall_is_none_of_its_corners() -> None:
    assert moved_by(1, -1.0) == 0.0


@pytest.mark.parametrize("steady", [True, False])
def test_a_wall_that_scans_steadily_place_elsewhere_lets_go(steady: bool) -> None:
    """Four corners of 38 that were moved by a fault stayed, as the robot took the walls to be known to millimetres."""
    wall, joint = np.zeros(1, EDGE), np.zeros((row_of(1), row_of(1)))
    wall["ux"], wall["tip"] = 1.0, [(0.0, 0.0), (2.0, 0.0)]
    for scan in range(40):
        side = 1.0 if steady or scan % 2 else -1.0
        strain(wall[0], row_of(0), joint, -0.5, Innovation(0.03 * side, 2.5 * side))
    assert joint[row_of(0), row_of(0)] == pytest.approx(2 * 0.03**2 if steady else 0.0)
    assert joint[row_of(0) + 1, row_of(0) + 1] == pytest.approx(2 * 0.03**2 if steady else 0.0)


@pytest.mark.parametrize(
    ("steady", "axis_deg", "lets_go"), [(True, None, True), (False, None, False), (True, 4.0, True), (True, 0.0, False)]
)
def test_a_wall_that_scans_steadily_see_turned_lets_go(steady: bool, axis_deg: float | None, lets_go: bool) -> None:
    """A wall tilted about its near end, where most hits are, stayed by 2 to 4 degrees off and turned the robot.

    Of one that lies on the axis of all walls it is the pieces that err.
    """
    axis = Axis(0.0, math.inf) if axis_deg is None else Axis(math.radians(axis_deg), 0.001)
    edges, joint = np.zeros(2, EDGE), np.zeros((row_of(2), row_of(2)))
    wall, row = edges[0], row_of(0)
    wall["kind"], wall["hits"], wall["y"], wall["ux"], wall["xx"] = WALL, 1e4, -2.0, 1.0, 1e4
    wall["tip"], wall["link"] = [(-1.0, -2.0), (1.0, -2.0)], -1
    joint[:3, :3] = np.diag((1e-9, 1e-9, 1e-9))
    know_walls(edges, 1, joint, POSE, NOISE, NOT_TENTATIVE)
    joint[2, 2] = math.radians(0.3) ** 2
    relate(edges, 1, joint, POSE)
    gates, known = Gates(NOISE, OFFSET_GATE_M), []
    for scan in range(20):
        turn = math.radians(2.5) if steady or scan % 2 else -math.radians(2.5)
        pieces, shift = np.zeros(1, PIECE), np.zeros(len(joint))
        piece = pieces[0]
        piece["hits"], piece["y"], piece["spread"], piece["moment"] = 3.0, -2.0, 1.0, 1.0
        piece["ux"], piece["uy"], piece["end"] = math.cos(turn), math.sin(turn), (-0.5, 0.5)
        piece["label"] = -1
        correct_pose(edges, 1, pieces, np.zeros(1, np.int64), POSE, joint, shift, axis, gates)
        known.append(math.degrees(math.sqrt(joint[row + 1, row + 1])))
    assert (max(known) > 0.3) == lets_go


def test_a_piece_that_may_be_of_two_faces_tells_little_of_the_place_and_nothing_of_the_heading() -> None:
    """Where it shares a corner with the next piece, or lies in the middle of its wall, it is of one."""
    known_m, turned = [], []
    unsure = 0.005  # m2: the direction is known to 8 degrees, with 1 m2 to 0.6
    for spread, half_m, label in ((1.0, 0.5, -1), (unsure, 0.5, -1), (unsure, 0.5, NOMINAL), (unsure, 5.0, -1)):
        edges, joint = np.zeros(2, EDGE), np.zeros((row_of(2), row_of(2)))
        wall = edges[0]
        wall["kind"], wall["hits"], wall["x"], wall["y"], wall["ux"], wall["xx"] = WALL, 1e4, 0.0, -2.0, 1.0, 1e4
        wall["tip"], wall["link"] = [(-half_m, -2.0), (half_m, -2.0)], -1
        joint[:3, :3] = np.diag((1e-9, 1e-9, 1e-9))
        know_walls(edges, 1, joint, POSE, NOISE, NOT_TENTATIVE)
        joint[1, 1], joint[2, 2] = 0.1**2, 0.02**2
        relate(edges, 1, joint, POSE)
        pieces = np.zeros(1, PIECE)
        piece = pieces[0]
        piece["hits"], piece["y"], piece["spread"], piece["moment"] = 1.0, -2.0, spread, 1.0
        piece["ux"], piece["uy"], piece["end"] = math.cos(0.02), math.sin(0.02), (-0.5, 0.5)
        piece["label"] = label, -1
        shift = np.zeros(len(joint))
        gates = Gates(NOISE, OFFSET_GATE_M)
        correct_pose(edges, 1, pieces, np.zeros(1, np.int64), POSE, joint, shift, Axis(0.0, math.inf), gates)
        known_m.append(math.sqrt(joint[1, 1]))
        turned.append(shift[2])
    assert known_m[0] == pytest.approx(0.0104, rel=0.02)
    assert known_m[1] == pytest.approx(0.0303, rel=0.02)
    assert known_m[2] == known_m[3] == pytest.approx(known_m[0], rel=0.02)
    assert turned[0] < -0.01 and turned[1] == pytest.approx(0.0, abs=1e-6)
    assert turned[2] == turned[3] < -2e-4


def test_the_walls_of_the_first_look_give_the_axis_though_they_are_older_than_it() -> None:
    """They alone tell how the frame lies: a wall that is new when walls are rectilinear at last is turned to them."""
    edges, joint = np.zeros(2, EDGE), np.zeros((row_of(2), row_of(2)))
    off = math.radians(0.4)
    edges["kind"], edges["link"] = WALL, -1
    edges["ux"], edges["uy"] = (1.0, -math.sin(off)), (0.0, math.cos(off))
    for wall, sd_deg in enumerate((0.05, 0.4)):
        joint[row_of(wall) + 1, row_of(wall) + 1] = math.radians(sd_deg) ** 2
    shift = np.zeros(len(joint))
    angle = hold_axis(edges, np.array([1]), joint, shift, 0.0, Axis(0.5 * off, math.radians(0.1)))
    assert angle + shift[AXIS] == pytest.approx(0.0, abs=math.radians(0.05))
    assert shift[row_of(1) + 1] == pytest.approx(-off, rel=0.2)


def test_an_axis_begins_where_its_first_wall_is_about_to_be() -> None:
    """It began where that wall had been: the next walls then seemed to be turned by what the scan had found."""
    edges, joint, found = np.zeros(2, EDGE), np.zeros((row_of(2), row_of(2))), math.radians(1.0)
    edges["kind"], edges["link"], edges["ux"] = WALL, -1, 1.0
    shift = np.zeros(len(joint))
    for wall in range(2):
        joint[row_of(wall) + 1, row_of(wall) + 1] = math.radians(0.3) ** 2
        shift[row_of(wall) + 1] = found
    angle = hold_axis(edges, np.array([0, 1]), joint, shift, 0.0, Axis(0.0, math.radians(0.1)))
    assert angle + shift[AXIS] == pytest.approx(found)
    assert shift[row_of(1) + 1] == pytest.approx(found)


@pytest.mark.parametrize(("turned_m", "is_held"), [(1.2, True), (3.0, False)])
def test_one_turned_post_among_rectilinear_walls_takes_no_axis_away(turned_m: float, is_held: bool) -> None:
    edges = np.zeros(3, EDGE)
    walls = ((2.0, 0.0), (3.0, 0.5 * math.pi), (turned_m, 0.25 * math.pi))
    for wall, (size, angle) in zip(edges, walls, strict=True):
        wall["kind"], wall["hits"], wall["ux"], wall["uy"] = WALL, 100.0, math.cos(angle), math.sin(angle)
        wall["xx"], wall["yy"] = 100.0 * wall["ux"] ** 2, 100.0 * wall["uy"] ** 2
        wall["xy"] = 100.0 * wall["ux"] * wall["uy"]
        wall["tip"][1] = size * wall["ux"], size * wall["uy"]
    axis = axis_of(edges, 3, NOISE)
    assert math.isfinite(axis.sd) == is_held
    if is_held:
        assert math.sin(2.0 * axis.angle) == pytest.approx(0.0, abs=1e-6)


def test_the_face_of_a_post_turned_by_11_degrees_makes_rectilinear_walls_scatter_no_more() -> None:
    """Of 15 walls in `hall`, known to 0.05 degrees, it made a scatter of 0.5, and each new wall was as unsure."""
    edges = np.zeros(6, EDGE)
    walls = ((8.0, 0.0), (6.0, 90.05), (9.0, 179.95), (5.0, -90.0), (6.0, 0.05), (0.1, 10.8))
    for wall, (size, angle_deg) in zip(edges, walls, strict=True):
        angle, hits = math.radians(angle_deg), 200.0
        wall["kind"], wall["hits"], wall["ux"], wall["uy"] = WALL, hits, math.cos(angle), math.sin(angle)
        moment = hits * size**2 / 12.0
        wall["xx"], wall["yy"] = moment * wall["ux"] ** 2, moment * wall["uy"] ** 2
        wall["xy"] = moment * wall["ux"] * wall["uy"]
        wall["tip"][1] = size * wall["ux"], size * wall["uy"]
    axis = axis_of(edges, 6, NOISE)
    assert axis.sd < math.radians(0.15)
    assert axis.angle == pytest.approx(0.0, abs=math.radians(0.05))


def two_walls_ahead() -> tuple[Records, Floats, Records]:
    """Walls of one line 2 m to the left, known to a millimetre, the covariance of all, and what one sees of both."""
    edges, joint, pieces = np.zeros(3, EDGE), np.zeros((row_of(3), row_of(3))), np.zeros(2, PIECE)
    for e, x in enumerate((-2.0, 2.0)):
        wall, row = edges[e], row_of(e)
        wall["kind"], wall["hits"], wall["x"], wall["y"], wall["ux"], wall["xx"] = WALL, 2e3, x, 2.0, -1.0, 2e3
        wall["seen"], wall["tip"], wall["link"] = 50.0, [(x + 1.0, 2.0), (x - 1.0, 2.0)], -1
        joint[row, row], joint[row + 1, row + 1] = 0.001**2, math.radians(0.02) ** 2
    joint[:3, :3] = np.diag((0.1**2, 0.1**2, math.radians(1.0) ** 2))
    joint[BEGIN : BEGIN + 3, BEGIN : BEGIN + 3] = joint[:3, BEGIN : BEGIN + 3] = joint[:3, :3]
    joint[BEGIN : BEGIN + 3, :3] = joint[:3, :3]
    relate(edges, 2, joint, POSE)
    pieces["hits"], pieces["x"], pieces["y"], pieces["ux"] = 100.0, (-2.0, 2.0), 2.0, -1.0
    pieces["spread"], pieces["end"], pieces["label"], pieces["link"], pieces["moment"] = 30.0, (-0.9, 0.9), -1, -1, 1.0
    return edges, joint, pieces


@pytest.mark.parametrize("error_m", [0.0, 0.03, -0.03, 0.1])
def test_a_wall_lets_go_by_what_the_scan_leaves_of_it_however_far_the_prediction_was_off(error_m: float) -> None:
    edges, joint, pieces = two_walls_ahead()
    edges[1]["strain"][0], pieces["y"] = -2.6, (2.0 - error_m, 1.98 - error_m)
    shift, unbound = np.zeros(len(joint)), Axis(0.0, math.inf)
    correct_pose(edges, 2, pieces, np.array([0, 1]), POSE, joint, shift, unbound, Gates(NOISE, OFFSET_GATE_M))
    assert 0.015 < math.sqrt(joint[row_of(1), row_of(1)]) < 0.025


def test_whether_a_new_face_lies_on_the_axis_is_asked_of_the_heading_as_this_scan_found_it() -> None:
    """An oblique face seemed square to the heading that was predicted, and turned the robot back to it."""
    found_deg = []
    for is_there in (False, True):
        edges, joint, pieces = two_walls_ahead()
        joint[AXIS, AXIS] = math.radians(0.02) ** 2
        turn = -math.radians(1.0)  # of all that is seen, as the robot is turned by 1 degree more than it thinks
        c, s = math.cos(turn), math.sin(turn)
        pieces["x"], pieces["y"], pieces["ux"], pieces["uy"] = -2.0 * s, 2.0 * c, -c, -s
        if is_there:
            pieces[1]["x"], pieces[1]["y"], pieces[1]["hits"] = 2.0, -1.0, 40.0
            pieces[1]["ux"], pieces[1]["uy"] = 0.0, 1.0
        else:
            pieces = pieces[:1]
        shift, axis, gates = np.zeros(len(joint)), Axis(0.0, math.radians(0.1)), Gates(NOISE, OFFSET_GATE_M)
        correct_pose(edges, 2, pieces, np.array([0, -1]), POSE, joint, shift, axis, gates)
        found_deg.append(math.degrees(shift[2]))
    assert found_deg[0] == pytest.approx(1.0, abs=0.1)
    assert found_deg[1] == pytest.approx(found_deg[0], abs=0.02)


def moved_onto(before_m: float, tail_m: float, label: int, end: int = OCCLUSION, end_sd_m: float = 0.0) -> float:
    """By how much a wall from x = 3 to -3 m, known to 40 mm, moves onto another one before it, which a piece shows.

    That begins at x = tail_m, with an end of this label. end, end_sd_m: label of the wall's own end at 3 m, and how
    well that is known along the wall.
    """
    edges, joint, pieces = two_walls_ahead()
    wall, other = edges[0], edges[1]
    wall["tip"], wall["label"] = [(3.0, 2.0), (-3.0, 2.0)], (end, OCCLUSION)
    other["y"], other["tip"] = 2.0 - before_m, [(tail_m, 2.0 - before_m), (1.5, 2.0 - before_m)]
    other["label"] = label, OCCLUSION
    joint[:3] = joint[:, :3] = joint[BEGIN : BEGIN + 3] = joint[:, BEGIN : BEGIN + 3] = 0.0
    joint[row_of(0), row_of(0)] = 0.04**2
    relate(edges, 2, joint, POSE)
    wall["tip_sd"][0] = end_sd_m
    pieces, shift, unbound = pieces[1:], np.zeros(len(joint)), Axis(0.0, math.inf)
    pieces["y"], pieces["end"], pieces["label"] = other["y"], (-0.4, 0.4), OCCLUSION
    correct_pose(edges, 2, pieces, np.array([1]), POSE, joint, shift, unbound, Gates(NOISE, OFFSET_GATE_M))
    return float(shift[row_of(0)])


def test_a_wall_is_not_moved_onto_the_back_of_a_shelf_before_it() -> None:
    """Both were on one line within what was known of the wall; but the shelf has a corner where the wall goes on."""
    assert moved_onto(0.06, 2.5, NOMINAL) == 0.0
    assert moved_onto(0.06, 2.5, OCCLUSION) == pytest.approx(0.06, abs=0.002)
    assert moved_onto(0.01, 2.5, NOMINAL) == pytest.approx(0.01, abs=0.002)


def test_a_wall_mapped_twice_comes_together_though_its_corner_is_displaced_along_it() -> None:
    assert moved_onto(0.05, 2.85, NOMINAL, NOMINAL, 0.03) == pytest.approx(0.05, abs=0.002)
    assert moved_onto(0.05, 2.85, NOMINAL, NOMINAL, 0.003) == 0.0  # known too well for that
    assert moved_onto(0.05, 2.85, NOMINAL, OCCLUSION, 0.03) == 0.0  # no corner there
