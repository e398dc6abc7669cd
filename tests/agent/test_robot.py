"""One robot's step: what it says, whom it counts as met, and that it takes nothing at face value."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from agent import warmup
from agent.config import AgentConfig
from agent.look_round import LONGER
from agent.mapping.submaps.segments import SEGMENT
from agent.mapping.submaps.settled import Settled
from agent.robot import Robot
from protocol.arrays import Floats
from protocol.geometry import Pose
from protocol.grid_map import quantise
from protocol.map_codec import decode_map, encode_map
from protocol.messages import EVERYONE, Heard, LidarSpec, Observation, RobotSpec
from protocol.talk import Beacon, Part
from protocol.wireframe import Wireframe
from tests.agent.alignment.test_by_sight import SCAN
from tests.agent.cooperation.test_team_views import merged
from tests.ideal import ideal_lidar, ideal_spec
from world.lidar.lidar import Lidar

SPEC = ideal_spec()
ROOM = np.array([(-1, -1, 2, -1), (2, -1, 2, 1), (2, 1, -1, 1), (-1, 1, -1, -1)], np.float64)
SQUARE = Wireframe(
    np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float64),
    np.zeros(4, np.uint8),
    np.array([(0, 1), (1, 2), (2, 3), (3, 0)], np.int32),
    np.ones(4, np.float32),
    np.ones(4, np.bool_),
)


def observation(
    tick: int, heard: int = 0, seed: int = 0, pose: Pose = (0.0, 0.0, 0.0), others: Floats | None = None
) -> Observation:
    lidar = Lidar(ROOM, SPEC.lidar)
    ranges = lidar.measured(lidar.cast(np.array([pose]), others), [np.random.default_rng([seed, tick])])[0]
    return Observation(tick=tick, ranges=ranges.astype("<f4").tobytes(), odometry=pose, heard=heard)


def beacon(tick: int, sender: str = "r2") -> Heard:
    return Heard(tick=tick, sender=sender, kind="beacon", payload=Beacon(tick, (0.5, 0.5, 0.0)).encode())


def map_of(tick: int, sender: str = "r2", body: bytes | None = None) -> Heard:
    body = encode_map(quantise(SQUARE, 10, 0)).data if body is None else body
    return Heard(tick=tick, sender=sender, kind="map", payload=Part(tick, 0, 0, 1, body).encode())


def robot() -> Robot:
    return Robot("r1", SPEC, AgentConfig(), seed=3)


def test_a_step_answers_its_tick_and_counts_its_messages() -> None:
    mind = robot()
    for tick in range(6):
        step = mind.step(observation(tick), [])
        assert step.action.tick == step.scan.tick == step.pose.tick == tick
        assert step.action.sent == len(step.sends)
        assert abs(step.action.speed_mps) <= SPEC.max_speed_mps
        assert abs(step.action.turn_rps) <= SPEC.max_turn_rps


@pytest.mark.parametrize("rate_hz", [5, 10, 20])
def test_walls_count_as_many_scans_in_a_second_at_any_rate(rate_hz: float) -> None:
    mind = Robot("r1", ideal_spec(lidar=ideal_lidar(rate_hz=rate_hz)), AgentConfig(), seed=3)
    for tick in range(round(2 * rate_hz)):
        mind.step(observation(tick), [])
    assert len(mind.wireframe.edges) == 4 and abs(mind.filter.edges["due"].max() - 10) <= 1


@pytest.mark.parametrize(("peers", "seconds"), [(2, 0.2), (12, 2.0)])
def test_the_maps_of_a_crowd_are_laid_over_the_own_one_less_often(
    peers: int, seconds: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    mind, laid = robot(), []
    merged = [SimpleNamespace(laid=SimpleNamespace(layer=None, first_hand=None))] * peers
    monkeypatch.setattr(mind, "team", SimpleNamespace(merged=merged, changed=True))  # in each tick one sends a new map
    for tick in range(100):
        monkeypatch.setattr(mind.filter, "wireframe_with", lambda *_, now=tick: laid.append(now) or Wireframe())
        mind._draw_map(tick, own_changed=True)
    assert np.diff(laid).min() == np.diff(laid).max() == round(seconds * SPEC.lidar.rate_hz)


def test_an_own_wall_that_is_new_just_after_a_laying_is_laid_once_that_is_due(monkeypatch: pytest.MonkeyPatch) -> None:
    mind, laid = robot(), []
    merged = [SimpleNamespace(laid=SimpleNamespace(layer=None, first_hand=None))]
    monkeypatch.setattr(mind, "team", SimpleNamespace(merged=merged, changed=False))
    for tick in range(20):
        monkeypatch.setattr(mind.filter, "wireframe_with", lambda *_, now=tick: laid.append(now) or Wireframe())
        mind._draw_map(tick, own_changed=tick in (5, 6))
    assert laid == [5, 8]


def test_a_robot_that_somebody_else_drives_maps_on_and_knows_its_place() -> None:
    minds = [Robot("r1", RobotSpec(lidar=ideal_lidar()), AgentConfig(), seed=3) for _ in range(2)]
    for tick, turn in enumerate([0.0, 0.0, *np.linspace(0.0, 2.0 * math.pi, 30)]):
        seen = observation(tick, pose=(0.3 * math.sin(turn), 0.3 - 0.3 * math.cos(turn), turn))  # a circle
        minds[0].step(seen, [])
        if 2 < tick < 31:
            assert minds[1].look(seen) == minds[1].filter.pose
        else:
            minds[1].step(seen, [])
    assert minds[1].filter.pose == minds[0].filter.pose == pytest.approx((0.0, 0.0, 0.0), abs=0.05)
    assert (minds[1].filter.covariance == minds[0].filter.covariance).all()
    assert len(minds[1].wireframe.edges) == len(minds[0].wireframe.edges) > 0


def test_what_a_robot_maps_while_it_must_stand_is_on_its_map_and_shown_once_it_goes_on() -> None:
    mind = robot()
    for tick in range(10):
        mind.look(observation(tick))
    assert len(mind.wireframe.edges) == 4
    assert [mind.step(observation(tick), []).map is not None for tick in (10, 11)] == [True, False]


def test_maps_that_changed_just_before_a_robot_must_stand_are_laid_once(monkeypatch: pytest.MonkeyPatch) -> None:
    mind, laid = robot(), []
    mind.team.peers["r2"] = merged("r2", [1.0], [])
    mind.team.changed = True
    monkeypatch.setattr(mind.filter, "wireframe_with", lambda *_: laid.append(0) or Wireframe())
    mind._draw_map(0, own_changed=False)
    monkeypatch.setattr(mind._own, "update", lambda _: False)
    for tick in range(1, 10):
        mind.look(observation(tick))
    assert len(laid) == 1


@pytest.mark.parametrize("other", ["merged", "met", "unheard"])
def test_a_robot_that_must_stand_takes_no_other_one_for_a_post(other: str) -> None:
    mind = robot()
    if other == "merged":
        mind.team.peers["r2"] = merged("r2", [], [])
    for tick in range(200, 210):
        mind.step(observation(tick), [] if other == "unheard" else [beacon(tick)])
    for tick in range(210, 290):
        mind.look(observation(tick, others=np.array([(1.0, 0.3, SPEC.radius_m)])))
    assert len(mind.perception._posts.places) == 0
    assert len(mind.filter.wireframe().edges) == 4


def test_merged_maps_are_laid_at_once_over_a_map_that_was_torn(monkeypatch: pytest.MonkeyPatch) -> None:
    mind, laid = Robot("r1", RobotSpec(), AgentConfig(), seed=3), []
    mind.team.peers["r2"] = merged("r2", [1.0], [])
    settled = Settled(np.zeros(0, SEGMENT), (0.0, 0.0, 0.0), np.zeros(1, np.int64), np.zeros((1, 3)))
    monkeypatch.setattr(mind.loops, "take", lambda tick, *_: tick == 3)
    monkeypatch.setattr(mind.loops, "settled", lambda: settled)
    for tick in range(6):
        monkeypatch.setattr(mind.filter, "wireframe_with", lambda *_, now=tick: laid.append(now) or Wireframe())
        mind.step(observation(tick), [])
    assert laid == [1, 3]  # else 0.6 s after the first


def test_viewpoints_wait_for_the_laying_of_what_was_seen_from_there(monkeypatch: pytest.MonkeyPatch) -> None:
    mind, waits = robot(), []
    mind.team.peers["r2"] = merged("r2", [1.0], [])
    looked = mind.team.views.looked
    monkeypatch.setattr(mind.team.views, "looked", lambda *given: waits.append(not given[-1]) or looked(*given))
    monkeypatch.setattr(mind._laying, "take_due", lambda *_: False)
    for tick in range(4):
        monkeypatch.setattr(mind._laying, "_own_changed", tick in (1, 2))
        mind.step(observation(tick), [])
    assert waits == [False, True, True, False]


def test_no_peer_is_told_its_own_walls(monkeypatch: pytest.MonkeyPatch) -> None:
    mind = robot()
    merged = [SimpleNamespace(log=SimpleNamespace(name=name), laid=SimpleNamespace(first_hand=name)) for name in "ab"]
    monkeypatch.setattr(mind, "team", SimpleNamespace(merged=merged))
    monkeypatch.setattr(
        mind.filter, "told_with", lambda layers, _: lambda left: layers[:left] + layers[(left or 0) + 1 :]
    )
    assert [mind._told_to()(peer) for peer in "ab"] == [["b"], ["a"]]
    monkeypatch.setattr(mind.filter, "told_with", lambda layers, _: lambda left: (layers, left))
    assert [mind._told_to()(peer) for peer in "abc"] == [(["a", "b"], 0), (["a", "b"], 1), (["a", "b"], None)]
    merged.pop()
    assert mind._told_to()("a") is mind.own


def test_a_robot_alone_sends_beacons_only() -> None:
    mind = robot()
    sent = [(tick, send) for tick in range(60) for send in mind.step(observation(tick), []).sends]
    assert [tick for tick, _ in sent] == [0, 25, 50]
    assert all(send.to == EVERYONE and send.kind == "beacon" and len(send.payload) <= 32 for _, send in sent)


def test_a_peer_that_is_heard_is_greeted_and_told_the_map_once() -> None:
    config = AgentConfig.model_validate({"radio": {"sight_beacon_s": 5.0}})  # a corner of this room may pass for a disc
    mind = Robot("r1", SPEC, config, seed=3)
    sent = []
    for tick in range(24):
        said = [beacon(tick)] if tick == 10 else []
        said += [
            Heard(tick=tick, sender="r2", kind="ack", payload=bytes([0x10, part.version]))
            for at, send in sent
            if at == tick - 2 and send.kind == "map" and (part := Part.decode(send.payload))
        ]
        sent += [(tick, send) for send in mind.step(observation(tick, len(said)), said).sends]
    assert [(tick, send.kind, send.to) for tick, send in sent] == [
        (0, "beacon", "*"), (10, "beacon", "*"), (10, "map", "r2"),
    ]  # fmt: skip
    assert len(decode_map(Part.decode(sent[-1][1].payload).body).cells) >= 4


@pytest.mark.parametrize(("sharing", "ticks"), [(True, [0, 5, 10, 15, 20]), (False, [0])])
def test_who_shares_no_map_needs_not_be_seen(sharing: bool, ticks: list[int]) -> None:
    mind = Robot("r1", SPEC, AgentConfig.model_validate({"cooperation": {"sharing": sharing}}), seed=3)
    mind.exchange.hear(0, [beacon(0)])
    mind.exchange._beacon_due = False
    scan = replace(SCAN, discs=np.array([(1.0, 0.0)]))
    told = [tick for tick in range(25) for send in mind._talk(tick, (0.0, 0.0, 0.0), scan) if send.kind == "beacon"]
    assert told == ticks


def test_a_robot_keeps_to_the_radio_s_mtu() -> None:
    spec = ideal_spec(radio_mtu_bytes=100)
    assert Robot("r1", spec, AgentConfig(), 7).exchange.mtu_bytes == 100


def test_a_peer_is_met_once_and_lost_after_silence() -> None:
    mind = robot()
    events = []
    for tick in range(80):
        said = [beacon(tick), map_of(tick)] if tick in (5, 10, 20, 70) else []
        events += [(tick, e.event, e.data) for e in mind.step(observation(tick, len(said)), said).action.events]
    met = [(tick, name) for tick, name, data in events if name in ("contact", "lost")]
    assert met == [(5, "contact"), (46, "lost"), (70, "contact")]
    log = mind.team.peers["r2"].log
    assert (log.pose, log.pose_tick) == ((0.5, 0.5, 0.0), 70)
    assert log.map is not None and len(log.map.wireframe.edges) == 4
    assert log.map.tick == 70


@pytest.mark.parametrize(
    "bad",
    [
        Heard(tick=1, sender="r2", kind="map", payload=b"\xff\x00"),
        Heard(tick=1, sender="r2", kind="beacon", payload=b""),
        Heard(tick=1, sender="r2", kind="ack", payload=b"\x13\x01"),
        map_of(1, body=b"no map"),
    ],
)
def test_a_bad_message_is_refused_with_a_reason_and_changes_nothing(bad: Heard) -> None:
    mind = robot()
    mind.step(observation(0), [])
    events = mind.step(observation(1, 1), [bad]).action.events
    refused = [e for e in events if e.event == "refused"]
    assert len(refused) == 1
    assert refused[0].data["peer"] == "r2"
    assert refused[0].data["reason"]
    assert not mind.exchange.contacts and not mind.team.peers


def test_the_same_observations_give_the_same_step() -> None:
    def steps() -> list[tuple[object, ...]]:
        mind = robot()
        out = []
        for tick in range(20):
            step = mind.step(observation(tick), [])
            out.append((step.action.model_copy(update={"step_ms": 0.0}), step.sends, step.scan, step.pose, step.map))
        return out

    assert steps() == steps()


def test_a_rehearsal_draws_a_map_and_changes_no_step(monkeypatch: pytest.MonkeyPatch) -> None:
    before = robot().step(observation(0), [])
    made: list[Robot] = []

    def noted(*args: object) -> Robot:
        made.append(Robot(*args))  # type: ignore[arg-type]
        return made[-1]

    monkeypatch.setattr(warmup, "Robot", noted)
    monkeypatch.setattr(warmup, "_rehearsed", False)
    warmup.rehearse()
    warmup.rehearse()
    assert len(made) == 1 and len(made[0].wireframe.edges) >= 5 and made[0].explorer.target is not None
    after = robot().step(observation(0), [])
    assert after.map == before.map and after.scan == before.scan
    assert after.action.model_copy(update={"step_ms": 0.0}) == before.action.model_copy(update={"step_ms": 0.0})


def test_a_robot_that_is_restored_looks_round_at_its_start_and_trusts_no_half_chain_elsewhere() -> None:
    spec = RobotSpec()
    robot = Robot("r1", spec, AgentConfig(), seed=3)
    for tick in range(3):
        robot.step(observation(tick), [])
    at_start, state = Robot("r1", spec, AgentConfig(), seed=3), robot.state()
    at_start.restore(state)
    assert at_start.loops is not None
    assert at_start.step(observation(3), []).action.speed_mps == 0.0
    elsewhere = Robot("r1", spec, AgentConfig(), seed=3)
    elsewhere.restore({**state, "odometry": np.array((1.0, 0.0, 0.0))})
    assert elsewhere.loops is None  # its submaps would know nothing of the walls from before


def test_who_takes_odometry_as_it_is_closes_no_loops() -> None:
    config = AgentConfig()
    as_it_is = config.model_copy(update={"filter": config.filter.model_copy(update={"correct_pose": False})})
    loops = [Robot("r1", RobotSpec(), one, seed=3).loops for one in (config, as_it_is)]
    assert loops[0] is not None and loops[1] is None


@pytest.mark.parametrize(("noise_m", "sees"), [(0.01, True), (0.05, False)])
def test_a_place_before_a_wall_is_seen_past_as_far_as_ranges_err(noise_m: float, sees: bool) -> None:
    """All lidars were taken to err by 10 mm."""
    mind, here = Robot("r1", ideal_spec(lidar=ideal_lidar(noise_m=noise_m)), AgentConfig(), seed=3), observation(0)
    scan = mind._map_scan(here, set())
    situation = mind._situation(0, scan, scan.wireframe())
    assert situation.sees_past(np.array([(1.9, 0.0)]), 0.05).tolist() == [sees]


@pytest.mark.parametrize(("rate_hz", "ticks"), [(5, 50), (10, 64), (20, 64)])
def test_the_first_look_ends_after_as_many_scans_as_are_kept(rate_hz: float, ticks: int) -> None:
    spec = RobotSpec(lidar=LidarSpec(rate_hz=rate_hz))
    robot, stood = Robot("r1", spec, AgentConfig(), seed=3), 0
    while not robot.step(observation(stood), []).action.complete and stood < 200:
        stood += 1
    assert stood == ticks  # all of the room is in view


COLUMN = np.array([(2.6, 0.2, 2.6, -0.2), (2.6, -0.2, 3.0, -0.2), (3.0, -0.2, 3.0, 0.2), (3.0, 0.2, 2.6, 0.2)])


@pytest.mark.parametrize(("held", "pushed_at", "correct_pose", "ticks"), [
    (0, 9999, True, LONGER * 50),
    (0, 9999, False, 50),
    (0, 20, True, 50),
    (70, 9999, True, LONGER * 50),
    (300, 9999, True, 300),
])  # fmt: skip
def test_who_sees_little_looks_longer_before_it_drives(
    held: int, pushed_at: int, correct_pose: bool, ticks: int
) -> None:
    """With 10 s of a far column in `hall` robots left with a frame turned by up to a degree.

    Who does not correct its pose, or was pushed, has nothing of it; who must stand for a while looks meanwhile.
    """
    spec, config = RobotSpec(), AgentConfig.model_validate({"filter": {"correct_pose": correct_pose}})
    lidar, rng, robot = Lidar(COLUMN, spec.lidar), np.random.default_rng(0), Robot("r1", spec, config, seed=3)
    for tick in range(ticks + 1):
        ranges = lidar.measured(lidar.cast(np.zeros((1, 3))), [rng])[0]
        odometry = (0.1 if tick >= pushed_at else 0.0, 0.0, 0.0)
        seen = Observation(tick=tick, ranges=ranges.astype("<f4").tobytes(), odometry=odometry)
        if tick < held:
            robot.look(seen)
            continue
        action = robot.step(seen, []).action
        assert ((action.speed_mps, action.turn_rps) == (0.0, 0.0)) == (tick < ticks)
