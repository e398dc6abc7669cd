"""The frame of a peer from where it says it is and the discs seen then."""

import math

import numpy as np
import pytest

from agent.alignment.by_sight import Consensus, Sighting, apart_places, consensus, squared
from agent.cooperation.peer import Merged
from agent.corner_scan import CornerScan
from agent.geometry.transform import compose, inverse
from deploy.bench.errors import distance, errors
from deploy.bench.explored import explore
from protocol.geometry import apply
from tests.agent.mapping.test_layers import scan_at
from tests.agent.mapping.test_particle_filter import ROOM

TRUTH = np.array([3.0, -2.0, 2.2])
HERE = (0.7, 0.7, 0.0)
SCAN = scan_at(HERE, ROOM)


def seen(places: np.ndarray, discs: list[np.ndarray], scan: CornerScan = SCAN) -> list[Sighting]:
    """Sightings of a peer at places (n, 2) of its own frame."""
    return [Sighting(HERE, (x, y, 0.0), there, scan) for (x, y), there in zip(places.tolist(), discs, strict=True)]


def found_of(sightings: list[Sighting]) -> Consensus | None:
    return consensus(sightings, 0.2, 0.6)


def test_the_frame_is_found_among_posts_and_other_robots() -> None:
    rng = np.random.default_rng(1)
    places = rng.uniform(-2.0, 2.0, (12, 2))
    posts = np.array([[1.0, 1.0], [-0.5, 2.0]])
    discs = []
    for k, place in enumerate(apply(TRUTH, places)):
        there = [posts + rng.normal(0.0, 0.02, posts.shape), rng.uniform(-3.0, 3.0, (1, 2))]
        if k % 3:  # every third time it is out of sight
            there.append(place[None] + rng.normal(0.0, 0.03, (1, 2)))
        discs.append(np.vstack(there))
    found = found_of(seen(places, discs))
    assert found is not None and found.explained >= 8 and found.explained - found.rival >= 2
    metres, turn = distance(found.transform, TRUTH, np.zeros(2))
    assert metres < 0.08 and math.degrees(turn) < 3.0


def test_what_stands_still_while_the_peer_drives_gives_no_frame() -> None:
    places = np.column_stack([np.linspace(0.0, 4.0, 12), np.zeros(12)])
    found = found_of(seen(places, [np.array([[1.0, 1.0]])] * 12))
    assert found is None


def test_a_peer_that_stands_still_is_one_sighting_however_often_it_is_seen() -> None:
    places = np.array([[0.0, 0.0], [0.1, 0.0], [1.0, 0.0], [0.05, 0.05], [1.1, 0.1], [2.0, 2.0]])
    kept = apart_places(seen(places, [np.zeros((1, 2))] * 5 + [np.zeros((0, 2))]), 0.3)
    assert [one.theirs[:2] for one in kept] == [(0.0, 0.0), (1.0, 0.0)]


def test_walls_at_right_angles_put_the_turn_right_and_leave_the_middle_where_it_is() -> None:
    walls = np.array([[0.0, 0.0, 4.0, 0.0], [4.0, 0.0, 4.0, 3.0], [4.0, 3.0, 0.0, 3.0], [0.0, 3.0, 0.0, 0.0]])
    back = inverse(TRUTH)
    theirs = np.hstack([apply(back, walls[:, :2]), apply(back, walls[:, 2:])])
    about = np.array([0.5, -0.3])
    off = np.array([0.0, 0.0, math.radians(7.0)])
    turned = compose(compose(np.array([*about, 0.0]), off), np.array([*-about, 0.0]))
    better = squared(compose(TRUTH, turned), about, walls, theirs)
    assert distance(better, TRUTH, about)[1] < 1e-9
    assert np.allclose(apply(better, about[None]), apply(TRUTH, about[None]))


@pytest.mark.system
def test_twins_of_rooms_are_no_obstacle_to_robots_that_see_each_other() -> None:
    """All rooms of this building are alike, and its maps stay ambiguous; seed 1 was never merged by maps alone."""
    events: list[tuple[str, dict[str, object]]] = []
    settings = {"world": "symmetric", "robots": 3, "seed": 1, "starts": "random", "max_time_s": 60.0}
    run = explore(
        settings,
        {},
        lambda robot, _, step: events.extend(
            (robot.robot, e.data) for e in step.action.events if e.event == "accepted"
        ),
    )
    assert events
    frames = {name: np.array(run.frame(name)) for name in run.robots}
    for robot, data in events:
        peer = str(data["peer"])
        centre = run.robots[peer].own.points.mean(0)
        metres, degrees = errors(data["transform"], frames[robot], frames[peer], centre)  # type: ignore[arg-type]
        assert metres < 0.1 and degrees < 2.0
        assert isinstance(run.robots[robot].team.peers[peer], Merged)


def test_two_robots_that_drive_straight_fit_each_other_but_on_a_line() -> None:
    """The peer is heard, another teammate is seen: both drive at full speed, so one transform explains all."""
    way = np.column_stack([np.arange(0.0, 4.0, 0.4), np.zeros(10)])
    found = found_of(seen(way, [np.array([[1.0, 1.0 + x]]) for x, _ in way.tolist()]))
    assert found is not None and found.explained == 10 and found.spread_m < 0.01
