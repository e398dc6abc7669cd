"""What is round like a teammate and stands still while nobody is heard is a post; a teammate never is one."""

import numpy as np
import pytest

from agent.perception.config import PerceptionConfig
from agent.perception.disc_memory import Posts, SeenDiscs
from agent.perception.perceive import Foreseen, Perception, perceive
from protocol.messages import Observation
from protocol.wireframe import Wireframe
from tests.ideal import ideal_lidar, ideal_spec

NOBODY = np.zeros((0, 2))
STANDING = np.array([[2.0, 0.5]])
HERE = (0.0, 0.0, 0.0)
ELSEWHERE = np.array([[-3.0, 0.0, 0.5]])  # a teammate whose place is known, and by how much that may be off


def posts() -> Posts:
    return Posts(ideal_spec())


@pytest.mark.parametrize("rate_hz", [5, 20])
def test_a_disc_that_stands_is_a_post_where_nobody_was_ever_heard(rate_hz: int) -> None:
    one, ticks = Posts(ideal_spec(lidar=ideal_lidar(rate_hz=rate_hz))), 3 * rate_hz
    for tick in range(ticks):
        one.add(tick, STANDING + 0.01 * (tick % 3), ELSEWHERE)
    assert not len(one.places)
    one.add(ticks, STANDING, ELSEWHERE)
    assert np.allclose(one.places, STANDING, atol=0.03)
    assert np.allclose(one.seen_from((2.0, 0.0, np.pi / 2)), [[0.5, 0.0]], atol=0.03)


def test_a_disc_that_moves_is_none_and_neither_is_one_while_somebody_is_heard() -> None:
    one = posts()
    for tick in range(200):
        one.add(tick, STANDING + np.array((0.0, 0.02 * tick)), ELSEWHERE)
    assert not len(one.places)
    for tick in range(200, 600):
        if tick % 100 == 0:  # of four beacons three are lost
            one.hear(tick, HERE, stranger=True)
        one.add(tick, STANDING, ELSEWHERE)
    assert not len(one.places)


def test_who_is_heard_may_be_what_was_taken_for_a_post_here_but_not_elsewhere() -> None:
    one = posts()
    for tick in range(30):
        one.add(tick, STANDING, ELSEWHERE)
    one.hear(30, (9.0, 0.0, 0.0), stranger=True)
    assert len(one.places) == 1
    one.hear(31, HERE, stranger=True)
    assert not len(one.places)


def test_a_disc_that_stands_where_no_teammate_says_it_is_is_a_post_though_they_are_heard() -> None:
    one = posts()
    for tick in range(20):
        one.hear(tick, HERE, stranger=False)
        one.add(tick, STANDING, ELSEWHERE)
    assert one.company(20)
    assert np.allclose(one.places, STANDING)


def test_where_a_teammate_may_be_nothing_is_a_post_and_what_was_taken_for_one_is_forgotten() -> None:
    one, there = posts(), np.array([[2.1, 0.5, 0.2]])
    for tick in range(40):
        one.hear(tick, HERE, stranger=False)
        one.add(tick, STANDING, ELSEWHERE if tick < 20 else there)
        assert len(one.places) == (15 <= tick < 20)


def room_with_a_post() -> np.ndarray:
    """(360,) ranges, metres, in a room of 6 m x 6 m with a post as wide as a robot 0.8 m ahead."""
    bearings = np.arange(360) * np.pi / 180
    ranges = 3.0 / np.maximum(np.abs(np.cos(bearings)), np.abs(np.sin(bearings)))
    ranges[ranges > 3.5] = np.inf
    for k in range(-20, 20):
        side = 0.8 * np.sin(np.radians(k))
        if abs(side) < 0.105:
            ranges[k] = 0.8 * np.cos(np.radians(k)) - np.sqrt(0.105**2 - side**2)
    return ranges


def test_beams_on_a_post_tell_of_walls() -> None:
    plain = perceive(room_with_a_post(), ideal_spec())
    assert len(plain.discs) == 1
    told = perceive(room_with_a_post(), ideal_spec(), foreseen=Foreseen(posts=plain.discs))
    assert not len(told.discs)
    assert len(told.pieces) > len(plain.pieces)
    assert np.hypot(told.pieces["x"], told.pieces["y"]).min() < 0.8
    assert np.hypot(plain.pieces["x"], plain.pieces["y"]).min() > 2.9


def test_beams_on_a_disc_tell_of_walls_unless_somebody_was_heard_lately() -> None:
    """A beacon comes every 5 s; after 21 s without one nobody is near."""
    one, ranges = Perception(PerceptionConfig(), ideal_spec()), room_with_a_post().astype("<f4").tobytes()
    hidden = []
    for tick in range(0, 260):
        place = (0.02 * tick, 0.0, 0.0)  # what comes along with the robot stands nowhere for long, and so is no post
        seen = Observation(tick=tick, ranges=ranges, odometry=place, heard=0)
        scan = one.see(seen, np.zeros((2, 3)), place, Wireframe(), heard=20 <= tick <= 120 and tick % 25 == 0)
        hidden.append(bool(np.hypot(scan.pieces["x"], scan.pieces["y"]).min() > 0.8))
        assert len(scan.discs) == hidden[-1]
        one.remember(tick, place)
    assert hidden == [False] * 25 + [True] * 180 + [False] * 55


@pytest.mark.parametrize("rate_hz", [5.0, 20.0])
def test_a_disc_that_was_seen_for_long_is_remembered_for_four_scans_at_any_rate(rate_hz: float) -> None:
    one = SeenDiscs(ideal_spec(lidar=ideal_lidar(rate_hz=rate_hz)))
    for _ in range(9):
        one.add(HERE, STANDING)
        assert one.expected(HERE)[:, 2] == pytest.approx([0.22 / rate_hz])  # where it was before no longer counts
    for scans in range(1, 5):
        assert one.expected(HERE)[:, 2] == pytest.approx([scans * 0.22 / rate_hz])  # what a teammate drives since
        one.add(HERE, NOBODY)
    assert not len(one.expected(HERE))


def test_a_disc_that_one_scan_saw_is_expected_in_the_next_alone() -> None:
    one = SeenDiscs(ideal_spec())
    one.add(HERE, STANDING)
    assert len(one.expected(HERE)) == 1
    one.add(HERE, NOBODY)
    assert not len(one.expected(HERE))


def test_a_disc_that_drives_is_one_disc() -> None:
    one = SeenDiscs(ideal_spec())
    for tick in range(6):
        one.add(HERE, STANDING + np.array((0.0, 0.044 * tick)))
        assert len(one.expected(HERE)) == 1
