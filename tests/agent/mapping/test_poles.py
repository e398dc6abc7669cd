"""What stands free and is too narrow for its walls to be seen is a square in the map, while it stands there."""

import numpy as np
import pytest

from agent.alignment.feature import corners
from agent.cooperation.evidence import WallEvidence
from agent.geometry.poles import find_poles, with_poles
from agent.mapping.layers import layer_of
from agent.mapping.poles import settle_poles
from agent.mapping.submaps.settled import Settled
from agent.mapping.views import view_of
from agent.perception.perceive import perceive
from protocol.grid_map import main_axis, quantise
from protocol.map_codec import decode_map, encode_map
from protocol.wireframe import Wireframe
from tests.agent.mapping.test_particle_filter import Walk, ring, round_tour
from tests.ideal import ideal_lidar

OUTSIDE = ring((0, 0), (5, 0), (5, 4), (0, 4))
TOUR = round_tour((0.7, 0.7), (4.3, 0.7), (4.3, 3.3), (0.7, 3.3), step=0.1)


def post(x: float, y: float, width: float) -> list[tuple[float, float, float, float]]:
    """Outline of a square post with its middle at (x, y)."""
    h = width / 2
    return ring((x - h, y - h), (x - h, y + h), (x + h, y + h), (x + h, y - h))


def walked(walls: list[tuple[float, float, float, float]], seed: int = 0, **lidar: float) -> Walk:
    walk = Walk(walls, ideal_lidar(**lidar), seed=seed)
    for pose in TOUR:
        walk.see(pose)
    return walk


@pytest.fixture(scope="module")
def mine() -> Walk:
    """A robot that knows one pole; no test changes it."""
    return walked(OUTSIDE + post(2.2, 1.8, 0.04))


def poles_of(walk: Walk) -> np.ndarray:
    return find_poles(walk.filter.wireframe())[0]


@pytest.mark.parametrize("width", [0.03, 0.06])
def test_a_narrow_post_is_a_square_of_its_width_in_its_place(width: float) -> None:
    walk = walked(OUTSIDE + post(2.2, 1.8, width) + post(3.1, 2.3, width))
    found = walk.filter.wireframe()
    found.check()
    assert len(found.edges) == 4 + 8
    poles = sorted(poles_of(walk).tolist())
    assert np.allclose(poles, [(2.2, 1.8, width), (3.1, 2.3, width)], atol=0.008)


def test_free_space_lies_on_the_left_of_its_walls(mine: Walk) -> None:
    found = mine.filter.wireframe()
    walls = found.segments()[find_poles(found)[1] >= 0]
    middle, way = (walls[:, :2] + walls[:, 2:]) / 2, walls[:, 2:] - walls[:, :2]
    left = middle + 0.1 * np.stack((-way[:, 1], way[:, 0]), 1) / 0.04
    assert (np.hypot(*(left - (2.2, 1.8)).T) > 0.05).all()


def test_a_post_of_which_beams_see_the_faces_is_no_pole() -> None:
    walk = walked(OUTSIDE + post(2.2, 1.8, 0.1))
    for pose in round_tour((1.5, 1.2), (2.9, 1.2), (2.9, 2.4), (1.5, 2.4), step=0.1):
        walk.see(pose)
    assert len(poles_of(walk)) == 0 and not walk.filter.poles["known"].any()


def test_a_post_that_is_taken_away_leaves_the_map() -> None:
    walk = walked(OUTSIDE + post(2.2, 1.8, 0.04))
    walk.lidar = Walk(OUTSIDE, ideal_lidar()).lidar
    for pose in TOUR:
        walk.see(pose)
    assert len(poles_of(walk)) == 0


def test_what_peeps_out_behind_an_edge_is_no_pole() -> None:
    """From here a door jamb hides all but 5 cm of a cabinet."""
    jamb = ring((1.9, 0.0), (1.9, 1.5), (2.0, 1.5), (2.0, 0.0))
    cabinet = ring((2.6, 1.0), (2.6, 1.785), (3.2, 1.785), (3.2, 1.0))
    walk = Walk(OUTSIDE + jamb + cabinet, ideal_lidar())
    for _ in range(60):
        walk.see((1.0, 1.2, 0.0))
    assert walk.filter.poles["seen"].max() > 20.0 and len(poles_of(walk)) == 0


def test_peers_are_told_of_poles_and_have_them_once(mine: Walk) -> None:
    theirs = walked(OUTSIDE + post(2.2, 1.8, 0.04) + post(3.1, 2.3, 0.04), seed=3).filter.wireframe()
    told = decode_map(encode_map(quantise(theirs, 10, main_axis(theirs))).data).wireframe()
    assert np.allclose(sorted(find_poles(told)[0].tolist()), sorted(find_poles(theirs)[0].tolist()), atol=0.01)
    layer = layer_of(told, np.zeros(3), np.zeros(len(told.edges), np.bool_), 3.0)
    merged = mine.filter.wireframe_with([layer], 0.06)
    poles, pole_of = find_poles(merged)
    assert np.allclose(sorted(poles[:, 0]), [2.2, 3.1], atol=0.02)
    heard = np.unique(pole_of[(pole_of >= 0) & ~merged.own])
    assert np.allclose(poles[heard, 0], 3.1, atol=0.02)
    assert len(find_poles(mine.filter.told_with([layer], 0.06)(0))[0]) == 1  # the peer has told the other one itself


def test_a_pole_of_which_one_wall_is_seen_through_is_not_laid() -> None:
    theirs = with_poles(Wireframe(), np.array([(1.0, 2.0, 0.04)]), np.ones(1), np.ones(1, np.bool_), 0.0)
    assert len(layer_of(theirs, np.zeros(3), np.array([True, False, False, False]), 3.0).poles) == 0


def test_a_scan_sees_through_no_pole_that_may_stand_between_its_beams() -> None:
    far, near = (0.5, 2.0, 0.0), (2.7, 2.0, 0.0)
    pole = with_poles(Wireframe(), np.array([(3.5, 2.0, 0.04)]), np.ones(1), np.ones(1, np.bool_), 0.0)
    walk = Walk(OUTSIDE, ideal_lidar())
    for pose, walls in ((far, 0), (near, 2)):  # its front and its back
        evidence = WallEvidence()
        evidence.lay(pole, np.zeros(3), Wireframe())
        scan = perceive(walk.lidar.cast(np.array([pose]))[0], walk.spec)
        evidence.look(np.zeros(3), view_of(scan, pose, 0.035))
        assert evidence.through.sum() == walls


def test_poles_have_no_part_in_alignment(mine: Walk) -> None:
    assert len(corners(mine.filter.wireframe()).points) == 4


def test_a_mind_that_was_kept_has_its_poles(mine: Walk) -> None:
    again = Walk(OUTSIDE, ideal_lidar()).filter
    again.restore(mine.filter.state())
    assert np.array_equal(again.wireframe().points, mine.filter.wireframe().points)


def test_a_pole_moves_with_the_part_of_a_torn_map_in_which_it_was_seen() -> None:
    """It vanished, and nobody looked again. Its place is then told by what is seen next."""
    walk = walked(OUTSIDE + post(2.2, 1.8, 0.04))
    begins, by = np.array((0, 10, len(TOUR))), np.array(((0.0, 0.0, 0.0), (1.0, 2.0, 0.0), (9.0, 9.0, 0.0)))
    moved = walk.filter.poles.copy()
    settle_poles(moved, Settled(np.zeros(0), (0.0, 0.0, 0.0), begins, by).places)
    (pole,) = moved[moved["score"] > 0.0]
    assert (pole["x"], pole["y"], pole["width"]) == pytest.approx((3.2, 3.8, 0.04), abs=0.008) and pole["known"] == 1.0
    settle_poles(walk.filter.poles, Settled(np.zeros(0), (0.0, 0.0, 0.0), begins, 0.0 * by).places)
    for pose in TOUR:
        walk.see(pose)
        (seen,) = poles_of(walk)
        assert seen == pytest.approx((2.2, 1.8, 0.04), abs=0.04)
    assert seen == pytest.approx((2.2, 1.8, 0.04), abs=0.008)
