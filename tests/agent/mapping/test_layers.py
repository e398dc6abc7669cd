"""A received map over the own one: frontiers closed, own walls unmoved, no fresh evidence, undone completely."""

import math

import numpy as np
import pytest

from agent.cooperation.evidence import WALL_MARGIN_M, WallEvidence, pieces_of
from agent.cooperation.merging import HITS_PER_M, SAME_WALL_M
from agent.geometry.transform import compose, inverse
from agent.mapping.association import Gates
from agent.mapping.edges import EDGE, WALL
from agent.mapping.layers import Layer, Tellings, layer_of, merged
from agent.mapping.views import view_of
from agent.perception.perceive import perceive
from protocol.arrays import Records
from protocol.geometry import Pose, apply
from protocol.wireframe import Label, Wireframe, certain, encode_wireframe
from tests.agent.alignment.test_alignment import moved
from tests.agent.mapping.test_particle_filter import ROOM, ROOM_TOUR, Walk, farthest, ring, round_tour
from tests.ideal import ideal_lidar

FRAME = np.array([3.0, -7.0, 2.1])
"""Pose of the peer's frame in the robot's own is its inverse."""
T = inverse(FRAME)


@pytest.fixture(scope="module")
def whole() -> Wireframe:
    """The room as a peer has mapped it, in its own frame."""
    walk = Walk(ROOM, ideal_lidar(), seed=5)
    for pose in ROOM_TOUR:
        walk.see(pose)
    return moved(walk.filter.wireframe(), FRAME)


@pytest.fixture
def walk() -> Walk:
    """A robot that has seen but a corner of it."""
    walk = Walk(ROOM, ideal_lidar(range_max_m=2.0))
    for pose in ROOM_TOUR[:8]:
        walk.see(pose)
    return walk


def laid(walk: Walk, theirs: Wireframe, transform: np.ndarray = T, hidden: np.ndarray | None = None) -> Wireframe:
    none = np.zeros(len(theirs.edges), np.bool_)
    layer = layer_of(theirs, transform, none if hidden is None else hidden, 3.0)
    return walk.filter.wireframe_with([layer], 0.06)


def _with(wireframe: Wireframe, wall: np.ndarray) -> Wireframe:
    """The same with one more wall (2, 2), both its ends open."""
    n = len(wireframe.points)
    return Wireframe(
        np.vstack((wireframe.points, wall)),
        np.append(wireframe.labels, [Label.FRONTIER, Label.FRONTIER]).astype(np.uint8),
        np.vstack((wireframe.edges, (n, n + 1))).astype(np.int32),
        np.append(wireframe.likelihood, 1.0).astype(np.float32),
        np.append(wireframe.own, True),
    )


def test_what_the_other_saw_closes_all_frontiers(walk: Walk, whole: Wireframe) -> None:
    own = walk.filter.wireframe()
    assert (own.labels == Label.FRONTIER).any() and len(own.edges) < 10
    both = laid(walk, whole)
    both.check()
    assert (both.labels == Label.NOMINAL).all() and len(both.edges) == len(both.points) == 10
    assert farthest(both, ROOM) < 0.02
    assert both.own.sum() == own.own.sum() == len(own.edges)
    assert (~both.own).sum() == 10 - len(own.edges)


def test_a_transform_that_is_off_a_little_doubles_no_wall(walk: Walk, whole: Wireframe) -> None:
    off = T + np.array([0.03, -0.03, 0.005])
    assert len(laid(walk, whole, off).edges) == 10


def test_walls_that_come_back_are_no_fresh_evidence_and_the_filter_stays_what_it_was(walk: Walk) -> None:
    own, before = walk.filter.wireframe(), walk.filter.edges.tobytes()
    for _ in range(50):
        back = laid(walk, moved(own, FRAME))
    assert walk.filter.edges.tobytes() == before
    assert back.edges.tolist() == own.edges.tolist()
    assert np.array_equal(back.likelihood, own.likelihood) and back.own.all()
    assert np.abs(back.points - own.points).max() < 0.005


def test_a_merge_is_undone_by_leaving_the_layer_away(walk: Walk, whole: Wireframe) -> None:
    own = walk.filter.wireframe()
    laid(walk, whole)
    again = walk.filter.wireframe_with([], 0.06)
    assert np.array_equal(again.points, own.points) and np.array_equal(again.labels, own.labels)


@pytest.mark.parametrize("prolongs", [True, False])
def test_a_wall_that_its_owner_has_dropped_is_soon_on_nobodys_map(walk: Walk, prolongs: bool) -> None:
    own = walk.filter.wireframe()
    head = int(np.flatnonzero((own.labels == Label.FRONTIER) & np.isin(np.arange(len(own.points)), own.edges[:, 1]))[0])
    tail = int(own.edges[own.edges[:, 1] == head][0, 0])
    along = (own.points[head] - own.points[tail]) / np.hypot(*(own.points[head] - own.points[tail]))
    begin = own.points[head] if prolongs else np.array([1.0, 0.8])
    ghost = np.array([begin, begin + 1.5 * along])
    maps = [_with(own, ghost), own, own]  # what three robots in one place and frame tell each other

    def ghostly(wireframe: Wireframe) -> bool:
        pieces, _ = pieces_of(wireframe)
        return bool((np.hypot(*(pieces[:, :2] - ghost.mean(0)).T) < 0.3).any())

    def heard(robot: int, first_hand: bool) -> list[Layer]:
        others = [maps[k] for k in range(3) if k != robot]
        return [layer_of(other, np.zeros(3), ~other.own & first_hand, HITS_PER_M) for other in others]

    maps = [walk.filter.told_with(heard(robot, True), SAME_WALL_M)(None) for robot in range(3)]
    assert [ghostly(told) for told in maps] == [False, True, True]
    for _ in range(2):
        maps = [walk.filter.told_with(heard(robot, True), SAME_WALL_M)(None) for robot in range(3)]
    assert not any(map(ghostly, maps))
    assert not any(ghostly(walk.filter.wireframe_with(heard(robot, False), SAME_WALL_M)) for robot in range(3))


def test_what_each_peer_is_told_is_laid_as_if_it_alone_were_told(walk: Walk, whole: Wireframe) -> None:
    turns = [T + np.array([0.0, 0.0, 0.01 * k]) for k in range(4)]  # layers that differ, in an order that matters
    layers = [layer_of(whole, turn, np.arange(len(whole.edges)) % 4 == k, HITS_PER_M) for k, turn in enumerate(turns)]
    told = walk.filter.told_with(layers, SAME_WALL_M)
    for left in (2, 0, None, 3, 1, 2):
        rest = [layer for k, layer in enumerate(layers) if k != left]
        alone = walk.filter.told_with(rest, SAME_WALL_M)(None)
        assert encode_wireframe(told(left)) == encode_wireframe(alone)


def test_walls_of_the_other_keep_its_likelihood(walk: Walk, whole: Wireframe) -> None:
    both = laid(walk, whole)
    theirs = np.sort(whole.likelihood)[: (~both.own).sum()]
    assert both.likelihood[~both.own].min() > theirs.min() - 0.1


def _stub(length: float, tilt_deg: float, hits: float) -> Records:
    """(1,) of EDGE: a wall of own scans that begins at zero, both its ends open."""
    tilt = math.radians(tilt_deg)
    u, middle = np.array([math.cos(tilt), math.sin(tilt)]), np.array([0.5 * length, 0.0])
    stub = np.zeros(1, EDGE)
    stub["kind"], stub["own"], stub["hits"], stub["seen"], stub["link"] = WALL, 1, hits, 50.0, -1
    stub["x"], stub["y"] = middle
    stub["ux"], stub["uy"] = u
    stub["xx"], stub["xy"], stub["yy"] = hits * length**2 / 12 * np.array([u[0] ** 2, u[0] * u[1], u[1] ** 2])
    stub["tip"], stub["label"] = (middle - 0.5 * length * u, middle + 0.5 * length * u), Label.FRONTIER
    return stub


@pytest.mark.parametrize("tilt_deg", [-1.0, 0.5, 1.0])
def test_a_stub_never_turns_ten_metres_that_a_peer_saw(tilt_deg: float) -> None:
    stub = _stub(0.3, tilt_deg, hits=500.0)
    wall = certain(np.array([(0.0, 0.0), (10.0, 0.0)]), np.array([(0, 1)]))
    layer = layer_of(wall, np.zeros(3), np.zeros(1, np.bool_), HITS_PER_M)
    laid = merged(stub, [layer], Gates(0.01, SAME_WALL_M))
    assert len(laid) == 1 and np.abs(laid["tip"][0, :, 1]).max() < 0.01
    assert np.abs(laid["tip"][0, :, 0] - (0.0, 10.0)).max() < 0.01


def test_a_stub_of_centimetres_takes_no_wall_half_a_metre_beside_it() -> None:
    stub = _stub(0.036, 0.0, hits=12.0)
    wall = certain(np.array([(-3.7, 0.53), (-0.08, 0.53)]), np.array([(0, 1)]))
    layer = layer_of(wall, np.zeros(3), np.zeros(1, np.bool_), HITS_PER_M)
    laid = merged(stub, [layer], Gates(0.01, SAME_WALL_M))
    assert len(laid) == 2 and np.abs(laid["tip"][1] - wall.points).max() < 1e-6


def scan_at(pose: Pose, walls: list[tuple[float, float, float, float]]):
    walk = Walk(walls, ideal_lidar())
    ranges = walk.lidar.measured(walk.lidar.cast(np.array([pose])), [np.random.default_rng(3)])[0]
    return perceive(np.asarray(ranges, np.float64), walk.spec)


def test_ground_is_confirmed_where_the_transform_is_right_and_contradicted_where_it_is_not(
    walk: Walk, whole: Wireframe
) -> None:
    turned = compose(np.array([2.0, 2.0, math.pi / 2]), compose(np.array([-2.0, -2.0, 0.0]), T))
    for transform, good in ((T, True), (T + np.array([0.0, -0.6, 0.0]), False), (turned, False)):
        ground = WallEvidence()
        ground.lay(whole, transform, Wireframe())
        for pose in ROOM_TOUR[::10]:
            ground.look(transform, view_of(scan_at(pose, ROOM), pose, WALL_MARGIN_M))
        confirmed, against = ground.said(2)
        if good:
            assert confirmed > 12.0 and against == 0.0
        else:
            assert against > 1.0


def test_ground_that_an_alignment_used_is_not_fresh_and_what_is_known_of_it_outlives_a_newer_map(
    walk: Walk, whole: Wireframe
) -> None:
    ground = WallEvidence()
    ground.lay(whole, T, laid(walk, whole))
    pose = ROOM_TOUR[0]
    for _ in range(3):
        ground.look(T, view_of(scan_at(pose, ROOM), pose, WALL_MARGIN_M))
    assert ground.said(2) == (0.0, 0.0)
    seen = int((ground.on >= 3).sum())
    assert seen > 20
    newer = moved(whole, np.array([0.002, 0.001, 0.0]))
    ground.lay(newer, T, Wireframe())
    assert int((ground.on >= 3).sum()) == seen
    assert ground.said(2) == (0.0, 0.0)


def test_a_wall_that_own_scans_see_through_is_not_shown(walk: Walk, whole: Wireframe) -> None:
    phantom = _with(whole, apply(FRAME, np.array([(1.0, 1.0), (1.0, 0.2)])))
    ground = WallEvidence()
    ground.lay(phantom, T, Wireframe())
    pose = (2.5, 0.7, 0.0)
    for _ in range(4):
        ground.look(T, view_of(scan_at(pose, ROOM), pose, WALL_MARGIN_M))
    hidden = ground.hidden(3)
    assert hidden.tolist() == [False] * len(whole.edges) + [True]
    assert len(laid(walk, phantom).edges) == 11
    assert len(laid(walk, phantom, hidden=hidden).edges) == 10


def test_a_wall_beyond_a_doorway_is_not_bridged_from_a_corner() -> None:
    """A T meets a long wall from behind: a peer saw the wall to the T's near side, the robot begins on its far side."""
    stub, gates = _stub(0.9, 0.0, hits=500.0), Gates(0.01, SAME_WALL_M)
    near = certain(np.array([(-6.0, 0.0), (-0.15, 0.0), (-0.15, 2.0)]), np.array([(0, 1), (1, 2)]))
    layers = [layer_of(near, np.zeros(3), np.zeros(2, np.bool_), HITS_PER_M)]
    for laid in merged(stub, layers, gates), Tellings(stub, layers, gates).without(None):
        own = laid[(laid["kind"] == WALL) & (laid["own"] == 1)]
        assert np.abs(own["tip"][:, :, 0] - (0.0, 0.9)).max() < 0.01  # tail before head
        assert np.sort(laid["tip"][laid["own"] == 0, :, 0].ravel()) == pytest.approx([-6.0, -0.15, -0.15, -0.15])


def test_what_an_own_wall_was_joined_into_is_told_as_heard() -> None:
    stub, gates = _stub(0.9, 0.5, hits=500.0), Gates(0.01, SAME_WALL_M)
    walls = [np.array([(1.5, 0.0), (3.0, 0.0)]), np.array([(-1.0, 0.0), (3.5, 0.0)])]
    layers = [
        layer_of(certain(wall, np.array([(0, 1)])), np.zeros(3), np.zeros(1, np.bool_), HITS_PER_M) for wall in walls
    ]
    told = Tellings(stub, layers, gates).without(None)
    own = told[(told["kind"] == WALL) & (told["own"] == 1)]
    assert np.abs(own["tip"][:, :, 0] - (0.0, 0.9)).max() < 0.01


@pytest.mark.parametrize("thickness", [0.01, 0.04])
def test_walls_on_either_side_of_a_plate_are_two(thickness: float) -> None:
    """The peer has the wall to the left of the plate, up to its corner; the own one goes on to the right of it.

    Both lie on one line, a centimetre apart. The own wall was cut down to nothing, as if it ended at the peer's corner.
    """
    x, y = 2.5 + thickness, 2.5
    room = ring((0, 0), (2.5, 0), (2.5, y), (x, y), (x, 0), (8, 0), (8, 4), (0, 4))
    own, peer = Walk(room, ideal_lidar(range_max_m=2.0)), Walk(room, ideal_lidar(range_max_m=2.0), seed=5)
    for pose in round_tour((3.2, 0.7), (4.5, 0.7), (4.5, 1.5)):
        own.see(pose)
    for pose in round_tour((1.8, 0.7), (0.7, 0.7), (0.7, 3.3)):
        peer.see(pose)
    theirs = moved(peer.filter.wireframe(), FRAME)
    before, after = own.filter.wireframe().segments(), laid(own, theirs).segments()
    floor = [wall for wall in before if abs(wall[1]) < 0.02 and abs(wall[3]) < 0.02]
    assert len(floor) == 1 and floor[0][2] - floor[0][0] > 2.0
    assert any(np.allclose(wall, floor[0], atol=0.03) for wall in after)
