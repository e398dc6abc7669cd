"""In real time the clock ends ticks; what the world itself misses, because it stood still, is held against no robot."""

import json
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from agent.config import AgentConfig
from agent.shell.process import run_agent
from protocol import keys
from protocol.codec import encode
from protocol.messages import PROTOCOL_VERSION, Join, Progress
from protocol.session import open_client
from tests.tiny import tiny_config
from tests.wanderer import Wanderer
from tests.world.shell.test_roll_call import world
from world.shell.inbox import WorldInbox

pytestmark = pytest.mark.system

STALL_S = 1.5


@contextmanager
def silent(endpoint: str, robot: str) -> Iterator[zenoh.Session]:
    """A robot that is ready and answers nothing, until its session ends."""
    with open_client(endpoint, 10.0) as session:
        question = encode(Join(version=PROTOCOL_VERSION, robot=robot, session=str(session.info.zid())))
        list(session.get(keys.service(robot, keys.JOIN), payload=question, timeout=10.0))
        session.declare_subscriber(keys.to_robot(robot), lambda sample: None)
        with session.liveliness().declare_token(keys.alive(robot)):
            yield session


class Stall:
    """Stands still, once."""

    def __init__(self) -> None:
        self.left_s = STALL_S

    def __call__(self) -> None:
        time.sleep(self.left_s)
        self.left_s = 0.0


def fates(out: Path, robot: str) -> list[tuple[str, int]]:
    """What happened to a robot's process, and at which ticks."""
    events = map(json.loads, (out / "events.jsonl").open())
    return [(event["event"], event["tick"]) for event in events if event["robot"] == robot and "peer" not in event]


@pytest.mark.parametrize("where", ["before it waits", "while it waits"])
def test_a_world_that_stood_still_does_not_hurry_its_robots(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    """The ticks that it missed were told at once, and robots that had no time for them were late."""
    stall, begun = Stall(), []

    def progress(now: Progress) -> None:
        if now.clock.tick > 5:
            begun.append(now)
            if where == "before it waits":
                stall()

    def take(inbox: WorldInbox, deadline: float) -> Any:
        if begun and where == "while it waits":
            stall()
        return taken(inbox, deadline)

    taken = WorldInbox.take
    monkeypatch.setattr(WorldInbox, "take", take)
    config = tiny_config(tmp_path, robots=1, until=8.0, server={"real_time": 8.0})
    with (
        world(config, tmp_path / "out", [], settle_s=None, progress=progress) as (endpoint, ended),
        ThreadPoolExecutor() as pool,
    ):
        pool.submit(run_agent, "r1", endpoint, AgentConfig(), make_mind=Wanderer)
        assert ended.result(20) == "time"
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert stall.left_s == 0.0 and summary["real_time_factor"] <= 8.0 / (1.0 + STALL_S) + 0.2


def test_a_robot_that_is_away_has_its_time_after_a_stall_of_the_world(tmp_path: Path) -> None:
    stall, begun = Stall(), threading.Event()

    def progress(now: Progress) -> None:
        begun.set()
        if now.clock.status["r2"] == "away":
            stall()

    config = tiny_config(tmp_path, robots=2, until=24.0, server={"real_time": 20.0, "silence_s": 0.5})
    with (
        world(config, tmp_path / "out", [], settle_s=None, progress=progress) as (endpoint, ended),
        ThreadPoolExecutor() as pool,
    ):
        pool.submit(run_agent, "r1", endpoint, AgentConfig(), make_mind=Wanderer)
        with silent(endpoint, "r2"):
            assert begun.wait(20)
        assert ended.result(20) == "time"
    (left, left_at), (dead, dead_at) = fates(tmp_path / "out", "r2")
    assert (stall.left_s, left, dead) == (0.0, "left", "dead")
    assert dead_at - left_at >= 0.5 / 0.01 - 1
    if sys.platform == "linux":  # elsewhere nothing is counted
        told = json.loads((tmp_path / "out" / "bandwidth.json").read_text())["wire"]["r2"]["to_robot"]
        assert told["messages"] <= 1.2 * (left_at + 1) + 2  # an observation a tick and each fifth tick what r1 says


def test_who_was_given_up_does_not_leave_as_well(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, robots=2, until=24.0, server={"real_time": 20.0})
    with world(config, tmp_path / "out", [], settle_s=None) as (endpoint, ended), ThreadPoolExecutor() as pool:
        pool.submit(run_agent, "r1", endpoint, AgentConfig(), make_mind=Wanderer)
        with silent(endpoint, "r2") as session:
            while '"dead"' not in (tmp_path / "out" / "events.jsonl").read_text():  # nobody hears it before the run
                session.put(keys.from_robot("r2", keys.ACT), b"no action")
                time.sleep(0.02)
        assert ended.result(20) == "time"
    assert [event for event, _ in fates(tmp_path / "out", "r2")] == ["dead"]
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["links_lost"] == 0
