"""Ends of walls: what is seen against one must lie near to it."""

import math

import numpy as np
import pytest

from agent.corner_scan import FRONTIER, NOMINAL, OCCLUSION, PIECE
from agent.mapping.association import OFFSET_GATE_M, Gates
from agent.mapping.edges import EDGE, WALL, join, set_tip, tip_at
from agent.mapping.ends import close_open_corners, cut_behind_partition, inner_ends_give_way, see_corner, see_end
from agent.mapping.scan_merge import merge_scan
from agent.mapping.slots import see_bare, show_slot
from agent.mapping.tentative import become_wall, wall_probability


@pytest.mark.parametrize(("seen_m", "end_m"), [(5.0, 45.0), (44.0, 44.0)])
def test_false_ends_along_a_long_wall_do_not_cut_it_and_its_own_end_may_move(seen_m: float, end_m: float) -> None:
    """In a ring of 60 m views that ended by mistake added up, and walls of 45 m were cut down to what was in sight."""
    edges = np.zeros(1, EDGE)
    edges["kind"], edges["ux"], edges["link"], edges["label"] = WALL, 1.0, -1, OCCLUSION
    set_tip(edges[0], 1, 45.0)
    for _ in range(6):
        see_end(edges, 0, 1, OCCLUSION, seen_m, 0.0, 0.0, 1.0)
    assert tip_at(edges[0], 1) == pytest.approx(end_m)


@pytest.mark.parametrize(("corner_m", "end_m"), [(5.0, 11.0), (10.9, 10.9)])
def test_what_stands_before_a_long_wall_forms_no_corner_with_it_far_from_its_end(corner_m: float, end_m: float) -> None:
    """One view of a cabinet 10 cm before a wall of 11 m cut it down to 5 m, as soon as the rest was mapped again."""
    edges, pieces = np.zeros(2, EDGE), np.zeros(2, PIECE)
    edges["kind"], edges["link"], edges["label"] = WALL, -1, FRONTIER
    edges["ux"], edges["uy"], edges["x"] = (1.0, 0.0), (0.0, 1.0), (0.0, corner_m)
    set_tip(edges[0], 1, 11.0)
    set_tip(edges[1], 0, 0.1)
    see_corner(edges, 0, 1, pieces[0], pieces[1], 1.0)
    assert tip_at(edges[0], 1) == pytest.approx(end_m)
    assert tip_at(edges[1], 0) == pytest.approx(0.1 if end_m > corner_m else 0.0)


@pytest.mark.parametrize(
    ("before_m", "views", "length_m", "gap_m", "room", "cut"),
    [
        (0.02, 5.0, 2.0, 0.0, 3, True),
        (0.1, 5.0, 2.0, 0.0, 3, False),  # a cabinet's side
        (0.02, 4.0, 2.0, 0.0, 3, False),
        (0.02, 5.0, 0.5, 0.0, 3, False),
        (0.02, 5.0, 2.0, 0.2, 3, False),  # a guess
        (0.02, 5.0, 2.0, 0.0, 2, False),
    ],
)
@pytest.mark.parametrize("head", [True, False])
def test_a_wall_is_cut_where_a_partition_ends_on_it(
    before_m: float, views: float, length_m: float, gap_m: float, room: int, cut: bool, head: bool
) -> None:
    """A robot in tb3_dqn_stage4 took the wall to go on behind a partition, whose other face it never looked at."""
    edges, pieces = np.zeros(room, EDGE), np.zeros(2, PIECE)
    pieces["gap"] = gap_m
    edges["kind"][:2], edges["link"], edges["label"] = WALL, -1, FRONTIER
    edges["hits"], edges["ux"][:2], edges["uy"][:2], edges["x"][:2] = 100.0, (1.0, 0.0), (0.0, 1.0), (0.0, 6.0)
    long, partition, side = (0, 1, 0) if head else (1, 0, 1)  # which wall comes first, and the end of the partition
    if not head:
        edges[:2] = edges[1::-1].copy()
        edges["uy"][0] = -1.0
    set_tip(edges[long], 1, 10.0)
    set_tip(edges[partition], 1 - side, length_m if head else -length_m)
    set_tip(edges[partition], side, before_m if head else -before_m)
    edges["label"][partition, side], edges["strength"][partition, side] = OCCLUSION, views
    count, new = cut_behind_partition(edges, 2, 0, 1, pieces[0], pieces[1])
    if not cut:
        assert (count, new) == (2, -1) and (edges["link"][:2] == -1).all() and tip_at(edges[long], 1) == 10.0
        return
    assert (count, new) == (3, 2) and edges[new]["twin"] == long + 1
    corner_of = (long, partition) if head else (partition, new)
    assert edges["link"][corner_of[0], 1] == corner_of[1] and edges["link"][corner_of[1], 0] == corner_of[0]
    assert tip_at(edges[long], 0) == 0.0 and tip_at(edges[long], 1) == pytest.approx(6.0)
    assert tip_at(edges[new], 0) == pytest.approx(6.0) and tip_at(edges[new], 1) == pytest.approx(10.0)
    beyond, end = (new, 0) if head else (long, 1)
    assert edges["label"][beyond, end] == FRONTIER and edges["link"][beyond, end] == -1
    assert edges["hits"][long] + edges["hits"][new] == pytest.approx(100.0)


@pytest.mark.parametrize("own", [True, False])
def test_a_partition_that_a_peer_has_told_cuts_no_wall(own: bool) -> None:
    edges, pieces, walls = np.zeros(3, EDGE), np.zeros(3, PIECE), np.array((0, 1, 0))
    edges["kind"][:2], edges["link"], edges["label"], edges["own"] = WALL, -1, FRONTIER, 1
    edges["ux"][:2], edges["uy"][:2], edges["x"][:2] = (1, 0), (0, 1), (0, 6)
    edges["hits"], edges["xx"][0], edges["yy"][1] = 100.0, 10.0, 10.0
    set_tip(edges[0], 1, 10.0)
    set_tip(edges[1], 0, 0.02)
    set_tip(edges[1], 1, 2.0)
    edges["label"][1, 0], edges["strength"][1, 0] = OCCLUSION, 5.0
    pieces["hits"], pieces["spread"], pieces["end"] = 20.0, 2.0, (-0.5, 0.5)
    pieces["x"], pieces["y"], pieces["ux"], pieces["uy"] = (5.5, 6.0, 8.0), (0.0, 0.5, 0.0), (1, 0, 1), (0, 1, 0)
    pieces["label"], pieces["link"] = FRONTIER, -1
    pieces["label"][0, 1], pieces["label"][1, 0], pieces["link"][0, 1], pieces["link"][1, 0] = NOMINAL, NOMINAL, 1, 0
    gates = Gates(0.01, OFFSET_GATE_M)
    count = merge_scan(edges, 2, pieces, walls, np.full(3, -1.0), gates, 1.0, own)
    assert count == (3 if own else 2) and edges["link"][0, 1] == (1 if own else -1)
    assert walls.tolist() == [0, 1, 2 if own else 0]  # the last one lies beyond


def corner(turn: float) -> np.ndarray:
    """A wall of 0.5 m down to the origin, and one from there that turns left by 90 degrees (turn 1), or right (-1)."""
    edges = np.zeros(2, EDGE)
    edges["kind"], edges["own"], edges["link"] = WALL, 1, -1
    edges["ux"], edges["uy"], edges["y"] = (0.0, turn), (-1.0, 0.0), (0.25, 0.0)
    set_tip(edges[0], 0, -0.25)
    set_tip(edges[1], 1, 1.0)
    join(edges, 0, 1, 5.0)
    return edges


@pytest.mark.parametrize(("turn", "linked"), [(1.0, -1), (-1.0, 1)])
def test_a_corner_is_not_closed_again_where_views_passed_behind_the_end_of_a_wall(turn: float, linked: int) -> None:
    """Before a slot of 6 cm the ends lay near to each other, and became a corner again in the scan that opened it."""
    edges = corner(turn)
    for _ in range(6):
        see_end(edges, 0, 1, OCCLUSION, 0.175, 0.03, 0.0, 1.0)
        close_open_corners(edges, 2)
    assert edges["link"][0, 1] == linked
    assert edges["tip"][0, 1, 1] == pytest.approx(0.075 if linked < 0 else 0.0)
    see_bare(edges[0], 1, 0.01, 0.02, 1.0)  # from another place the wall goes on to the corner
    close_open_corners(edges, 2)
    assert edges["link"][0, 1] == 1


@pytest.mark.parametrize(("relative_m2", "slot_m", "linked"), [(1e-6, 0.3, 1), (1e-6, 0.06, -1), (0.0, 0.3, -1)])
def test_where_the_pose_errs_a_slot_counts_only_before_the_corner_that_it_was_seen_at(
    relative_m2: float, slot_m: float, linked: int
) -> None:
    """A wall that was mapped 0.5 m too long never shared its true corner: what it had lost was taken for a slot."""
    edges = corner(1.0)
    edges["relative"][:, 0], edges["link"], edges["label"] = relative_m2, -1, OCCLUSION
    set_tip(edges[0], 1, 0.21)  # 4 cm before the corner
    show_slot(edges[0], 1, slot_m, 0.0)
    edges["slack"][0, 1] = 0.04
    close_open_corners(edges, 2)
    assert edges["link"][0, 1] == linked


@pytest.mark.parametrize(("turn_deg", "linked"), [(90.0, -1), (50.0, -1), (23.0, 1), (-90.0, 1)])
def test_slots_are_beside_corners_that_stand_back_and_are_not_blunt(turn_deg: float, linked: int) -> None:
    """What spoke for a slot before another wall held two apart that share a corner: they crossed, and stayed open."""
    edges, turn = np.zeros(2, EDGE), math.radians(turn_deg)
    edges["kind"], edges["own"], edges["link"], edges["label"] = WALL, 1, -1, OCCLUSION
    edges["ux"], edges["uy"] = (1.0, math.cos(turn)), (0.0, math.sin(turn))
    set_tip(edges[0], 0, -1.0)
    set_tip(edges[0], 1, 0.02)
    set_tip(edges[1], 1, 1.0)
    show_slot(edges[0], 1, 0.08, 0.03)
    close_open_corners(edges, 2)
    assert edges["link"][0, 1] == linked


def test_views_make_an_end_surer_that_the_joint_estimate_holds_and_do_not_move_it() -> None:
    """A robot that is 4 cm off along a column took the column's ends along, and was as far off for good."""
    edges = np.zeros(1, EDGE)
    edges["kind"], edges["ux"], edges["link"], edges["label"], edges["slack"] = WALL, 1.0, -1, OCCLUSION, 0.04
    edges["held"] = 1
    set_tip(edges[0], 1, 0.4)
    see_end(edges, 0, 1, OCCLUSION, 0.42, 0.04, 0.0, 1.0)
    see_end(edges, 0, 1, FRONTIER, 0.43, 0.0, 0.0, 1.0)
    assert tip_at(edges[0], 1) == pytest.approx(0.41) and edges["slack"][0, 1] == pytest.approx(0.02)


@pytest.mark.parametrize(("hits", "label", "ends"), [(3.0, OCCLUSION, [-0.2, 0.2]), (0.3, FRONTIER, [-0.6, 0.5])])
def test_a_wall_has_no_end_where_few_noisy_beams_show_one(hits: float, label: int, ends: list[float]) -> None:
    """In the middle of a long wall every third such end is none. So the wall goes as far as any view has shown it."""
    edges, pieces = np.zeros(1, EDGE), np.zeros(1, PIECE)
    pieces["hits"], pieces["end"], pieces["label"], pieces["slack"] = hits, (-0.2, 0.2), OCCLUSION, 0.05
    edges["ux"] = 1.0
    set_tip(edges[0], 0, -0.6)
    set_tip(edges[0], 1, 0.5)
    become_wall(edges[0], pieces[0], own=True)
    assert edges["label"][0].tolist() == [label, label]
    assert [tip_at(edges[0], side) for side in (0, 1)] == pytest.approx(ends)


@pytest.mark.parametrize(
    ("length_m", "turn_deg", "seen", "is_wall"),
    [(1.0, 0.0, 12.0, True), (0.25, 0.0, 12.0, False), (1.0, 20.0, 12.0, False), (1.0, 0.0, 4.0, False)],
)
def test_a_long_wall_along_the_axis_is_one_though_few_noisy_beams_showed_it(
    length_m: float, turn_deg: float, seen: float, is_wall: bool
) -> None:
    """A metre that is seen past a corner from 2.3 m away is worth a quarter of a near beam a scan."""
    edges, hits, turn = np.zeros(1, EDGE), 4.0, math.radians(turn_deg)
    edges["ux"], edges["uy"], edges["hits"] = math.cos(turn), math.sin(turn), hits
    edges["xx"], edges["yy"] = hits * length_m**2 / 12 * np.array((math.cos(turn), math.sin(turn)))[:, None] ** 2
    edges["xy"] = hits * length_m**2 / 12 * math.cos(turn) * math.sin(turn)
    edges["seen"], edges["due"] = seen, seen
    for side, end in enumerate((-0.5, 0.5)):
        set_tip(edges[0], side, end * length_m)
    assert (wall_probability(edges[0], 0.0, 1.0, 0.01) == 1.0) is is_wall


@pytest.mark.parametrize(
    ("far", "hits", "linked"), [(0, 0.5, True), (1, 0.5, True), (0, 3.0, True), (None, 0.5, False)]
)
def test_either_piece_tells_of_a_corner(far: int | None, hits: float, linked: bool) -> None:
    """Where only the head's piece did, a corner 3 m away stayed open for all of 50 views in which it was a tail's.

    far: the piece whose beams are worth `hits`, None: both are.
    """
    edges, pieces = np.zeros(2, EDGE), np.zeros(2, PIECE)
    edges["kind"], edges["link"], edges["label"], edges["own"] = WALL, -1, FRONTIER, 1
    edges["hits"], edges["xx"], edges["yy"] = 50.0, (8.0, 0.0), (0.0, 8.0)
    edges["ux"], edges["uy"], edges["x"], edges["y"] = (1.0, 0.0), (0.0, 1.0), (0.5, 1.15), (0.0, 0.6)
    for k, (tail, head) in enumerate([(-0.5, 0.5), (-0.5, 0.5)]):  # both end 0.15 m and 0.1 m before the corner
        set_tip(edges[k], 0, tail)
        set_tip(edges[k], 1, head)
    pieces["hits"], pieces["ux"], pieces["uy"] = 2.0, (1.0, 0.0), (0.0, 1.0)
    pieces["hits"][slice(far, None if far is None else far + 1)] = hits
    pieces["x"], pieces["y"], pieces["spread"] = (0.65, 1.15), (0.0, 0.5), 0.2
    pieces["end"], pieces["link"] = (-0.5, 0.5), [(-1, 1), (0, -1)]
    pieces["label"] = [(FRONTIER, NOMINAL), (NOMINAL, FRONTIER)]
    walls = np.array([0, 1])
    merge_scan(edges, 2, pieces, walls, np.full(2, 0.5), Gates(0.01, OFFSET_GATE_M), 1.0, True)
    assert bool(edges["link"][0, 1] == 1) is linked


@pytest.mark.parametrize(("head_m", "gives_way"), [(-0.02, False), (0.02, False), (0.3, True)])
def test_a_piece_speaks_against_a_corner_only_where_it_passes_it(head_m: float, gives_way: bool) -> None:
    """Walls on both sides of a partition became one, as one reached 8 cm over the other's corner."""
    edges, piece = np.zeros(2, EDGE), np.zeros(1, PIECE)
    edges["kind"], edges["link"], edges["label"], edges["ux"] = WALL, -1, FRONTIER, 1.0
    for k, (tail, head) in enumerate([(-2.0, 0.0), (-0.08, 2.0)]):
        set_tip(edges[k], 0, tail)
        set_tip(edges[k], 1, head)
    edges["label"][0, 1], edges["strength"][0, 1] = NOMINAL, 5.0
    piece["ux"], piece["end"] = 1.0, (-1.5, head_m)
    found = [inner_ends_give_way(edges, 0, 1, piece[0], 1.0) for _ in range(9)]
    assert any(found) is gives_way


@pytest.mark.parametrize(("beyond_m", "one"), [(-0.1, True), (0.14, True), (0.3, False)])
@pytest.mark.parametrize("first", [0, 1])
def test_an_open_end_just_beyond_a_corner_is_that_corner(beyond_m: float, one: bool, first: int) -> None:
    """A wall of `hall` stood twice over 6 m, as one of the two ended 0.14 m beyond the corner of the other."""
    edges, piece, gates = np.zeros(4, EDGE), np.zeros(1, PIECE), Gates(0.01, OFFSET_GATE_M)
    edges["kind"], edges["link"], edges["label"], edges["own"] = WALL, -1, FRONTIER, 1
    edges["hits"], edges["xx"], edges["yy"] = 50.0, (50.0, 50.0, 0.0, 0.0), (0.0, 0.0, 50.0, 50.0)
    edges["ux"], edges["uy"], edges["x"], edges["y"] = (1, 1, 0, 0), (0, 0, 1, -1), (9, 6, 12, 0), (0, 0, 1, 1)
    for k, (tail, head) in enumerate([(-3.0, 3.0), (-6.0, 6.0 + beyond_m), (-1.0, 1.0), (-1.0, 1.0)]):
        set_tip(edges[k], 0, tail)
        set_tip(edges[k], 1, head)
    join(edges, 0, 2, 9.0)  # the wall from x = 6 on ends by a corner, and the one from x = 0 on begins by one
    join(edges, 3, 1, 9.0)
    piece["x"], piece["ux"], piece["end"], piece["hits"], piece["spread"] = 9.5, 1.0, (-1.5, 1.5), 9.0, 7.0
    piece["link"], piece["label"] = -1, FRONTIER
    for _ in range(9):
        merge_scan(edges, 4, piece, np.array([first]), np.full(1, 0.5), gates, 1.0, True)
    walls = np.flatnonzero((edges["kind"] == WALL) & (edges["uy"] == 0.0))
    assert len(walls) == (1 if one else 2)
    if one:
        assert edges["label"][walls[0]].tolist() == [NOMINAL, NOMINAL]
        assert edges["tip"][walls[0]].ravel() == pytest.approx([0.0, 0.0, 12.0, 0.0])
        assert edges["link"][walls[0]].tolist() == [3, 2] and edges["link"][2:, 0].tolist() == [walls[0], -1]
    assert not edges["conflict"][1, 0]  # nothing speaks against a corner that stays


def test_two_walls_that_share_a_corner_become_one_that_ends_elsewhere() -> None:
    """The legs of a walker: the wall of both ended at itself, which stopped the robot."""
    edges, piece, gates = np.zeros(2, EDGE), np.zeros(1, PIECE), Gates(0.01, OFFSET_GATE_M)
    edges["kind"], edges["link"], edges["label"], edges["own"] = WALL, -1, OCCLUSION, 1
    edges["hits"], edges["xx"], edges["ux"], edges["x"] = 20.0, 0.1, 1.0, 0.06
    for k, (tail, head) in enumerate([(-0.06, 0.06), (-0.05, 0.05)]):
        set_tip(edges[k], 0, tail)
        set_tip(edges[k], 1, head)
    edges["link"], edges["label"] = [(-1, 1), (0, -1)], [(OCCLUSION, NOMINAL), (NOMINAL, OCCLUSION)]
    piece["x"], piece["ux"], piece["end"], piece["hits"], piece["spread"] = 0.06, 1.0, (-0.06, 0.06), 9.0, 0.01
    piece["link"], piece["label"] = -1, FRONTIER
    for _ in range(20):
        merge_scan(edges, 2, piece, np.array([0]), np.full(1, 0.5), gates, 1.0, True)
        assert all(k not in edges["link"][k] for k in np.flatnonzero(edges["kind"] == WALL))
