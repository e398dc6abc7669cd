"""A world for as many robots as come, such as copies of a container."""

import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest

from agent.config import AgentConfig, JoinConfig
from agent.shell.process import AgentInbox, run_agent
from deploy import inprocess
from deploy.config import RunConfig
from protocol import keys
from protocol.codec import decode, encode
from protocol.errors import LinkError, RefusedError
from protocol.messages import PROTOCOL_VERSION, Join, Refused
from protocol.secrets import new_secrets
from protocol.session import open_client
from tests.tiny import digests, tiny_config
from tests.wanderer import Wanderer
from world.config import WorldConfig
from world.shell.inbox import WorldInbox
from world.shell.server import serve

pytestmark = pytest.mark.system


@contextmanager
def world(config: RunConfig, out: Path, counted: list[int], **more: object) -> Iterator[tuple[str, Future[str]]]:
    """A world that begins a second after the last robot has come: its endpoint, and how it ends."""
    inbox, endpoint, ended = WorldInbox(), Future[str](), Future[str]()

    def note(config: WorldConfig) -> None:
        counted.append(config.robots)

    def run() -> None:
        try:
            more_ = {"settle_s": 1.0, "counted": note, "listening": endpoint.set_result} | more
            ended.set_result(serve(config, config.server, out, inbox=inbox, **more_))  # type: ignore[arg-type]
        except BaseException as error:
            ended.set_exception(error)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield endpoint.result(10), ended
    finally:
        inbox.stop()
        thread.join(10)


def test_a_run_is_for_those_who_come_and_as_if_for_so_many_from_the_start(tmp_path: Path) -> None:
    server = {"begin_with": 5, "join_timeout_s": 5.0}  # more than come
    config, counted = tiny_config(tmp_path, robots=8, until=4.0, server=server), list[int]()
    secrets = new_secrets(config.robot_ids)
    with (
        world(config, tmp_path / "out", counted, credentials=secrets) as (endpoint, ended),
        ThreadPoolExecutor() as pool,
    ):
        live = partial(run_agent, None, endpoint, AgentConfig(), credentials=secrets, make_mind=Wanderer)
        assert [robot.result(20) for robot in [pool.submit(live) for _ in range(3)]] == ["time"] * 3
        assert (ended.result(10), counted) == ("time", [3])
    three = tiny_config(tmp_path, robots=3, until=4.0)
    inprocess.run(three, three.agent, tmp_path / "three", make_mind=Wanderer)
    assert digests(tmp_path / "out") == digests(tmp_path / "three")


def test_who_comes_when_the_run_has_begun_is_told_so(tmp_path: Path) -> None:
    config, counted = tiny_config(tmp_path, robots=8, until="complete"), list[int]()
    with world(config, tmp_path / "out", counted) as (endpoint, _), ThreadPoolExecutor() as pool:
        pool.submit(run_agent, "r1", endpoint, AgentConfig(), make_mind=Wanderer)
        while not counted:
            time.sleep(0.01)
        with pytest.raises(RefusedError, match="no r2 takes part, only r1"):
            run_agent("r2", endpoint, AgentConfig(), make_mind=Wanderer)


def test_a_missing_name_before_others_is_waited_for(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, robots=8, server={"join_timeout_s": 3.0})
    with world(config, tmp_path / "out", []) as (endpoint, ended), ThreadPoolExecutor() as pool:
        patience = JoinConfig(join_timeout_s=2.0)
        second = pool.submit(run_agent, "r2", endpoint, AgentConfig(), patience=patience, make_mind=Wanderer)
        with pytest.raises(LinkError, match="r1 did not join within 3 s"):
            ended.result(20)
        assert isinstance(second.exception(20), LinkError)


def test_a_world_that_is_stopped_while_it_counts_is_interrupted(tmp_path: Path) -> None:
    with world(tiny_config(tmp_path), tmp_path / "out", []) as (_, ended):
        pass
    assert ended.result(0) == "interrupted"


def test_a_robot_that_waits_for_a_run_to_begin_leaves_when_it_is_asked(tmp_path: Path) -> None:
    with (
        world(tiny_config(tmp_path), tmp_path / "out", [], settle_s=60.0) as (endpoint, _),
        ThreadPoolExecutor() as pool,
    ):
        inbox = AgentInbox()
        robot = pool.submit(run_agent, "r1", endpoint, AgentConfig(), make_mind=Wanderer, inbox=inbox)
        while not inbox.robot:
            time.sleep(0.01)
        time.sleep(0.5)
        inbox.stop()
        assert robot.result(2) == "interrupted"


def test_a_robot_waits_for_a_world_that_counts_longer_than_it_looks_for_one(tmp_path: Path) -> None:
    config, counted = tiny_config(tmp_path, until=1.0), list[int]()
    with world(config, tmp_path / "out", counted) as (endpoint, ended), ThreadPoolExecutor() as pool:
        patience = JoinConfig(join_timeout_s=0.2)
        robot = pool.submit(run_agent, "r1", endpoint, AgentConfig(), patience=patience, make_mind=Wanderer)
        assert (robot.result(20), ended.result(20), counted) == ("time", "time", [1])


@pytest.mark.parametrize("says_so", [True, False])
def test_who_has_gone_again_is_not_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, says_so: bool) -> None:
    monkeypatch.setattr("world.shell.roll_call.SILENT_S", 0.8)
    config, counted = tiny_config(tmp_path, until=1.0), list[int]()
    with world(config, tmp_path / "out", counted, settle_s=1.5) as (endpoint, ended), ThreadPoolExecutor() as pool:
        stays = pool.submit(run_agent, "r1", endpoint, AgentConfig(), make_mind=Wanderer)
        with open_client(endpoint, 10.0) as session:
            question = encode(Join(version=PROTOCOL_VERSION, robot="r2"))
            for service in (keys.JOIN, keys.LEAVE)[: 1 + says_so]:
                list(session.get(keys.service("r2", service), payload=question, timeout=5.0))
        assert (stays.result(20), ended.result(20), counted) == ("time", "time", [1])


def test_who_cannot_take_part_is_told_so_at_once_and_not_counted(tmp_path: Path) -> None:
    with world(tiny_config(tmp_path), tmp_path / "out", counted := [], settle_s=0.2) as (endpoint, ended):
        with pytest.raises(RefusedError, match="no r9 takes part, only r1, r2 and r3"):
            run_agent("r9", endpoint, AgentConfig(), make_mind=Wanderer)
        with open_client(endpoint, 10.0) as session:
            for word in (keys.LEAVE, "else"):
                (reply,) = session.get(keys.service("r1", word), payload=b"", timeout=5.0)
                assert reply.err is not None and decode(Refused, reply.err.payload.to_bytes()).reason
        with pytest.raises(TimeoutError):
            ended.result(0.5)
    assert not counted
