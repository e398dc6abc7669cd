"""The shells around robot and episode: join, lockstep, real time, hostile bytes; and bytes equal to no shell at all."""

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import cycle
from pathlib import Path
from typing import Any

import pytest

from agent.config import AgentConfig, JoinConfig
from agent.shell.process import SILENT_WORLD, AgentInbox, Entry, join, run_agent
from deploy import inprocess
from deploy.config import RunConfig
from deploy.launch.launcher import launch
from protocol import keys
from protocol.access import Credentials
from protocol.codec import MAX_MESSAGE_BYTES, decode, encode
from protocol.errors import InputError, LinkError, RefusedError
from protocol.inbox import Arrival
from protocol.messages import MAX_TEXT, PROTOCOL_VERSION, End, Join, Refused
from protocol.session import open_client, open_router
from tests.tiny import digests, tiny_config
from tests.wanderer import Sleeper, Wanderer, endless
from world.shell.inbox import WorldInbox
from world.shell.server import serve
from world.shell.shell import Shell

pytestmark = pytest.mark.system

JOIN_S = 20.0


class World:
    """A world server in a thread; robots join it from this process or others."""

    def __init__(self, config: RunConfig, out: Path, credentials: Credentials | None = None) -> None:
        self.credentials = credentials
        self.inbox = WorldInbox()
        self.endpoint: Future[str] = Future()
        self.ended: Future[str] = Future()
        self.thread = threading.Thread(target=self._serve, args=(config, out))
        self.thread.start()

    def _serve(self, config: RunConfig, out: Path) -> None:
        try:
            listening = self.endpoint.set_result
            ended = serve(
                config, config.server, out, credentials=self.credentials, inbox=self.inbox, listening=listening
            )
            self.ended.set_result(ended)
        except BaseException as error:
            self.ended.set_exception(error)

    def __enter__(self) -> "World":
        return self

    def __exit__(self, *_: object) -> None:
        self.inbox.stop()
        self.thread.join(10)
        assert not self.thread.is_alive()


def agent(world: World, robot: str, factory: Callable[..., Any] = endless, **more: Any) -> str:
    return run_agent(robot, world.endpoint.result(JOIN_S), AgentConfig(), make_mind=factory, **more)


def events(out: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (out / "events.jsonl").read_text().splitlines()]


def test_processes_write_the_same_bytes_as_one_process_without_zenoh(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, until="complete", seed=3)
    inprocess.run(config, config.agent, tmp_path / "one", make_mind=Wanderer)
    result = launch(config, tmp_path / "many", make_mind=Wanderer)
    assert (result.status, result.ended, result.errors) == (0, "complete", [])
    alone = digests(tmp_path / "one")
    assert alone == digests(tmp_path / "many")
    assert {"maps/r1.json", "events.jsonl", "trajectories/r3.tum", "radio.csv"} <= alone.keys()
    assert len(events(tmp_path / "one")) >= 50  # they heard each other
    one, many = (json.loads((tmp_path / name / "manifest.json").read_text()) for name in ("one", "many"))
    assert {"version", "command_line", "config", "seed", "world_hash", "start", "end", "ended"} <= many.keys()
    assert RunConfig.model_validate(many["config"]) == config
    clock = {"start", "end", "exit_status"}
    assert {key: one[key] for key in one.keys() - clock} == {key: many[key] for key in many.keys() - clock}


def test_two_runs_at_once(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("a", "b")]
    runs = []
    for folder in folders:
        folder.mkdir()
        command = [sys.executable, "-m", "tests.launch_tiny", str(folder), "Wanderer", '{"until": "complete"}']
        runs.append(subprocess.Popen(command, cwd=Path(__file__).parents[3], stdout=subprocess.DEVNULL))
    assert [run.wait(30) for run in runs] == [0, 0]
    one, other = (digests(folder / "out") for folder in folders)
    assert one == other


def test_the_world_waits_for_all_and_lets_each_name_in_once(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, robots=2, until=4.0)
    with World(config, tmp_path / "out") as world, ThreadPoolExecutor() as pool:
        first = pool.submit(agent, world, "r1", patience=JoinConfig(reconnect_s=0.1))
        with open_client(world.endpoint.result(JOIN_S), JOIN_S) as session:
            while not any(reply.ok for reply in session.liveliness().get(keys.alive("r1"))):  # on a busy machine
                time.sleep(0.05)
        time.sleep(0.7)  # longer than reconnect_s: a world that is alive but waits is waited for
        with pytest.raises(RefusedError, match="another r1 is there already"):
            agent(world, "r1")
        with pytest.raises(RefusedError, match="no r7 takes part, only r1 and r2"):
            agent(world, "r7")
        with open_client(world.endpoint.result(JOIN_S), JOIN_S) as session:
            assert "version 99" in refusal(session, "r2", Join(version=99, robot="r2"))
            assert "says that it is r1" in refusal(session, "r2", Join(version=PROTOCOL_VERSION, robot="r1"))
            assert "no msgpack" in refusal(session, "r2", b"\xc1")
        assert not first.done()
        second = pool.submit(agent, world, "r2")
        assert (first.result(10), second.result(10), world.ended.result(10)) == ("time", "time", "time")
    assert [event for event in events(tmp_path / "out") if event["event"] == "dead"] == []


def refusal(session: Any, robot: str, question: Join | bytes) -> str:
    payload = question if isinstance(question, bytes) else encode(question)
    (reply,) = session.get(keys.service(robot, keys.JOIN), payload=payload)
    return decode(Refused, reply.err.payload.to_bytes()).reason


def test_no_question_of_a_robot_stops_the_world(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, robots=1, until=2.0)
    with World(config, tmp_path / "out") as world:
        with open_client(world.endpoint.result(JOIN_S), JOIN_S) as session:
            for word in (WorldInbox.STOP, WorldInbox.GONE, "x" * MAX_TEXT):
                replies = list(session.get(keys.service("r1", word), payload=b"", timeout=5.0))
                assert "offers no such service" in decode(Refused, replies[0].err.payload.to_bytes()).reason
        assert agent(world, "r1") == "time"


def test_a_robot_that_leaves_before_the_start_may_come_again(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, robots=2, until=2.0)
    with World(config, tmp_path / "out") as world, ThreadPoolExecutor() as pool:
        inbox = AgentInbox()
        leaves = pool.submit(agent, world, "r1", inbox=inbox)
        time.sleep(0.5)
        inbox.stop()
        assert leaves.result(5) == "interrupted"
        time.sleep(0.2)
        both = [pool.submit(agent, world, robot) for robot in ("r1", "r2")]
        assert [one.result(10) for one in both] == ["time", "time"]


def test_a_robot_that_outlives_its_world_loses_no_link_in_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It kept its token while it asked the next world, which began with it, and lost it as it began anew."""
    with open_router() as (_, endpoint):
        pass
    config = tiny_config(tmp_path, robots=1, until=2.0, server={"listen": endpoint})
    with ThreadPoolExecutor() as pool:
        with monkeypatch.context() as dies, World(config.model_copy(update={"until": 1e6}), tmp_path / "one") as world:
            dies.setattr(Shell, "_take_leave", lambda *_: None)  # it says nothing more
            lives = pool.submit(agent, world, "r1")
            world.endpoint.result(JOIN_S)
            while not (tmp_path / "one" / "trajectories" / "r1.tum").stat().st_size:
                time.sleep(0.01)
            world.inbox.stop()
            world.ended.result(10)
        with World(config, tmp_path / "other") as world:
            assert (lives.result(JOIN_S), world.ended.result(JOIN_S)) == ("time", "time")
    assert events(tmp_path / "other") == []
    assert json.loads((tmp_path / "other" / "summary.json").read_text())["links_lost"] == 0


def test_a_robot_asks_again_where_the_world_changed_while_it_asked(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, robots=1, until=2.0)
    with World(config, tmp_path / "out") as world, open_client(world.endpoint.result(JOIN_S), JOIN_S) as session:
        inbox = AgentInbox()
        inbox.world_up, asked = True, []

        class Between:
            """A session of a robot whose world came back before its first question was answered."""

            info = session.info

            def get(self, *question: Any, **more: Any) -> Any:
                asked.append(question)
                inbox.world_changes += 2 * (len(asked) == 1)
                return session.get(*question, **more)

        joined = join(Between(), "r1", inbox, 5.0)  # type: ignore[arg-type]
        assert isinstance(joined, Entry) and joined.changes == inbox.world_changes == 2
        assert len(asked) == 2  # and the second time it was let in again
        assert "another r1 is there already" in refusal(session, "r1", Join(version=PROTOCOL_VERSION, robot="r1"))


def test_the_last_word_of_a_world_counts_after_its_end() -> None:
    with open_router() as (session, _):  # a world without a token is none
        inbox = AgentInbox()
        inbox.put(Arrival(keys.OBS, payload=b"late"))
        inbox.put(Arrival(keys.END, payload=encode(End(reason="time"))))
        assert join(session, "r1", inbox, 0.1) == "time"
        with pytest.raises(LinkError, match=r"does not answer r1 for 0\.1 s"):
            join(session, "r1", inbox, 0.1)
        inbox.stop()
        assert join(session, "r1", inbox, 0.1) == "interrupted"


def test_of_a_world_that_is_there_and_does_not_answer_a_robot_says_so_once(capsys: pytest.CaptureFixture[str]) -> None:
    """A router that began before the robot's certificate was made passes on no question: it waited in silence."""
    with open_router() as (session, _):
        inbox = AgentInbox()
        inbox.world_up = True
        threading.Timer(0.7, inbox.stop).start()
        assert join(session, "r1", inbox, 0.2) == "interrupted"
    assert capsys.readouterr().err == f"r1: {SILENT_WORLD}\n"


@pytest.mark.parametrize("real_time", [None, 40.0])
def test_a_system_clock_that_jumps_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, real_time: float | None
) -> None:
    jumps = cycle((1e9, -1e9, 3600.0, -1.0))
    monkeypatch.setattr(time, "time", lambda: 1.7e9 + next(jumps))
    monkeypatch.setattr(time, "time_ns", lambda: int(1e9 * (1.7e9 + next(jumps))))
    config = tiny_config(tmp_path, robots=2, until=4.0, server={"real_time": real_time})
    began = time.monotonic()
    with World(config, tmp_path / "out") as world, ThreadPoolExecutor() as pool:
        both = [pool.submit(agent, world, robot) for robot in ("r1", "r2")]
        assert [one.result(15) for one in both] == ["time", "time"]
    assert real_time is None or time.monotonic() - began > 4.0 / real_time
    assert {event["event"] for event in events(tmp_path / "out")} <= {"contact"}
    if real_time is None:
        inprocess.run(config, config.agent, tmp_path / "one", make_mind=endless)
        assert digests(tmp_path / "out") == digests(tmp_path / "one")


def test_missing_robots_are_named(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, server={"join_timeout_s": 1.0})
    with World(config, tmp_path / "out") as world, ThreadPoolExecutor() as pool:
        alone = pool.submit(agent, world, "r2")
        with pytest.raises(LinkError, match=r"r1, r3 did not join within 1 s: .* --id r1 --connect tcp/127"):
            world.ended.result(10)
        assert alone.result(5) == "interrupted"


@pytest.mark.parametrize(
    ("channel", "payload", "words"),
    [
        (keys.ACT, b"\xc1 no action", "no msgpack where a Action was due"),
        (keys.MAP, encode(Join(version=1, robot="r2")), "a bad MapReport"),
        (keys.RADIO, b"\xc0" * (MAX_MESSAGE_BYTES + 1), "at most"),
    ],
)
def test_bad_bytes_cost_the_robot_its_place_and_nobody_else(
    tmp_path: Path, channel: str, payload: bytes, words: str
) -> None:
    config = tiny_config(tmp_path, robots=2, until=7000.0)
    with World(config, tmp_path / "out") as world, ThreadPoolExecutor() as pool:
        good, bad = (pool.submit(agent, world, robot) for robot in ("r1", "r2"))
        with open_client(world.endpoint.result(JOIN_S), JOIN_S) as session:
            for _ in range(200):  # what comes before the run is nobody's
                session.put(keys.from_robot("r2", channel), payload)
                if bad.done():
                    break
                time.sleep(0.1)
            assert bad.result(10).startswith("given up by the world:")
        world.inbox.stop()
        assert good.result(10) == "interrupted"
    (dead,) = [event for event in events(tmp_path / "out") if event["event"] == "dead"]
    assert dead["robot"] == "r2" and words in dead["reason"]


def test_in_real_time_a_late_robot_misses_ticks_and_the_world_keeps_time(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, robots=2, until=8.0, server={"real_time": 4.0})
    with World(config, tmp_path / "out") as world, ThreadPoolExecutor() as pool:
        both = [pool.submit(agent, world, robot, Sleeper) for robot in ("r1", "r2")]
        assert [one.result(15) for one in both] == ["time", "time"]
        world.ended.result(5)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["real_time_factor"] == pytest.approx(4.0, rel=0.05)
    # r2 needs 2.5 periods of 50 ms; r1 is late only where this machine is
    assert 35 <= summary["late_ticks"] <= 60
    path = {robot: fields["path_m"] for robot, fields in summary["robots"].items()}
    assert 0 < path["r2"] < path["r1"]


def test_an_agent_without_a_world_says_what_to_check() -> None:
    began = time.monotonic()
    with pytest.raises(LinkError, match=r"no world answers at tcp/127\.0\.0\.1:1 .* check"):
        run_agent("r1", "tcp/127.0.0.1:1", AgentConfig(), patience=JoinConfig(join_timeout_s=0.3), make_mind=endless)
    with pytest.raises(InputError, match="write it like"):
        run_agent("r1", "localhost", AgentConfig(), make_mind=endless)
    with open_router() as (_, endpoint), pytest.raises(LinkError, match="does not answer r1"):
        run_agent("r1", endpoint, AgentConfig(), patience=JoinConfig(join_timeout_s=0.3), make_mind=endless)
    assert time.monotonic() - began < 5


def test_a_taken_port_is_one_sentence() -> None:
    with open_router() as (_, endpoint), pytest.raises(InputError, match="in use"), open_router(endpoint):
        pass


def test_the_agent_imports_neither_physics_nor_pictures() -> None:
    code = "import sys, agent.shell.process, agent.robot; print(*sorted(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in done.stdout.split()}
    assert loaded & {"agent", "protocol", "zenoh"} == {"agent", "protocol", "zenoh"}
    assert not loaded & {"world", "deploy", "pymunk", "matplotlib", "rich"}


def test_the_real_robot_in_processes_writes_the_same_bytes_as_in_one(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, robots=2, until=6.0)
    inprocess.run(config, config.agent, tmp_path / "one")
    result = launch(config, tmp_path / "many")
    assert (result.status, result.errors) == (0, [])
    alone = digests(tmp_path / "one")
    assert alone == digests(tmp_path / "many")
    assert json.loads((tmp_path / "one" / "maps" / "r1.json").read_text())["edges"]


def test_a_robot_that_floods_the_world_is_given_up_and_the_others_go_on(tmp_path: Path) -> None:
    begun = threading.Event()

    def mind(*which: Any) -> Wanderer:
        begun.set()
        return endless(*which)

    with World(tiny_config(tmp_path, robots=2, until=60.0), tmp_path / "out") as world, ThreadPoolExecutor() as pool:
        robots = [pool.submit(agent, world, robot, mind) for robot in ("r1", "r2")]
        assert begun.wait(JOIN_S)
        while not (tmp_path / "out" / "trajectories" / "r1.tum").stat().st_size:
            time.sleep(0.01)
        world.inbox.put(Arrival(world.inbox.FLOOD, "r2"))
        assert robots[0].result(30) == "time"
        assert "waited for the world" in robots[1].result(10)
    assert [event["robot"] for event in events(tmp_path / "out") if event["event"] == "dead"] == ["r2"]


@pytest.mark.parametrize(("real_time", "checkpoints"), [(None, None), (None, "checkpoints"), (50.0, None)])
def test_a_robot_that_is_stopped_by_hand_takes_its_leave_and_the_others_go_on(
    tmp_path: Path, real_time: float | None, checkpoints: str | None
) -> None:
    config = tiny_config(tmp_path, robots=2, until=60.0, server={"real_time": real_time})
    kept = checkpoints and tmp_path / checkpoints  # for nothing, as a Wanderer tells no state
    inbox, begun = AgentInbox(), threading.Event()

    class Noted(Wanderer):
        def step(self, *seen: Any) -> Any:
            begun.set()
            return super().step(*seen)

    with World(config, tmp_path / "out") as world, ThreadPoolExecutor() as pool:
        stays = pool.submit(agent, world, "r1")
        leaves = pool.submit(agent, world, "r2", Noted, inbox=inbox, by_hand=True, checkpoints=kept)
        assert begun.wait(JOIN_S)
        inbox.stop()
        assert leaves.result(10) == "interrupted"
        assert (stays.result(30), world.ended.result(10)) == ("time", "time")  # it waits 300 s for one that is away
    assert [event["reason"] for event in events(tmp_path / "out") if event["event"] == "dead"] == ["it took its leave"]


def test_only_the_process_that_was_let_in_can_take_its_leave(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, robots=1, until=4.0)
    with World(config, tmp_path / "out") as world, ThreadPoolExecutor() as pool:
        with open_client(world.endpoint.result(JOIN_S), JOIN_S) as session:
            said = encode(Join(version=PROTOCOL_VERSION, robot="r1", session="0a", process="0b"))
            for payload in (said, b"no message"):
                (reply,) = session.get(keys.service("r1", keys.LEAVE), payload=payload, timeout=5.0)
                assert reply.err is not None and decode(Refused, reply.err.payload.to_bytes()).reason
        assert pool.submit(agent, world, "r1").result(JOIN_S) == "time"
