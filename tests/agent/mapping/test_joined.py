"""What is known of the parts of a wall is known of the whole once they are joined."""

import math

import numpy as np
import pytest

from agent.corner_scan import FRONTIER, OCCLUSION, PIECE
from agent.mapping.association import OFFSET_GATE_M, Gates
from agent.mapping.edges import EDGE, FREE, WALL
from agent.mapping.joined import hold_joined
from agent.mapping.joint import know_walls, move_walls, place_end, relate, row_of
from agent.mapping.scan_merge import _unite, merge_scan
from protocol.arrays import Floats, Records

NOISE, FAR_M, PLACE_SD_M, DIRECTION_SD = 0.01, 2.0, 0.002, math.radians(0.3)


def test_parts_of_a_wall_tell_its_direction_together_once_they_are_joined() -> None:
    """Each is turned by a deviation of its own direction, and millimetres off; they are 4 m apart."""
    edges, joint = np.zeros(4, EDGE), np.zeros((row_of(4), row_of(4)))
    joint[:3, :3] = np.eye(3) * 1e-9
    for e, x in enumerate((-FAR_M, FAR_M)):
        wall, row = edges[e], row_of(e)
        wall["kind"], wall["hits"], wall["x"], wall["y"], wall["seen"] = WALL, 200.0, x, 2.0, 50.0
        wall["ux"], wall["uy"] = -math.cos(DIRECTION_SD), -math.sin(DIRECTION_SD)
        wall["xx"], wall["label"], wall["link"] = 200.0, FRONTIER, -1
        wall["tip"] = [(x - wall["ux"] * s, 2.0 - wall["uy"] * s) for s in (1.0, -1.0)]
        joint[row, row], joint[row + 1, row + 1] = PLACE_SD_M**2, DIRECTION_SD**2
    relate(edges, 2, joint, (0.0, 0.0, 0.0))
    pieces = np.zeros(1, PIECE)
    pieces["hits"], pieces["y"], pieces["ux"], pieces["spread"], pieces["end"] = 100.0, 2.0, -1.0, 100.0, (-3.0, 3.0)
    pieces["label"], pieces["link"] = FRONTIER, -1
    before, gates = edges[:2].copy(), Gates(NOISE, OFFSET_GATE_M)
    merge_scan(edges, 2, pieces, np.zeros(1, np.int64), np.full(1, 0.5), gates, 1.0, True)
    assert edges["kind"].tolist() == [WALL, FREE, FREE, FREE]
    shift = np.zeros(len(joint))
    assert hold_joined(edges, before, joint, shift)
    move_walls(edges, shift)
    assert math.sqrt(joint[row_of(0) + 1, row_of(0) + 1]) < 0.25 * DIRECTION_SD
    assert edges["uy"][0] == pytest.approx(0.0, abs=0.2 * DIRECTION_SD)
    assert not shift[row_of(1) :].any()


@pytest.mark.parametrize("wall", [0, 1])
def test_a_wall_that_is_joined_with_a_short_one_keeps_its_line(wall: int) -> None:
    """Whichever of both the scan is of. The short one is turned by 3 degrees and has a hundredth of the hits."""
    edges, joint, face = np.zeros(2, EDGE), np.zeros((row_of(2), row_of(2))), 1 - wall
    joint[:3, :3] = np.eye(3) * 1e-9
    for e, x, half, turn in ((wall, 0.0, 2.0, 0.0), (face, 1.8, 0.1, math.radians(3.0))):
        w, row = edges[e], row_of(e)
        w["kind"], w["hits"], w["x"], w["y"], w["seen"] = WALL, 9000.0 if e == wall else 90.0, x, 2.0, 50.0
        w["ux"], w["uy"], w["xx"], w["label"], w["link"] = -math.cos(turn), -math.sin(turn), 1.0, FRONTIER, -1
        w["tip"] = [(x - w["ux"] * s, 2.0 - w["uy"] * s) for s in (half, -half)]
        joint[row, row], joint[row + 1, row + 1] = 1e-6, (1e-6 if e == wall else math.radians(1.5) ** 2)
    relate(edges, 2, joint, (0.0, 0.0, 0.0))
    pieces = np.zeros(1, PIECE)
    pieces["hits"], pieces["x"], pieces["y"], pieces["ux"] = 20.0, 1.7, 2.0, -1.0
    pieces["spread"], pieces["end"], pieces["label"], pieces["link"] = 0.2, (-0.2, 0.2), FRONTIER, -1
    before, shift = edges.copy(), np.zeros(len(joint))
    merge_scan(edges, 2, pieces, np.zeros(1, np.int64), np.full(1, 0.5), Gates(NOISE, OFFSET_GATE_M), 1.0, True)
    assert edges["kind"][wall] == WALL and edges["kind"][face] == FREE
    assert hold_joined(edges, before, joint, shift)
    move_walls(edges, shift)
    assert edges["uy"][wall] == pytest.approx(0.0, abs=math.radians(0.1))


def on_a_line(*spans_m: tuple[float, float]) -> tuple[Records, Floats]:
    """Walls of one line that a robot knows, each from one end to the other, and the covariance of all."""
    edges, n = np.zeros(len(spans_m), EDGE), len(spans_m)
    joint = np.zeros((row_of(n), row_of(n)))
    joint[:3, :3] = np.eye(3) * 1e-6
    for wall, (tail, head) in zip(edges, spans_m, strict=True):
        wall["kind"], wall["own"], wall["hits"], wall["seen"], wall["ux"] = WALL, 1, 100.0, 10.0, 1.0
        wall["x"], wall["xx"], wall["yy"] = 0.5 * (tail + head), 100.0 * (head - tail) ** 2 / 12.0, 1e-3
        wall["tip"], wall["link"] = [(tail, 0.0), (head, 0.0)], -1
        wall["label"], wall["strength"] = (FRONTIER, OCCLUSION), 5.0
    know_walls(edges, n, joint, (0.0, 0.0, 0.0), NOISE, np.zeros(0, np.bool_))
    return edges, joint


def test_what_was_known_of_an_end_goes_where_the_joint_wall_ends_elsewhere() -> None:
    """It lay 3 m before the end of both, which was taken to be known to a millimetre, and would have held the robot."""
    edges, joint = on_a_line((0.0, 2.0), (2.1, 5.0))
    end, own = row_of(0) + 3, np.array((0,))
    place_end(joint, end, own, np.ones(1), 1e-6)
    relate(edges, 2, joint, (0.0, 0.0, 0.0))
    assert edges["held"][0].tolist() == [0, 1]
    before, shift = edges.copy(), np.zeros(len(joint))
    _unite(edges, 0, 1)
    assert hold_joined(edges, before, joint, shift)
    assert edges["tip"][0, 1].tolist() == [5.0, 0.0]
    assert joint[end, end] == 0.0 and not joint[end].any()


def test_parts_of_parts_are_all_held_to_the_line_that_is_left() -> None:
    """The second of three was joined into the first, and that into the third: what moved the first counts for it."""
    edges, joint = on_a_line((2.0, 4.0), (4.1, 6.0), (0.0, 1.9))
    relate(edges, 3, joint, (0.0, 0.0, 0.0))
    before, shift = edges.copy(), np.zeros(len(joint))
    _unite(edges, 0, 1)
    _unite(edges, 2, 0)
    shift[[row_of(e) for e in range(3)]] = 0.01  # all of them move alike, so none is off another's line
    assert hold_joined(edges, before, joint, shift)
    assert shift[row_of(2)] == pytest.approx(0.01, abs=1e-6)
    assert not shift[row_of(0) : row_of(2)].any()


def test_walls_that_a_scan_leaves_apart_say_nothing_of_each_other() -> None:
    edges, joint = np.zeros(2, EDGE), np.eye(row_of(2))
    edges["kind"], shift = WALL, np.zeros(row_of(2))
    assert not hold_joined(edges, edges.copy(), joint, shift)
    assert not shift.any()


def test_what_parts_tell_does_not_hang_on_which_piece_came_first() -> None:
    """A new wall of the same scan took the record of the part that was joined, and what had been known of that."""
    known = []
    for order in ([0, 1], [1, 0]):
        edges, joint = on_a_line((-3.0, -1.0), (1.0, 3.0))
        pieces = np.zeros(2, PIECE)
        pieces["label"], pieces["link"] = FRONTIER, -1
        pieces["hits"], pieces["y"], pieces["ux"], pieces["spread"] = (100.0, 5.0), (0.0, -2.0), 1.0, (100.0, 0.1)
        pieces["end"] = (-3.0, 3.0), (-0.2, 0.2)
        edges, joint = np.append(edges, np.zeros(2, EDGE)), np.pad(joint, (0, row_of(4) - row_of(2)))
        before, shift = edges[:2].copy(), np.zeros(len(joint))
        walls = np.array([0, -1])[order]
        count = merge_scan(edges, 2, pieces[order], walls, np.full(2, 0.5), Gates(NOISE, OFFSET_GATE_M), 1.0, True)
        assert hold_joined(edges, before, joint, shift)
        know_walls(edges, count, joint, (0.0, 0.0, 0.0), NOISE, before["kind"] != WALL)
        known.append(joint[row_of(0) + 1, row_of(0) + 1])
    assert known[0] == pytest.approx(known[1])
