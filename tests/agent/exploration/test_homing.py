"""Home, telling walls, and laps about home, until it is known how the map lies in its frame."""

from types import SimpleNamespace

import numpy as np
import pytest

from agent.exploration import standing
from agent.exploration.agenda import Task
from agent.exploration.homing import (
    EXACT_MAP_M,
    LAPS_M,
    MOST_BARRED,
    MOST_LEFT,
    MOST_LOOKS,
    STOPS,
    SURE_MAP_M,
    TELLING,
    Homing,
)
from agent.exploration.planning import Roads
from agent.mapping.exactness import Looks
from tests.agent.exploration.test_planning import chain

OPEN = chain([(-9, -9), (9, -9), (9, 9), (-9, 9), (-9, -9)])


def known(sd_m, *looks):
    """A map that is known to so much, and what is left after looks from places: ((x, y), share) each."""
    places, left = [place for place, _ in looks], np.array([share * sd_m for _, share in looks])
    return SimpleNamespace(sd_m=lambda: sd_m, looks=lambda: Looks(np.array(places).reshape(-1, 2), left))


UNSURE = known(0.03)


def driven(sds, room=OPEN, most=100, clearances=(0.25, 0.2), looks=()):
    """Tasks until there is none. Each but a lap's stops lets the map be known to the next of these deviations."""
    homing, tasks, left = Homing(), [], list(sds)
    ways = [Roads(room, np.array((3.0, 1.0)), clearance) for clearance in clearances]
    for _ in range(most):
        way = homing.next(known(left[0], *looks), ways)
        if way is None:
            break
        homing.pursue(way.task)
        homing.done(way.task)
        tasks.append(way.task)
        if len(left) > 1 and (way.task.kind != "lap" or not way.task.place.any()):
            left.pop(0)
    return homing, ways, tasks


@pytest.mark.parametrize(("sds", "laps"), [
    ([0.9 * EXACT_MAP_M], None),
    ([0.03, 0.9 * SURE_MAP_M], 0),
    ([0.03, 0.025, 0.9 * SURE_MAP_M], 1),
    ([0.03, 0.03, 0.03, 0.9 * SURE_MAP_M], 2),
    ([0.03], len(LAPS_M)),
])  # fmt: skip
def test_laps_go_on_until_the_map_is_known(sds, laps):
    """A lap that tells nothing is followed by one that passes elsewhere: one of three robots in `hall` had stopped."""
    _, _, tasks = driven(sds)
    assert [task.kind for task in tasks] == ([] if laps is None else ["home"] + ["lap"] * laps * (STOPS + 1))
    ends = tasks[:: STOPS + 1]
    assert all(np.allclose(task.stand, 0.0, atol=0.05) for task in ends)
    radii = [round(float(np.hypot(*task.stand)), 3) for task in tasks]
    assert [radius for radius in radii if radius > 0.5] == [r for r in LAPS_M[: laps or 0] for _ in range(STOPS)]


def test_a_lap_keeps_to_where_there_is_a_way():
    corridor = chain([(-9, -0.5), (9, -0.5), (9, 1.2), (-9, 1.2), (-9, -0.5)])
    _, _, tasks = driven([0.03], corridor)
    assert 2 < len(tasks) <= 1 + len(LAPS_M) * (1 + STOPS)
    assert all(-0.3 <= task.stand[1] <= 1.0 for task in tasks)
    assert np.allclose(tasks[-1].stand, 0.0, atol=0.05)


def test_after_another_task_home_is_new_again():
    homing, ways, tasks = driven([0.03])
    assert homing.next(UNSURE, ways) is None
    homing.pursue(Task("frontier", np.zeros(2), np.zeros(2)))
    again = homing.next(UNSURE, ways)
    assert again is not None
    assert again.task.kind == "home"
    assert tasks[0].kind == "home"


def test_laps_go_on_where_they_were_left_and_end():
    """They began anew, for 900 s, where an end opened as it was seen from a lap and closed from elsewhere."""
    homing, ways, laps = Homing(), [Roads(OPEN, np.array((3.0, 1.0)), 0.25)], 0
    for _ in range(10 * len(LAPS_M) * (STOPS + 1)):
        way = homing.next(UNSURE, ways)
        if way is None:
            break
        homing.pursue(way.task)
        homing.done(way.task)
        if way.task.kind == "lap":
            laps += 1
            homing.pursue(Task("frontier", np.zeros(2), np.zeros(2)))
    assert way is None and laps == len(LAPS_M) * (STOPS + 1)


def test_where_only_tight_ways_lead_laps_are_driven_too():
    _, _, tasks = driven([0.03], most=3, clearances=(9.5, 0.2))
    assert [task.kind for task in tasks] == ["home", "lap", "lap"]


@pytest.mark.parametrize(("kind", "ends"), [("frontier", False), ("frontier", True), ("errand", False)])
def test_a_way_home_that_is_left_again_and_again_for_other_goals_is_given_up(kind, ends):
    homing, ways, tries = Homing(), [Roads(OPEN, np.array((3.0, 1.0)), 0.25)], 0
    while tries < 3 * MOST_LEFT and (home := homing.home(UNSURE, ways)) is not None:
        homing.pursue(home.task)
        if ends:
            homing.done(home.task)
        homing.pursue(Task(kind, np.zeros(2), np.zeros(2)))
        tries += 1
    assert tries == (1 if kind == "frontier" and not ends else 3) * MOST_LEFT


def test_a_way_home_that_ends_before_home_is_tried_again_and_again_but_not_for_ever():
    """A robot whose way home a teammate barred once took itself to have been there, and stayed away for good.

    Six times early in a run left it without home and laps at the end: once all else is done, it is tried as often.
    """
    homing, ways = Homing(), [Roads(OPEN, np.array((3.0, 1.0)), 0.25)]
    for go, most in ((homing.home, MOST_LEFT), (homing.next, MOST_LEFT), (homing.home, 0), (homing.next, 0)):
        tries = 0
        while tries < 3 * MOST_LEFT and (home := go(UNSURE, ways)) is not None:
            homing.pursue(home.task)
            homing.give_up()
            homing.pursue(Task("frontier", np.zeros(2), np.zeros(2)))
            tries += 1
        assert tries == most


def test_before_laps_it_looks_at_the_nearest_of_the_walls_that_tell_the_most():
    """What home does not show: a map of three robots in `hall` lay 50 mm off for all of its laps."""
    far, near, little = ((-6.0, 5.0), 0.5), ((5.0, 4.0), 0.52), ((4.0, 1.0), 1.0 - 0.9 * TELLING)
    _, _, tasks = driven([0.03], looks=(far, near, little))
    assert [task.kind for task in tasks[:4]] == ["home", "look", "look", "lap"]
    assert [tuple(task.stand) for task in tasks[1:3]] == [near[0], far[0]]


def test_it_looks_once_at_each_place_and_not_for_ever():
    beside = [((2.0 * x, 5.0 + 0.4 * y), 0.5) for x in range(-4, 5) for y in range(3)]
    _, _, tasks = driven([0.03], looks=beside, most=200)
    stands = np.array([task.stand for task in tasks if task.kind == "look"])
    assert len(stands) == MOST_LOOKS
    assert len({round(float(x)) for x, _ in stands}) == MOST_LOOKS


def test_a_map_that_is_known_after_a_look_needs_no_further_one():
    look = ((5.0, 4.0), 0.5)
    _, _, tasks = driven([0.03, 0.03, 0.9 * SURE_MAP_M], looks=(look, ((-5.0, 4.0), 0.5)))
    assert [task.kind for task in tasks] == ["home", "look"]


def test_a_wall_that_no_way_leads_to_is_not_looked_at():
    _, _, tasks = driven([0.03], looks=(((12.0, 0.0), 0.3), ((5.0, 4.0), 0.5)), most=3)
    assert [task.kind for task in tasks] == ["home", "look", "lap"]
    assert tuple(tasks[1].stand) == (5.0, 4.0)


def test_of_walls_that_no_way_leads_to_some_are_asked_for_one(monkeypatch):
    """All walls of a hall were, in one tick."""
    asked, homing = [], Homing()
    monkeypatch.setattr(standing, "near", lambda *_: asked.append(1))
    homing.done(Task("home", np.zeros(2), np.zeros(2)))
    assert homing.next(known(0.03, *(((9.0, 0.1 * k), 0.5) for k in range(400))), [None]) is None
    assert len(asked) == MOST_BARRED + STOPS + 1  # of a lap


def test_a_look_that_an_errand_interrupts_is_made_afterwards_but_not_begun_for_ever():
    homing, ways = Homing(), [Roads(OPEN, np.array((3.0, 1.0)), 0.25)]
    unsure, begun = known(0.03, ((5.0, 4.0), 0.5)), 0
    while (way := homing.next(unsure, ways)) is not None and way.task.kind != "lap":
        homing.pursue(way.task)
        if way.task.kind == "home":
            homing.done(way.task)
        else:
            begun += 1
            homing.pursue(Task("errand", np.zeros(2), np.zeros(2)))
    assert begun == MOST_LOOKS + MOST_LEFT
