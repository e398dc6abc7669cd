"""Robots in halls that are nearly the same after a turn: no map is laid over another the wrong way round."""

import math

import pytest

from agent.cooperation.peer import Unaligned
from agent.robot import Robot, Step
from deploy.bench.errors import errors, right
from deploy.bench.explored import Explored, explore
from deploy.bench.layouts import written
from deploy.bench.made import traced, turned
from deploy.sensing import IDEAL, REAL
from protocol.geometry import compose, relative
from protocol.messages import Observation

pytestmark = pytest.mark.system


@pytest.mark.parametrize(
    ("world", "seed", "limit_s", "spec"),
    [
        (traced(2), 0, 30.0, IDEAL),  # half turns that shift all walls by centimetres were accepted after 8 and 10 s
        (traced(3), 2, 45.0, IDEAL),  # after 3 and 6 s; the right ones after 33 s
        (traced(2), 0, 30.0, REAL),
        (traced(3), 2, 60.0, REAL),
        # a quarter turn that only a post tells, at 80 s
        pytest.param(turned(3), 1, 90.0, REAL, marks=pytest.mark.slow),
    ],
)
def test_a_turn_under_which_a_hall_is_nearly_the_same_is_not_accepted(world, seed, limit_s, spec) -> None:
    settings = {"world": written(world), "robots": 3, "seed": seed, "starts": "random", "max_time_s": limit_s}
    run = explore({**settings, "spec": spec}, {})
    accepted = [(robot, event.data) for _, robot, event in run.events if event.event == "accepted"]
    for robot, data in accepted:
        peer = data["peer"]
        centre = run.robots[peer].own.points.mean(0)
        assert right(*errors(data["transform"], run.frame(robot), run.frame(peer), centre)), data
    assert accepted
    assert not any(event.event == "unmerged" for _, _, event in run.events)


@pytest.mark.parametrize("seed", range(3))
def test_a_merge_by_the_half_turn_of_a_hall_is_undone_once_the_teammate_s_place_is_seen_empty(seed) -> None:
    runs: list[Explored] = []
    undone: list[str] = []

    def keep(run: Explored) -> bool:
        runs[:] = [run]
        return bool(undone)

    def watch(robot: Robot, observation: Observation, step: Step) -> None:
        team = robot.team
        if observation.tick == 0:
            team._align = lambda *_: False  # type: ignore[method-assign]
            robot._look_round = None
            if robot.robot == "r2":
                robot._looks_round = lambda: True  # type: ignore[method-assign]  # it stands
        undone.extend(event.data["reason"] for event in step.action.events if event.event == "unmerged")
        peer = team.peers.get("r2")
        if (
            robot.robot == "r1"
            and isinstance(peer, Unaligned)
            and peer.log.map is not None
            and peer.log.first_encounter
            and not undone
        ):
            half_turn = relative(runs[0].frame("r1"), compose((0.0, 0.0, math.pi), runs[0].frame("r2")))
            team.merge(team.propose(peer, half_turn, robot.own, {}), observation.tick, robot.own)

    near_the_wrong_place = [[1.2, 0.3, 0.0], [-1.8, 0.2, math.pi]]  # r2's is at (1.8, -0.2), 0.8 m from r1
    world = written(turned(0) | {"spawns": near_the_wrong_place})
    explore({"world": world, "robots": 2, "seed": seed, "max_time_s": 120.0, "spec": IDEAL}, {}, watch, enough=keep)
    assert undone == ["its place is empty"]
