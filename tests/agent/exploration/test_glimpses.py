"""What was seen of a thing from afar adds up, whichever lines its hits lay on."""

import numpy as np
import pytest

from agent.exploration.agenda import Task
from agent.exploration.glimpses import BREAK_S, LEAST_SCANS, MOST, Glimpses
from agent.exploration.goal_memory import REMEMBERED
from agent.exploration.planning import Roads
from agent.mapping.views import MARGIN_M, sees_places, view_of
from protocol.messages import LidarSpec
from protocol.wireframe import Wireframe
from tests.agent.mapping.test_layers import scan_at
from tests.agent.mapping.test_particle_filter import ROOM, ring

POST = np.array((3.0, 1.0))
BREAK = round(BREAK_S * LidarSpec().rate_hz)


def found(glimpses):
    return [task.place for task in glimpses.tasks(Wireframe(), Roads(Wireframe(), np.zeros(2), 0.2))]


def test_scans_that_hit_a_post_on_different_lines_count_together():
    glimpses = Glimpses(LidarSpec())
    for scan in range(LEAST_SCANS):
        assert not found(glimpses)
        glimpses.keep(2 * scan, POST + 0.1 * (scan % 3) * np.ones((1, 2)))  # every second scan, around the post
    assert np.allclose(found(glimpses), POST)


def test_two_lines_in_one_scan_are_one_sighting():
    glimpses = Glimpses(LidarSpec())
    for scan in range(LEAST_SCANS - 1):
        glimpses.keep(scan, np.array((POST, POST + 0.1)))
    assert not found(glimpses)


def test_a_scan_that_is_told_until_the_next_one_is_mapped_counts_once():
    glimpses = Glimpses(LidarSpec(rate_hz=20.0))
    for tick in range(4 * LEAST_SCANS):
        if tick % 4 == 0:
            assert not found(glimpses)
            places = POST[None].copy()
        glimpses.keep(tick, places)
    assert np.allclose(found(glimpses), POST)


@pytest.mark.parametrize(("ticks", "is_one_thing"), [(BREAK, True), (BREAK + 1, False)])
def test_what_shows_now_and_then_is_not_one_thing(ticks, is_one_thing):
    glimpses = Glimpses(LidarSpec())
    for scan in range(LEAST_SCANS):
        glimpses.keep(ticks * scan, POST[None])
    assert len(found(glimpses)) == is_one_thing


def sight_from(here, walls):
    """What a scan from there sees past."""
    scan = scan_at(here, walls)
    return lambda places, aside_m: sees_places(places, aside_m, view_of(scan, here, MARGIN_M))


THING = ring((2.85, 0.85), (2.85, 1.15), (3.15, 1.15), (3.15, 0.85))
NOW = {
    "it has gone": (sight_from((1.0, 1.0, 0.0), ROOM), False),
    "it stands there": (sight_from((1.0, 1.0, 0.0), ROOM + THING), True),
    "it is hidden": (sight_from((1.0, 2.4, 0.0), ROOM), True),
}


@pytest.mark.parametrize(("sees_past", "is_there"), NOW.values(), ids=NOW)
def test_a_place_that_scans_see_past_is_nothing_to_look_at(sees_past, is_there):
    """Ten people in `hall` left so many that a robot remembered none of the columns, and went to where nobody was."""
    glimpses = Glimpses(LidarSpec())
    for tick in range(2 * LEAST_SCANS):
        glimpses.keep(tick, POST[None].copy())
    for tick in range(2 * LEAST_SCANS, 4 * LEAST_SCANS):
        glimpses.keep(tick, np.zeros((0, 2)), sees_past)
    assert len(found(glimpses)) == is_there


@pytest.mark.parametrize("goes_on_the_way", [False, True])
def test_what_was_looked_at_is_looked_at_once(goes_on_the_way):
    """What people leave is seen past from nearby: it was forgotten before it was looked at, and hit again from afar."""
    glimpses, sees_past, looks = Glimpses(LidarSpec()), NOW["it has gone"][0], 0
    for first in range(0, 1000, 100):
        for tick in range(first, first + 2 * LEAST_SCANS):
            glimpses.keep(tick, POST[None].copy())
        tasks = glimpses.tasks(Wireframe(), Roads(Wireframe(), np.zeros(2), 0.2))
        looks += len(tasks)
        for done_first in (True, False):
            for task in tasks if done_first != goes_on_the_way else ():
                glimpses.done(task)
            for tick in range(first + 2 * LEAST_SCANS, first + 90) if done_first else ():
                glimpses.keep(tick, np.zeros((0, 2)), sees_past)
    assert looks == 1


def test_what_was_looked_at_takes_no_room_until_there_is_too_much_of_it():
    """After 50 places a robot looked at no post any more."""
    glimpses, shown = Glimpses(LidarSpec()), {}
    for thing in range(REMEMBERED + 1):
        place = np.array((float(thing), 1.0))
        for scan in range(LEAST_SCANS):
            glimpses.keep(thing * LEAST_SCANS + scan, place[None].copy())
        if thing in (MOST, REMEMBERED - 1, REMEMBERED):
            shown[thing] = len(found(glimpses))
        glimpses.done(Task("glimpse", place, place))
    assert shown == {MOST: 1, REMEMBERED - 1: 1, REMEMBERED: 0}


def test_the_places_are_bounded_and_room_comes_back():
    glimpses = Glimpses(LidarSpec())
    for k in range(2 * MOST):
        glimpses.keep(0, np.array([(float(k), 0.0)]))
    full = glimpses.nbytes
    glimpses.keep(BREAK + 1, POST[None])
    assert glimpses.nbytes * MOST == full
