"""Robots whose processes die and come back: tick-exact, with their maps, and the same in both modes."""

import os
import threading
from collections import defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from agent.config import AgentConfig
from agent.robot import Robot
from agent.shell import checkpoint
from agent.shell.checkpoint import revived, save
from agent.shell.process import AgentInbox, Entry, Life
from agent.state import State
from deploy import inprocess
from deploy.config import load
from deploy.launch.faults import Doomed
from deploy.launch.launcher import launch
from protocol import keys
from protocol.codec import encode
from protocol.configuration import ConfigError
from protocol.files import UnwritableError
from protocol.inbox import Arrival
from protocol.messages import End, Heard, Observation
from tests.agent.shell.test_process import World, agent, events
from tests.deploy.launch.test_failures import Running, hold, running  # noqa: F401
from tests.tiny import digests, tiny_config
from tests.wanderer import Wanderer
from world.episode import Episode
from world.tick import Outputs

pytestmark = pytest.mark.system


@pytest.mark.parametrize("mind", [Wanderer, None], ids=["a mind that begins anew", "the robot, from its checkpoint"])
def test_a_fault_schedule_gives_the_same_bytes_in_processes_and_in_one(tmp_path: Path, mind: type | None) -> None:
    config = tiny_config(tmp_path, robots=2, until=11.0, faults=["r2@5", "r1@47", "r2@47", "r2@48"])
    inprocess.run(config, config.agent, tmp_path / "one", make_mind=mind)
    result = launch(config, tmp_path / "many", make_mind=mind)
    assert (result.status, len(result.errors)) == (0, 4)
    alone, many = digests(tmp_path / "one"), digests(tmp_path / "many")
    assert alone == {name: digest for name, digest in many.items() if not name.startswith("checkpoints/")}
    came = [(event["tick"], event["robot"], event["event"]) for event in events(tmp_path / "one")]
    both = [(47, "r1"), (47, "r2")]
    fates = [(5, "r2"), *both, (48, "r2")]
    assert [one for one in came if one[2] in ("left", "rejoined")] == [
        (tick, robot, word) for tick, robot in fates for word in ("left", "rejoined")
    ]


def test_a_fault_happens_though_a_late_robot_skips_its_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    killed: list[int] = []
    monkeypatch.setattr("os.kill", lambda process, signal: killed.append(stepped))
    mind = Doomed(MagicMock(), {5, 47, 60})
    for stepped in (5, 46, 49, 50):  # its first tick is that of its return
        mind.step(Observation(tick=stepped, ranges=b"", odometry=(0.0, 0.0, 0.0)), [])
    assert killed == [49]


def test_a_killed_process_is_started_again_and_its_robot_goes_on(running: Any, hold: Path) -> None:  # noqa: F811
    run: Running = running(mind="Held", until=120.0, restart=True)
    run.agents()[1].kill()
    hold.unlink()
    assert run.result()["status"] == 0
    assert [event["event"] for event in run.events() if event["event"] in ("left", "rejoined", "dead")] == [
        "left",
        "rejoined",
    ]
    assert len((run.out / "trajectories" / "r1.tum").read_text().splitlines()) == 601


def test_a_killed_world_is_started_again_and_no_byte_differs(
    running: Any,  # noqa: F811
    tmp_path: Path,
    hold: Path,  # noqa: F811
) -> None:
    run: Running = running(mind="Held", until=120.0, restart=True)
    run.world().kill()
    hold.unlink()
    result = run.result()
    assert (result["status"], result["errors"]) == (0, ["world: its process died (signal 9) and was started again"])
    inprocess.run(tiny_config(tmp_path, until=120.0), AgentConfig(), tmp_path / "alone", make_mind=Wanderer)
    assert digests(run.out).items() >= digests(tmp_path / "alone").items()


@pytest.mark.parametrize("real_time", [None, 20.0])
def test_a_late_robot_joins_a_running_world(tmp_path: Path, real_time: float | None) -> None:
    config = tiny_config(tmp_path, robots=2, until=7000.0, server={"begin_with": 1, "real_time": real_time})
    with World(config, tmp_path / "out") as world, ThreadPoolExecutor() as pool:
        first = pool.submit(agent, world, "r1", signalling(begun := threading.Event()))
        assert begun.wait(20)
        second = pool.submit(agent, world, "r2", signalling(late := threading.Event()))
        assert late.wait(20)
        world.inbox.stop()
        assert (first.result(10), second.result(10)) == ("interrupted", "interrupted")
    joined = [event for event in events(tmp_path / "out") if event["event"] in ("joined", "left", "dead")]
    assert [(event["robot"], event["event"]) for event in joined] == [("r2", "joined")] and joined[0]["tick"] > 0


def signalling(stepped: threading.Event) -> Callable[..., Wanderer]:
    """Wanderers that tell when they have answered some ticks."""

    class Signalling(Wanderer):
        def step(self, observation: Observation, heard: Sequence[Heard]) -> Any:
            self.steps = getattr(self, "steps", 0) + 1
            if self.steps > 3:
                stepped.set()
            return super().step(observation, heard)

    return Signalling


@pytest.fixture(scope="module")
def lived(tmp_path_factory: pytest.TempPathFactory) -> tuple[Robot, list[Observation]]:
    """A robot after 40 ticks in the tiny room, and what it saw; its odometry is noisy."""
    config = tiny_config(tmp_path_factory.mktemp("room"), robots=1, until=20.0, spec={"odometry": {"noisy": True}})
    episode, seen = Episode(config, None), []
    welcome = episode.welcome("r1")
    robot = Robot("r1", welcome.spec, AgentConfig(), welcome.seed)
    while episode.tick < 40:
        heard, observation = episode.inputs()["r1"]
        seen.append(observation)
        step = robot.step(observation, heard)
        episode.advance({"r1": Outputs(step.sends, step.action, step.map)})
    return robot, seen


def again(robot: Robot, folder: Path, run: str = "0" * 16, tick: int = 41) -> Robot:
    mind = revived(lambda: Robot("r1", robot.spec, robot.config, 1), folder, "r1", run, tick)
    assert isinstance(mind, Robot)
    return mind


def test_a_robot_goes_on_with_map_pose_and_viewpoints(lived: tuple[Robot, list[Observation]], tmp_path: Path) -> None:
    robot, seen = lived
    save(tmp_path, "r1", "0" * 16, 20, {"nothing": np.zeros(1)})
    save(tmp_path, "r1", "0" * 16, 40, robot.state())
    back = again(robot, tmp_path)
    assert back.filter.pose == robot.filter.pose and len(back.own.edges) > 4
    assert np.array_equal(back.own.points, robot.filter.wireframe().points)
    assert back.explorer.viewpoints.own == robot.explorer.viewpoints.own
    back.step(seen[-1].model_copy(update={"tick": 41}), [])
    assert np.hypot(*np.subtract(back.filter.pose, robot.filter.pose)[:2]) < 0.05
    assert len(again(robot, tmp_path, run="1" * 16).own.edges) == 0  # of another run
    assert len(again(robot, tmp_path, tick=40).own.edges) == 0  # of a tick to come


def broken_states(state: State) -> list[State]:
    wrong = [{name: values for name, values in state.items() if name != left} for left in state]
    wrong += [
        {**state, name: np.full_like(values, np.nan)}
        for name, values in state.items()
        if values.dtype == float and values.size
    ]
    wrong += [{**state, "counts": state["counts"] + 1000}, {**state, "counts": -state["counts"]}]
    wrong += [{**state, "edges": np.full_like(state["edges"], byte)} for byte in (1, 127, 255)]
    wrong += [{**state, "edges": state["edges"][:, :-1]}, {**state, "joint": -1.0 - state["joint"]}]
    return wrong


def test_a_broken_checkpoint_is_told_and_the_robot_begins_anew(
    lived: tuple[Robot, list[Observation]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot, _ = lived
    file, state = tmp_path / "r1.msgpack", robot.state()
    save(tmp_path, "r1", "0" * 16, 40, state)
    whole = file.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 0xFF
    for content in (b"", b"no archive", whole[:1000], bytes(flipped)):
        file.write_bytes(content)
        assert len(again(robot, tmp_path).own.edges) == 0
        assert "is no checkpoint" in capsys.readouterr().err
    for wrong in broken_states(state):
        save(tmp_path, "r1", "0" * 16, 40, wrong)
        (tmp_path / "r1.before.msgpack").unlink(missing_ok=True)
        assert len(again(robot, tmp_path).own.edges) == 0, sorted(state.keys() - wrong.keys())
        assert "is no checkpoint" in capsys.readouterr().err
    file.unlink()
    os.mkfifo(file)
    assert len(again(robot, tmp_path).own.edges) == 0
    assert "is no checkpoint (this is no file)" in capsys.readouterr().err


def test_a_run_does_not_wait_for_more_robots_than_take_part() -> None:
    """After a minute, the error that was to name who is missing had nobody to name."""
    assert load(sets=["robots=2", "server.begin_with=2"]).server.begin_with == 2
    with pytest.raises(ConfigError, match=r"server\.begin_with: 3 robots are more than the 2 that take part"):
        load(sets=["robots=2", "server.begin_with=3"])


def test_no_checkpoint_is_written_that_would_not_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoint, "MAX_BYTES", 1000)
    save(tmp_path, "r1", "0" * 16, 20, {"small": np.zeros(10)})
    kept = (tmp_path / "r1.msgpack").read_bytes()
    with pytest.raises(UnwritableError, match=r"the map is too large: \d+ bytes, of 1000 at most"):
        save(tmp_path, "r1", "0" * 16, 40, {"large": np.zeros(1000)})
    assert (tmp_path / "r1.msgpack").read_bytes() == kept


class OneByOne(AgentInbox):
    """Nothing more has come in when the next is taken."""

    def empty(self) -> bool:
        return True


@pytest.mark.parametrize("lockstep", [True, False])
def test_a_run_that_begins_again_is_another_run(tmp_path: Path, lockstep: bool) -> None:
    """In real time a robot took a new run of the same seed for the old one, and went on with its old map and pose."""
    episode = Episode(tiny_config(tmp_path, robots=1), None)
    welcome, (_, observation) = episode.welcome("r1", lockstep=lockstep), episode.inputs()["r1"]
    life, inbox = Life(Wanderer("r1", welcome.spec, AgentConfig(), 1), Entry(welcome, 0), "r1", None), OneByOne()
    assert life.goes_on(Entry(welcome, 0))
    inbox.put(Arrival(keys.OBS, payload=encode(observation.model_copy(update={"tick": 7}))))
    inbox.put(Arrival(keys.END, payload=encode(End(reason="time"))))
    assert life.live(defaultdict(MagicMock), inbox) == "time"
    assert not life.goes_on(Entry(welcome, 0))
    assert life.goes_on(Entry(welcome.model_copy(update={"tick": 7}), 0))
