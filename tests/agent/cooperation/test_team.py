"""Robots that meet: right proposals are merged, wrong ones never, wrong merges are undone, hostile maps do nothing."""

import numpy as np
import pytest

from agent.config import AgentConfig
from agent.cooperation.peer import PeerLog, Unaligned
from agent.cooperation.peer_places import IN_TOUCH_S, NEARER_M, PLACE_KNOWN_S
from agent.robot import Robot, Step
from deploy.bench.alignment.forced import ForcedRun
from deploy.bench.alignment.hostile import KINDS, besiege
from deploy.bench.errors import errors
from deploy.bench.explored import explore
from deploy.sensing import IDEAL
from protocol.messages import Observation, RobotSpec
from protocol.wireframe import Wireframe

pytestmark = pytest.mark.system

MEET = {"world": "apartment", "robots": 2, "seed": 1, "starts": "random", "max_time_s": 100.0, "spec": IDEAL}


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
        assert set(data["evidence"]) == {"ground", "discs", "heard", "thirds", "later_maps"}
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
        for one in mind.team.places.teammates(run.episode.tick):
            assert one.robot != name and one.covariance[0] > 0 and one.covariance[8] > 0


def test_of_two_that_are_as_near_the_first_by_name_goes(met) -> None:
    run, _, _ = met
    places = next(mind.team.places for mind in run.robots.values() if mind.team.merged)
    (first, _), (second, _) = (places.partners(run.episode.tick, name) for name in ("a", "z"))
    assert len(first) and (first[:, :2] == second[:, :2]).all()
    assert first[:, 2] == pytest.approx(second[:, 2] + 2 * NEARER_M)


def test_a_teammate_that_is_silent_for_a_while_bids_no_more_and_then_has_no_part(met) -> None:
    run, _, _ = met
    places = next(mind.team.places for mind in run.robots.values() if mind.team.merged)
    tick, count = run.episode.tick, []
    for seconds in (0.0, IN_TOUCH_S + 1.0, PLACE_KNOWN_S + 1.0):
        partners, silent = places.partners(tick + round(5.0 * seconds), "a")
        count.append((len(partners), len(silent)))
    assert count == [(1, 0), (0, 1), (0, 0)]


def test_without_sharing_nothing_is_aligned() -> None:
    run = explore({**MEET, "max_time_s": 40.0}, {"cooperation": {"sharing": False}})
    for mind in run.robots.values():
        assert mind.exchange.contacts and not mind.team.peers
        assert not mind.team.places.strange_to(mind.exchange.contacts)  # nor does it drive to be seen


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
        (11, "its later maps contradict it"),  # the robot drives where the wrong walls are not
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
            team._align = lambda *_: False  # type: ignore[method-assign]
        for event in step.action.events:
            if event.event == "unmerged":
                events.append((observation.tick / 5, event.event, event.data))
                undone.append(robot.wireframe is robot.own and not team.merged and not len(team.views.places))
        peer = team.peers.get("r2")
        if observation.tick < 100 or peer is None:  # until both have seen something that can be contradicted
            return
        if isinstance(peer, Unaligned) and not events and peer.log.map is not None:
            x, y, _ = peer.log.pose
            there = (-x + 1.0, -y + 0.5, 0.4)  # anywhere but where it is
            team.merge(team.propose(peer, there, robot.own, {}), observation.tick, robot.own)

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


def test_each_peer_s_map_has_its_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where odometry errs, merged ones are due at all times: with 20 of them no other one was aligned any more."""
    team, turns = Robot("r0", RobotSpec(), AgentConfig(), 0).team, []
    for number in range(25):
        team.peers[f"r{number}"] = Unaligned(PeerLog(f"r{number}"))
    monkeypatch.setattr(team, "_align", lambda tick, peer, own: turns.append(peer.log.name) or True)
    for tick in range(50):
        team.align_maps(tick, Wireframe())
    assert turns[:25] == turns[25:] and len(set(turns)) == 25


def test_without_division_of_work_who_is_merged_is_no_stranger() -> None:
    run = explore(MEET, {"cooperation": {"division": False}})
    for name, mind in run.robots.items():
        peer = next(other for other in run.robots if other != name)
        assert mind.team.places.strange_to([peer]) == ([] if mind.team.merged else [peer])
    assert any(mind.team.merged for mind in run.robots.values())
