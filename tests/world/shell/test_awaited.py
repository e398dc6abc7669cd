"""Who is there before a run begins, and who is awaited, is told as it changes, and now and then."""

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from agent.config import AgentConfig
from agent.shell.process import run_agent
from tests.tiny import tiny_config
from tests.wanderer import Wanderer
from tests.world.shell.test_roll_call import world
from world.shell.gathering import AWAITED_S
from world.shell.participants import Awaited

TWENTY = "r1, r2, r3, r4, r5, r6, r7, r8 and 12 more are here, the run begins"


def test_a_world_says_who_is_here_and_who_is_awaited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("world.shell.gathering.AWAITED_S", AWAITED_S / 50)
    said: list[str] = []
    config = tiny_config(tmp_path, robots=2, until=1.0)
    more = {"settle_s": None, "awaited": lambda awaited: said.append(str(awaited))}
    with world(config, tmp_path / "out", [], **more) as (endpoint, ended), ThreadPoolExecutor() as pool:
        pool.submit(run_agent, "r1", endpoint, AgentConfig(), make_mind=Wanderer)
        while said.count("r1 is here, waiting for r2") < 3:
            assert not ended.done()
            time.sleep(0.01)
        pool.submit(run_agent, "r2", endpoint, AgentConfig(), make_mind=Wanderer)
        assert ended.result(20) == "time"
    assert said[-1] == "r1 and r2 are here, the run begins"


@pytest.mark.parametrize(
    ("awaited", "words"),
    [
        (Awaited([], [], ["r1", "r2"], 2), "nobody is here yet, waiting for r1 and r2"),
        (Awaited(["r1"], ["r2"], ["r3"], 2), "r1 is here, r2 prepares, waiting for r3"),
        (Awaited(["r1", "r2"], ["r3", "r4"], [], 2), "r1 and r2 are here, r3 and r4 prepare"),
        (Awaited(["r1"], [], ["r2", "r3"], 1), "r1 is here, waiting for 1 more, of r2 and r3"),
        (Awaited([f"r{k}" for k in range(1, 21)], [], [], 0), TWENTY),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_it_is_a_sentence(awaited: Awaited, words: str) -> None:
    assert str(awaited) == words
