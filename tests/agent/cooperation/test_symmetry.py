"""Robots in halls that are nearly the same after a turn: no map is laid over another the wrong way round."""

import pytest

from deploy.bench.errors import errors, right
from deploy.bench.explored import explore
from deploy.bench.layouts import written
from deploy.bench.made import traced, turned


@pytest.mark.parametrize(
    ("world", "seed", "limit_s"),
    [
        (traced(2), 0, 30.0),  # half turns that shift all walls by centimetres were accepted after 8 and 10 s
        (traced(3), 2, 30.0),  # after 3 and 6 s
        pytest.param(turned(3), 1, 90.0, marks=pytest.mark.slow),  # a quarter turn that only a post tells, at 80 s
    ],
)
def test_a_turn_under_which_a_hall_is_nearly_the_same_is_not_accepted(world, seed, limit_s) -> None:
    settings = {"world": written(world), "robots": 3, "seed": seed, "starts": "random", "max_time_s": limit_s}
    run = explore(settings, {})
    accepted = [(robot, event.data) for _, robot, event in run.events if event.event == "accepted"]
    for robot, data in accepted:
        peer = data["peer"]
        centre = run.robots[peer].own.points.mean(0)
        assert right(*errors(data["transform"], run.frame(robot), run.frame(peer), centre)), data
    assert accepted
    assert not any(event.event == "unmerged" for _, _, event in run.events)
