"""A world that was started by hand leaves the run directory and the exit status of `wireswarm run`."""

import json
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from agent.config import AgentConfig
from agent.shell.mind import MakeMind
from agent.shell.process import run_agent
from deploy.launch.launcher import launch
from tests.tiny import digests, tiny_config
from tests.wanderer import Misbehaving, Wanderer

pytestmark = pytest.mark.system

REPO = Path(__file__).parents[2]
Futures = list[Future[str]]


@contextmanager
def by_hand(folder: Path, until: str, r2: MakeMind = Wanderer) -> Iterator[tuple[subprocess.Popen[str], Futures]]:
    """`wireswarm world` in the folder `hand`, and how three robots end that wander in it, r2 with a mind of its own."""
    tiny_config(folder)
    command = [sys.executable, "-m", "wireswarm", "world", "--world", "tiny.yaml", "--out", "hand", "--until", until]
    pipe = subprocess.PIPE
    world = subprocess.Popen(command, cwd=folder, env={"PYTHONPATH": str(REPO)}, stdout=pipe, stderr=pipe, text=True)
    assert world.stdout is not None
    endpoint = world.stdout.readline().split()[-1]
    with ThreadPoolExecutor() as pool:
        minds = {"r1": Wanderer, "r2": r2, "r3": Wanderer}.items()
        yield world, [pool.submit(run_agent, robot, endpoint, AgentConfig(), make_mind=mind) for robot, mind in minds]


def manifest(run: Path) -> dict[str, Any]:
    fields: dict[str, Any] = json.loads((run / "manifest.json").read_text())
    return fields


def test_a_world_by_hand_and_the_launcher_leave_the_same_run(tmp_path: Path) -> None:
    with by_hand(tmp_path, "6") as (world, ends):
        said, errors = world.communicate(timeout=60)
        assert [end.result(10) for end in ends] == ["time"] * 3
    assert (world.returncode, errors) == (0, "")
    assert "ended: time; hand" in said and "team" in said and said.rstrip().endswith("hand/report.html")
    hand, launched = tmp_path / "hand", tmp_path / "launched"
    assert launch(tiny_config(tmp_path, until=6.0), launched, make_mind=Wanderer).status == 0
    drawn = {"report.html", "report.png", "bandwidth.png"}  # by the command after its run
    assert {file.name for file in hand.iterdir()} == {file.name for file in launched.iterdir()} | drawn
    ours, theirs = digests(hand), digests(launched)
    for books in ("bandwidth.json", "bandwidth.png", "updates.jsonl"):  # to which the command adds other forms
        ours.pop(books, None), theirs.pop(books, None)
    assert ours == theirs
    one, other = manifest(hand), manifest(launched)
    assert one.keys() == other.keys()
    assert one["config"].keys() == other["config"].keys() - {"agent"}  # each robot has its own
    for field in ("version", "seed", "world_hash", "ended", "exit_status"):
        assert one[field] == other[field]


def test_a_robot_that_dies_by_hand_is_an_exit_status_of_the_world(tmp_path: Path) -> None:
    with by_hand(tmp_path, "complete", Misbehaving) as (world, ends):
        said, _ = world.communicate(timeout=60)
        r1, r2, r3 = [end.result(10) for end in ends]
    assert r1 == r3 == "complete" and r2.startswith("given up by the world")
    assert "dead" in said
    assert world.returncode == manifest(tmp_path / "hand")["exit_status"] == 3
