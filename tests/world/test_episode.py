"""Whole runs in one process with scripted robots: determinism, the run directory, hostile answers, ends."""

import csv
import json
import math
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from agent.config import AgentConfig
from deploy import inprocess
from protocol.codec import encode
from protocol.errors import ProtocolError
from protocol.messages import EVERYONE, Action, Event, Heard, MapReport, Observation, OdometrySpec, RobotSpec, Send
from protocol.wireframe import MAX_COORDINATE_M, MAX_VERTICES, Wireframe, encode_wireframe
from tests.scripted import ScriptedStep, Wanderer
from world.config import WorldConfig
from world.draws import generator
from world.episode import Episode
from world.ledger import ALLOWED
from world.odometry import Odometry
from world.recorder import own_part
from world.shell.answers import LockstepAnswers
from world.tick import BadOutputsError, Outputs
from world.worldfile import WorldFileError

MIND = AgentConfig()
QUICK = WorldConfig(world="apartment", until=30.0)
MACHINE = ("real_time_factor", "step_ms_median", "late_ticks", "links_lost")
OF_THIS_CALL = ("command_line", "start", "end")


def run(config: WorldConfig, out: Path | None) -> dict:  # type: ignore[type-arg]
    return inprocess.run(config, MIND, out, make_mind=Wanderer)  # type: ignore[arg-type]


def files(out: Path) -> dict[str, bytes]:
    made = {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}
    lines = made["summary.json"].decode().splitlines()
    made["summary.json"] = "\n".join(x for x in lines if not any(key in x for key in MACHINE)).encode()
    manifest = json.loads(made["manifest.json"])
    made["manifest.json"] = json.dumps({key: manifest[key] for key in manifest if key not in OF_THIS_CALL}).encode()
    return made


def test_the_same_run_gives_the_same_bytes_in_another_process(tmp_path: Path) -> None:
    run(QUICK, tmp_path / "here")
    code = (
        "import sys; from pathlib import Path; from tests.world.test_episode import QUICK, run; "
        "run(QUICK, Path(sys.argv[1]))"
    )
    subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "there")],
        cwd=Path(__file__).parents[2],
        env={"PYTHONHASHSEED": "123"},
        check=True,
    )
    here, there = files(tmp_path / "here"), files(tmp_path / "there")
    assert here == there
    assert len(here) == 9 + 3 * 4
    assert run(QUICK.model_copy(update={"seed": 1}), None) != run(QUICK, None)


def test_the_run_directory(tmp_path: Path) -> None:
    summary = run(QUICK, tmp_path)
    truth = json.loads((tmp_path / "truth.json").read_text())
    world = yaml.safe_load((tmp_path / "world.yaml").read_text())
    assert truth["frames"] == {f"r{i + 1}": world["spawns"][i] for i in range(3)}
    assert truth["robot_radius"] == 0.105 and truth["lidar_range"] == 3.5
    on_disk = json.loads((tmp_path / "summary.json").read_text())
    assert on_disk == summary
    for robot in ("r1", "r2", "r3"):
        track = np.loadtxt(tmp_path / "trajectories" / f"{robot}.tum")
        assert track.shape == (151, 8)
        assert track[:, 0] == pytest.approx(np.arange(151) * 0.2)
        assert track[0, 1:3] == pytest.approx(truth["frames"][robot][:2])
        assert 2 * math.atan2(track[0, 6], track[0, 7]) == pytest.approx(truth["frames"][robot][2])
        path = np.hypot(*np.diff(track[:, 1:3], axis=0).T).sum()
        assert path == pytest.approx(summary["robots"][robot]["path_m"], abs=1e-3) and path > 2
        kept = json.loads((tmp_path / "maps" / f"{robot}.json").read_text())
        assert kept["labels"] == ["frontier", "nominal", "occlusion"] and kept["edges"] == [[0, 1], [1, 2]]
        own = json.loads((tmp_path / "maps" / f"{robot}.own.json").read_text())
        assert own["vertices"] == [[0.0, 0.0], [1.0, 0.0]] and own["edges"] == [[0, 1]]
        times = [json.loads(line)["t"] for line in (tmp_path / "snapshots" / f"{robot}.jsonl").open()]
        assert times == [0.0, 10.0, 20.0, 30.0]
    rows = list(csv.DictReader((tmp_path / "metrics.csv").open()))
    assert len(rows) == 4 * 31
    for robot in ("r1", "r2", "r3"):
        shares = [float(row["coverage"]) for row in rows if row["robot"] == robot]
        assert shares == sorted(shares) and shares[0] > 0
        assert summary["robots"][robot]["coverage"] == pytest.approx(shares[-1])
    team = [float(row["coverage"]) for row in rows if row["robot"] == "team"]
    assert team[-1] >= max(summary["robots"][r]["coverage"] for r in ("r1", "r2", "r3"))
    assert summary["robots"]["r1"]["t_90"] is None
    with (tmp_path / "radio.csv").open() as stream:
        radio = list(csv.DictReader(stream))
    assert len(radio) == 30 * 3 * 2
    received = sum(int(row["bytes"]) for row in radio if (row["receiver"], row["outcome"]) == ("r1", "delivered"))
    assert summary["robots"]["r1"]["bytes_received"] == received > 0
    events = [json.loads(line) for line in (tmp_path / "events.jsonl").open()]
    assert events and all(event["tick"] > 0 and event["event"] == "contact" for event in events)  # tick not hidden


@pytest.mark.parametrize("looked", [False, True])
def test_a_run_that_is_interrupted_at_a_whole_second_has_its_figures_once(tmp_path: Path, looked: bool) -> None:
    episode = Episode(QUICK, tmp_path)
    while episode.tick < 5:
        episode.advance({robot: answer(episode.tick) for robot in episode.robots})
    if looked:
        episode.inputs()
    episode.close()
    rows = list(csv.DictReader((tmp_path / "metrics.csv").open()))
    assert [row["t"] for row in rows] == ["0.0"] * 4 + ["1.0"] * 4


def test_adding_a_robot_moves_nothing_for_the_others() -> None:
    two, three = (Episode(QUICK.model_copy(update={"robots": n, "starts": "random"}), None) for n in (2, 3))
    assert np.array_equal(two.starts, three.starts[:2])
    mine, same = ([(told.seed, told.spec) for told in map(run.welcome, two.robots)] for run in (two, three))
    assert mine == same
    draws = {generator(0, purpose, robot).integers(2**63) for purpose in "ab" for robot in ("r1", "r2")}
    assert len(draws) == 4


def test_other_settings_are_another_run_for_the_robots() -> None:
    spec = RobotSpec(radius_m=0.2)
    other = [{"seed": 1}, {"starts": "random"}, {"world": "office"}, {"robots": 2}, {"people": 3}, {"spec": spec}]
    configs = [QUICK.model_copy(update=update) for update in ({}, *other)]
    names = [Episode(config, None).welcome("r1").run for config in configs]
    assert len({*names}) == len(names) and all(len(name) == 16 for name in names)
    assert Episode(QUICK, None).welcome("r2").run == names[0]


def test_inputs_are_the_same_on_every_call_and_measure_the_world() -> None:
    episode = Episode(QUICK, None)
    first = episode.inputs()
    assert first == episode.inputs()
    scan = first["r1"].observation.scan()
    assert scan.shape == (360,) and np.isfinite(scan).sum() > 200
    assert first["r1"].observation.odometry == (0.0, 0.0, 0.0)
    again = Episode(QUICK, None).inputs()
    assert again == first
    assert not np.array_equal(first["r1"].observation.scan(), first["r2"].observation.scan())


def test_exact_odometry_is_the_true_pose_in_the_start_frame() -> None:
    episode = Episode(QUICK.model_copy(update={"spec": RobotSpec(odometry=OdometrySpec(noisy=False))}), None)
    for _ in range(20):
        inputs = episode.inputs()
        for robot, start, pose in zip(episode.robots, episode.starts, episode.poses, strict=True):
            seen = inputs[robot].observation
            x, y, theta = seen.odometry
            c, s = math.cos(start[2]), math.sin(start[2])
            assert (start[0] + c * x - s * y, start[1] + s * x + c * y) == pytest.approx(tuple(pose[:2]))
            assert math.cos(start[2] + theta - pose[2]) == pytest.approx(1)
            assert -math.pi < theta <= math.pi
            assert seen.poses().shape == (5, 3) and tuple(seen.poses()[-1]) == seen.odometry
            if episode.tick > 1:  # the first step of the first period is at rest
                steps = np.diff(seen.poses(), axis=0)
                assert np.hypot(*steps[:, :2].T) == pytest.approx([0.2 / 25] * 4, rel=1e-3)  # chords of an arc
                assert steps[:, 2] % math.tau == pytest.approx([1.0 / 25] * 4)
        episode.advance({robot: answer(episode.tick, speed=0.2, turn=1.0) for robot in episode.robots})


def test_odometry_ends_where_an_observation_ends() -> None:
    """Wheels that erred by most, as slipping ones after hours, ended the run in a traceback."""
    way = np.linspace([0.0, 0.0, 0.0], [100.0, 0.0, 0.0], 1000)
    odometry = Odometry(np.zeros(3), OdometrySpec(distance_sd=1000.0), np.random.default_rng(0))
    told = odometry.update(way)
    assert np.abs(told[:, :2]).max() == MAX_COORDINATE_M
    Observation(tick=0, ranges=b"", odometry=odometry.pose, way=told.tobytes())


def test_noisy_odometry_grows_with_the_root_of_the_distance() -> None:
    config = OdometrySpec(noisy=True, wheel_sd=0, axle_sd=0)
    for ticks in (25, 100, 400):
        ends = []
        for seed in range(300):
            odometry = Odometry(np.zeros(3), config, np.random.default_rng(seed))
            way = np.zeros((ticks, 3))
            way[:, 0] = 0.04 * np.arange(1, ticks + 1)
            ends.append(odometry.update(way)[-1])
        distance = 0.04 * ticks
        off = np.array(ends) - [distance, 0, 0]
        assert off[:, 2].std() == pytest.approx(math.radians(1) * math.sqrt(distance), rel=0.15)
        assert abs(off[:, 2].mean()) < 4 * math.radians(1) * math.sqrt(distance / 300)
        if ticks == 25:  # later the heading's error bends the path
            assert off[:, 0].std() == pytest.approx(0.02 * math.sqrt(distance), rel=0.2)


def test_a_robots_wheels_and_axle_are_wrong_by_the_same_all_the_time() -> None:
    config = OdometrySpec(noisy=True, distance_sd=0, heading_sd_deg=0, turn_sd=0)
    straight, spin = np.zeros((100, 3)), np.zeros((100, 3))
    straight[:, 0] = np.arange(1, 101) / 100
    spin[:, 2] = np.arange(1, 101) / 100
    size, bend, axle = [], [], []
    for seed in range(500):
        path = Odometry(np.zeros(3), config, np.random.default_rng(seed)).update(straight)
        steps = np.diff(path, axis=0)
        assert np.ptp(steps[:, 2]) < 1e-12 and np.ptp(np.hypot(*steps[:, :2].T)) < 1e-12
        size.append(100 * np.hypot(*steps[0, :2]))
        bend.append(path[-1, 2])
        axle.append(Odometry(np.zeros(3), config, np.random.default_rng(seed)).update(spin)[-1, 2] / size[-1])
    assert np.mean(size) == pytest.approx(1, abs=0.002) and np.std(size) == pytest.approx(0.01 / math.sqrt(2), rel=0.1)
    assert np.mean(bend) == pytest.approx(0, abs=0.02) and np.std(bend) == pytest.approx(0.01 * 2**0.5 / 0.16, rel=0.1)
    assert np.mean(axle) == pytest.approx(1, abs=0.002) and np.std(axle) == pytest.approx(0.01, rel=0.1)


def test_wheels_slip_where_the_robot_touches_something() -> None:
    quiet = {"distance_sd": 0, "heading_sd_deg": 0, "turn_sd": 0, "wheel_sd": 0, "axle_sd": 0}
    config = QUICK.model_copy(update={"spec": RobotSpec(odometry=OdometrySpec(noisy=True, **quiet))})
    episode = Episode(config, None)
    believed, went = 0.0, 0.0
    for _ in range(200):
        seen = episode.inputs()["r1"].observation
        believed, went = math.hypot(*seen.odometry[:2]), math.dist(episode.poses[0, :2], episode.starts[0, :2])
        episode.advance({robot: answer(episode.tick, speed=0.2) for robot in episode.robots})
        if episode.tick == 3:
            assert believed == pytest.approx(went, abs=1e-9)
    assert believed == pytest.approx(0.2 * 199 * 0.2, abs=0.01)
    assert went < believed - 0.5


def answer(tick: int, *, speed: float = 0.0, turn: float = 0.0, complete: bool = False) -> Outputs:
    action = Action(tick=tick, speed_mps=speed, turn_rps=turn, complete=complete)
    return Outputs([], action, None)


def unchecked(tick: int, speed: float) -> Action:
    return Action.model_construct(**(Action(tick=tick, speed_mps=0, turn_rps=0).model_dump() | {"speed_mps": speed}))


CUT = Wireframe(points=np.zeros((2, 2)), labels=np.zeros(2, np.uint8))
HOSTILE = {
    "answered for tick 3 at tick 0": answer(3),
    "says it sent 0 messages, but 1 came": answer(0)._replace(
        sends=[Send(tick=0, to=EVERYONE, kind="map", payload=b"")]
    ),
    "answered for tick 7 at tick 0": answer(0)._replace(map=MapReport(tick=7, wireframe=encode_wireframe(CUT))),
    "these bytes are no wireframe": answer(0)._replace(map=MapReport(tick=0, wireframe=bytes(40))),
    "is not 40 bytes long": answer(0)._replace(map=MapReport(tick=0, wireframe=encode_wireframe(CUT) + bytes(9))),
    "no other robot of this run": Outputs(
        [Send(tick=0, to="r9", kind="map", payload=b"")], Action(tick=0, speed_mps=0, turn_rps=0, sent=1), None
    ),
    "sends more than 16 kinds of messages": Outputs(
        [Send(tick=0, to=EVERYONE, kind=f"kind-{k}", payload=b"") for k in range(17)],
        Action(tick=0, speed_mps=0, turn_rps=0, sent=17),
        None,
    ),
    "a drive command is not finite": answer(0)._replace(action=unchecked(0, math.nan)),
}


@pytest.mark.parametrize("words", HOSTILE)
def test_a_hostile_answer_names_the_robot_and_changes_nothing(words: str) -> None:
    episode = Episode(QUICK, None)
    before = episode.inputs()
    answers = {robot: answer(0) for robot in episode.robots} | {"r2": HOSTILE[words]}
    with pytest.raises(ProtocolError, match=words) as caught:
        episode.advance(answers)
    assert isinstance(caught.value, BadOutputsError) and caught.value.robot == "r2"
    assert episode.tick == 0 and episode.inputs() == before
    episode.kill("r2", str(caught.value))
    episode.advance(answers)
    assert episode.tick == 1 and list(episode.inputs()) == ["r1", "r3"]


class Boaster(Wanderer):
    """Says the largest number of everything, and 1 MB of events."""

    def step(self, observation: Observation, heard: Sequence[Heard]) -> ScriptedStep:
        step = super().step(observation, heard)
        if self.robot != "r2":
            return step
        most = dict.fromkeys(("map_bytes", "filter_bytes"), 2**40) | dict.fromkeys(("speed_mps", "turn_rps"), -1e9)
        events = [Event(event="boast", data={"words": ["\x1b" * 1000] * 10, "most": 1e9})] * 100
        action = Action(**{**step.action.model_dump(), **most, "step_ms": 1e9, "events": events})
        points = np.array([[1e4, 1e4], [-1e4, -1e4]])
        wireframe = encode_wireframe(Wireframe(points=points, labels=np.zeros(2, np.uint8)))
        return step._replace(action=action, map=MapReport(tick=observation.tick, wireframe=wireframe))


def test_a_robot_that_boasts_costs_nobody_the_results_nor_the_disk(tmp_path: Path) -> None:
    summary = inprocess.run(QUICK, MIND, tmp_path, make_mind=Boaster)  # type: ignore[arg-type]
    assert json.loads((tmp_path / "summary.json").read_text()) == summary
    assert summary["robots"]["r2"]["step_ms_median"] == 1e9
    events = [json.loads(line) for line in (tmp_path / "events.jsonl").open()]
    assert [event["event"] for event in events if event["robot"] == "r2"].count("muted") == 1
    assert any(event["robot"] == "r1" for event in events)
    assert (tmp_path / "events.jsonl").stat().st_size < sum(ALLOWED["events"]) * 2 + 50_000


class Cartographer(Wanderer):
    """r2 tells everybody the largest map there is, in every tick."""

    def step(self, observation: Observation, heard: Sequence[Heard]) -> ScriptedStep:
        step = super().step(observation, heard)
        if self.robot != "r2":
            return step
        places = np.random.default_rng(observation.tick).uniform(-9, 9, (MAX_VERTICES, 2))
        wireframe = encode_wireframe(Wireframe(points=places, labels=np.zeros(MAX_VERTICES, np.uint8)))
        sends = [Send(tick=observation.tick, to="r1", kind="map", payload=b"map")]
        action = step.action.model_copy(update={"sent": 1})
        return step._replace(action=action, sends=sends, map=MapReport(tick=observation.tick, wireframe=wireframe))


def test_a_robot_with_huge_maps_does_not_fill_the_disk(tmp_path: Path) -> None:
    config = QUICK.model_copy(update={"until": 4.0, "snapshot_s": 0.4})
    inprocess.run(config, MIND, tmp_path, make_mind=Cartographer)  # type: ignore[arg-type]
    last = 2 * MAX_VERTICES * 40  # the last map is always written, as a map and as a snapshot
    written = sum((tmp_path / name).stat().st_size for name in ("updates.jsonl", "snapshots/r2.jsonl"))
    assert ALLOWED["maps"].at_once / 2 < written < ALLOWED["maps"].at_once + 4 * ALLOWED["maps"].a_second + last
    said = [event for event in map(json.loads, (tmp_path / "events.jsonl").open()) if event["event"] == "muted"]
    assert [event["robot"] for event in said] == ["r2"] and "of maps" in said[0]["reason"]


def test_a_robot_that_sends_without_end_is_refused_before_its_action_comes() -> None:
    answers, said = LockstepAnswers(["r1"]), encode(Send(tick=0, to=EVERYONE, kind="map", payload=b""))
    for _ in range(256):
        answers.hear("r1", "radio", said, 0)
    with pytest.raises(ProtocolError, match="more than 256 messages in one tick"):
        answers.hear("r1", "radio", said, 0)


def test_the_dead_stand_still_and_are_logged(tmp_path: Path) -> None:
    episode = Episode(WorldConfig(world="apartment"), tmp_path)
    for _ in range(5):
        episode.advance({robot: answer(episode.tick, speed=0.2) for robot in episode.inputs()})
    episode.kill("r3", "its token is gone")
    episode.kill("r3", "twice")
    places = []
    for _ in range(5):
        episode.advance({robot: answer(episode.tick, speed=0.2) for robot in episode.inputs()})
        places.append(episode.poses[:, :2].copy())
    assert np.abs(places[4] - places[0])[2].max() < 1e-9
    assert np.abs(places[4] - places[0])[0].max() > 0.1
    episode.advance({robot: answer(episode.tick, complete=True) for robot in episode.inputs()})
    assert episode.ended == "complete"  # of those who live
    episode.close()
    events = [json.loads(line) for line in (tmp_path / "events.jsonl").open()]
    assert events == [{"t": 1.0, "tick": 5, "robot": "r3", "event": "dead", "reason": "its token is gone"}]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert [summary["robots"][r]["ended"] for r in ("r1", "r2", "r3")] == ["complete", "complete", "dead"]
    assert not (tmp_path / "maps" / "r1.json").exists()  # it published none


def test_a_robot_that_has_not_joined_hears_and_covers_nothing(tmp_path: Path) -> None:
    config = QUICK.model_copy(update={"radio": QUICK.radio.model_copy(update={"range_m": None})})
    episode = Episode(config, tmp_path)
    for robot in ("r1", "r2"):
        episode.arrive(robot, "process")

    def two_ticks() -> None:
        for _ in range(2):
            send = Send(tick=episode.tick, to="r3", kind="map", payload=b"of r1")
            action = Action(tick=episode.tick, speed_mps=0.0, turn_rps=0.0, sent=1)
            said = {robot: answer(episode.tick) for robot in ("r2", "r3")}
            episode.advance(said | {"r1": Outputs([send], action, None)})

    two_ticks()
    assert episode.coverage["r1"] > 0 and episode.coverage["r3"] == 0
    assert episode.inputs()["r3"].heard == []
    episode.arrive("r3", "process")
    two_ticks()
    assert episode.coverage["r3"] > 0
    episode.close()
    with (tmp_path / "radio.csv").open() as stream:
        outcomes = [row["outcome"] for row in csv.DictReader(stream)]
    assert outcomes == ["absent", "absent", "delivered", "ended"]


def test_ends() -> None:
    until = WorldConfig(world="apartment")
    episode = Episode(until, None)
    mixed = {"r1": answer(0, complete=True), "r2": answer(0), "r3": answer(0, complete=True)}
    episode.advance(mixed)
    assert episode.ended is None
    episode.advance({robot: answer(1, complete=True) for robot in episode.robots})
    assert episode.ended == "complete"

    episode = Episode(until.model_copy(update={"until": 0.6}), None)
    while episode.ended is None:
        episode.advance({robot: answer(episode.tick, complete=True) for robot in episode.robots})
    assert (episode.ended, episode.tick) == ("time", 3)

    episode = Episode(until.model_copy(update={"max_time_s": 1.0}), None)
    while episode.ended is None:
        episode.advance({robot: answer(episode.tick) for robot in episode.robots})
    assert (episode.ended, episode.tick) == ("time", 5)
    assert {robot["ended"] for robot in episode.summary()["robots"].values()} == {"time"}

    episode = Episode(until, None)
    for robot in episode.robots:
        episode.kill(robot, "gone")
    assert episode.ended == "dead"
    episode.close()

    episode = Episode(until, None)
    episode.close()
    assert episode.ended == "interrupted"


def test_a_merge_in_the_last_tick_counts() -> None:
    """A robot that merges the map that it lacked is complete in the same tick."""
    episode = Episode(WorldConfig(world="apartment"), None)
    while episode.tick < 5:
        episode.advance({robot: answer(episode.tick) for robot in episode.robots})
    merged = answer(5, complete=True)
    merged = merged._replace(action=merged.action.model_copy(update={"merged": {"r2": 5}}))
    rest = {robot: answer(5, complete=True) for robot in ("r2", "r3")}
    before = episode.coverage["r1"]
    episode.advance({"r1": merged} | rest)
    episode.close()
    assert episode.ended == "complete"
    assert episode.summary()["robots"]["r1"]["coverage"] > before + 0.02


@pytest.mark.parametrize("robots", [1, 3])
def test_overlap_is_what_own_beams_saw_more_than_once(robots: int) -> None:
    episode = Episode(QUICK.model_copy(update={"robots": robots}), None)
    episode.advance({robot: answer(0) for robot in episode.robots})
    episode.inputs()
    summary = episode.summary()  # nobody has merged anything: what a robot has covered, its own beams have hit
    sums = sum(figures["coverage"] for figures in summary["robots"].values())
    assert summary["team"]["coverage"] < 0.9
    assert summary["team"]["overlap"] == pytest.approx(sums - summary["team"]["coverage"], abs=1e-5)
    assert summary["team"]["overlap"] == 0 or robots > 1


def test_a_mind_that_breaks_leaves_a_run_directory(tmp_path: Path) -> None:
    class Broken(Wanderer):
        def step(self, observation, heard):  # type: ignore[no-untyped-def]
            if observation.tick == 7:
                raise RuntimeError("out of ideas")
            return super().step(observation, heard)

    with pytest.raises(RuntimeError, match="out of ideas"):
        inprocess.run(QUICK, MIND, tmp_path, make_mind=Broken)  # type: ignore[arg-type]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["robots"]["r1"]["ended"] == "interrupted"
    assert len((tmp_path / "trajectories" / "r1.tum").read_text().splitlines()) == 8


def test_a_world_that_cannot_be_run_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(WorldFileError):
        Episode(WorldConfig(world="atlantis"), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_part_that_only_others_saw_is_cut_out_of_the_own_map() -> None:
    ring = Wireframe(
        points=np.arange(10, dtype=float).reshape(5, 2),
        labels=np.zeros(5, np.uint8),
        edges=np.array([[0, 1], [1, 2], [2, 3], [3, 0]], np.int32),
        likelihood=np.full(4, 0.5, np.float32),
        own=np.array([False, False, True, True]),
    )
    own = own_part(ring)
    own.check()
    assert own.points.tolist() == ring.points[[0, 2, 3, 4]].tolist()  # the lonely vertex stays
    assert own.edges.tolist() == [[1, 2], [2, 0]]
    everything = own_part(replace(ring, own=np.ones(4, np.bool_)))
    assert np.array_equal(everything.edges, ring.edges)


def test_other_robots_and_lidars() -> None:
    spec = RobotSpec(radius_m=0.2)
    spec = spec.model_copy(update={"lidar": spec.lidar.model_copy(update={"beams": 90, "rate_hz": 10.0})})
    episode = Episode(QUICK.model_copy(update={"spec": spec}), None)
    assert episode.period_s == 0.1
    assert episode.inputs()["r1"].observation.scan().shape == (90,)
    for _ in range(10):
        episode.advance({robot: answer(episode.tick, speed=0.2) for robot in episode.robots})
    assert episode.t == 1.0
    assert np.hypot(*(episode.poses - episode.starts)[0, :2]) == pytest.approx(0.2, abs=0.01)


def test_a_path_is_as_long_with_a_slow_lidar() -> None:
    """It was that of straight lines from tick to tick, also where a robot drives a circle in one."""
    driven = []
    for rate_hz in (5.0, 1.0, 0.4):
        spec = {"lidar": {"rate_hz": rate_hz}}
        episode = Episode(WorldConfig.model_validate({"world": "apartment", "robots": 1, "spec": spec}), None)
        while episode.t < 5.0:
            episode.advance({"r1": answer(episode.tick, speed=0.2, turn=2.5)})
        driven.append(episode.paths["r1"])
    assert driven == pytest.approx([driven[0]] * 3, abs=0.01) and 0.95 < driven[0] < 1.0


def test_the_radio_is_set_in_one_place_only() -> None:
    with pytest.raises(ValueError, match=r"set these"):
        WorldConfig.model_validate({"spec": {"radio_range_m": 2.0}})
    episode = Episode(
        WorldConfig.model_validate({"world": "apartment", "radio": {"range_m": 2.0, "mtu_bytes": 100}}), None
    )
    spec = episode.welcome("r1").spec
    assert (spec.radio_range_m, spec.radio_mtu_bytes) == (2.0, 100)
