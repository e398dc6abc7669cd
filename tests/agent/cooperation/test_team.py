"""Proposals on trial: right ones are merged, wrong ones never, wrong merges are undone, hostile maps do nothing."""

from __future__ import annotations

import numpy as np
import pytest

from agent.config import AgentConfig
from agent.cooperation.config import VerificationConfig
from agent.cooperation.evidence import WallEvidence
from agent.cooperation.peer import Heard
from agent.cooperation.verification import Trial
from agent.robot import Robot, Step
from deploy.bench.alignment.forced import ForcedRun
from deploy.bench.alignment.hostile import KINDS, besiege
from deploy.bench.errors import errors
from deploy.bench.explored import explore
from protocol.messages import LidarSpec, Observation
from tests.agent.mapping.test_layers import scan_at
from tests.agent.mapping.test_particle_filter import ROOM, Walk

MEET = {"world": "apartment", "robots": 2, "seed": 1, "starts": "random", "max_time_s": 100.0}


def trial(**config: object) -> Trial:
    return Trial(VerificationConfig.model_validate(config), np.zeros(3), WallEvidence())


def test_each_kind_of_evidence_counts_and_can_be_switched_off() -> None:
    def weighed(**config: object) -> float:
        one = trial(**config)
        one.nats.update(ground=1.0, discs=2.0, heard=-4.0, later_maps=8.0)
        return one.weight

    assert weighed() == 7.0
    assert weighed(ground=False) == 6.0
    assert weighed(discs=False) == 5.0
    assert weighed(heard=False) == 11.0
    assert weighed(later_maps=False) == -1.0


def test_the_bounds_decide() -> None:
    one = trial()
    assert one.verdict is None
    one.align_again(True)
    assert one.verdict is None and one.agreed_again == 1
    one.align_again(True)
    assert one.verdict is True
    one.align_again(False)
    one.align_again(False)
    assert one.verdict is False


def test_a_message_from_beyond_the_radio_s_range_decides_against() -> None:
    one = trial()
    one.hear((0.0, 0.0, 0.0), (3.9, 0.0, 0.0), 4.3)
    assert one.verdict is None
    one.hear((0.0, 0.0, 0.0), (4.4, 0.0, 0.0), 4.3)
    assert one.verdict is False


def test_a_disc_where_it_must_be_speaks_for_and_free_ground_there_against_and_a_hidden_place_not_at_all() -> None:
    rules = Walk(ROOM, LidarSpec()).filter.view_rules(0.12)
    here = (0.7, 0.7, 0.0)
    scan = scan_at(here, ROOM)

    def looks(theirs: tuple[float, float], discs: list[tuple[float, float]]) -> tuple[int, int]:
        one = trial()
        for shift in (0.0, 0.05, 0.4):  # the second is no independent look
            place = (theirs[0], theirs[1] - shift, 0.0)
            seen = np.array(discs, np.float64).reshape(-1, 2) - (0.0, shift)
            one.look_for_disc(here, place, scan, seen, 0.105, rules)
        return one.discs_seen, one.discs_missed

    assert looks((1.0, 2.4), [(1.05, 2.35)]) == (2, 0)
    assert looks((1.0, 2.4), []) == (0, 2)
    assert looks((1.0, 2.4), [(0.5, 1.0)]) == (0, 2)
    assert looks((2.3, 2.3), []) == (0, 0)  # behind the pillar
    assert looks((4.8, 0.9), []) == (0, 0)  # too far to be sure


@pytest.fixture(scope="module")
def met():
    """Two robots in an apartment, and all their events."""
    events: list[tuple[str, str, dict[str, object]]] = []
    teammates = []

    def watch(robot: Robot, observation: Observation, step: Step) -> None:
        events.extend((robot.robot, event.event, event.data) for event in step.action.events)
        teammates.extend(step.pose.teammates)

    return explore(MEET, {}, watch), events, teammates


def test_robots_that_meet_merge_rightly_and_say_why(met) -> None:
    run, events, _ = met
    accepted = [(robot, data) for robot, event, data in events if event == "accepted"]
    assert accepted
    frames = {name: np.array(run.frame(name)) for name in run.robots}
    for robot, data in accepted:
        peer = data["peer"]
        metres, degrees = errors(data["transform"], frames[robot], frames[peer], run.robots[peer].own.points.mean(0))
        assert metres < 0.1 and degrees < 2.0
        assert data["weight"] >= AgentConfig().cooperation.verification.accept
        assert set(data["evidence"]) == {"ground", "discs", "heard", "later_maps"}
        proposed = [d for r, event, d in events if (r, event) == (robot, "proposed") and d["peer"] == peer]
        assert proposed and {"candidates", "inliers", "residual", "margin", "agreement", "conflict"} <= set(proposed[0])
        mind = run.robots[robot]
        assert peer in mind.team.merged_ticks
        assert len(mind.wireframe.edges) >= len(mind.own.edges)
    attempts = [data for _, event, data in events if event == "attempt"]
    assert all(data["reason"] for data in attempts)


def test_the_teammate_s_pose_is_published_where_it_is(met) -> None:
    run, _, teammates = met
    assert any(one.status == "merged" for one in teammates)
    for name, mind in run.robots.items():
        for one in mind.team.teammates(run.episode.tick):
            assert one.robot != name and one.covariance[0] > 0 and one.covariance[8] > 0


def test_without_sharing_nothing_is_aligned() -> None:
    run = explore({**MEET, "max_time_s": 40.0}, {"cooperation": {"sharing": False}})
    assert all(not mind.team.peers for mind in run.robots.values())


def test_forced_wrong_proposals_are_not_accepted() -> None:
    forced = ForcedRun("apartment", 1, 100.0)
    figures = forced.figures()
    assert len(figures["forced"]) >= 4
    assert not any(one["accepted"] and one["wrong"] for one in figures["forced"])


@pytest.mark.parametrize(
    ("seed", "reason"),
    [
        (0, "own scans contradict it"),
        (3, "own scans contradict it"),
        (1, "its later maps contradict it"),  # the robot drives where the wrong walls are not
    ],
)
def test_a_forced_wrong_merge_is_undone_completely(seed: int, reason: str) -> None:
    events: list[tuple[float, str, dict[str, object]]] = []
    undone: list[bool] = []

    def watch(robot: Robot, observation: Observation, step: Step) -> None:
        if robot.robot != "r1":
            return
        team = robot.team
        if reason.startswith("own"):
            team._align = lambda *_: None  # type: ignore[method-assign]
        for event in step.action.events:
            if event.event == "unmerged":
                events.append((observation.tick / 5, event.event, event.data))
                undone.append(robot.wireframe is robot.own and not team.layers and not len(team.viewpoints))
        peer = team.peers.get("r2")
        if observation.tick < 100 or peer is None:  # until both have seen something that can be contradicted
            return
        if isinstance(peer, Heard) and not events and peer.log.map is not None:
            x, y, _ = peer.log.pose
            there = (-x + 1.0, -y + 0.5, 0.4)  # anywhere but where it is
            team.merge(team.propose(peer, there, robot.own, {}), observation.tick)

    explore({**MEET, "seed": seed}, {}, watch)
    assert undone == [True]
    assert events[0][2]["reason"] == reason and events[0][2]["transform"]


@pytest.mark.parametrize("kind", KINDS)
def test_hostile_maps_do_nothing(kind: str) -> None:
    figures = besiege("apartment", 0, 25.0, [kind])
    assert figures["messages"] >= 10
    assert figures["merged"] == 0
    if kind == "shifted":
        assert figures["moved_m"] < 0.05
