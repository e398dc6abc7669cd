"""What happens when a process dies: noticed at once, the others go on, nothing is left behind."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import pytest

from agent.config import AgentConfig, JoinConfig
from agent.shell.process import run_agent
from deploy import inprocess
from deploy.bandwidth.books import read_books
from protocol.session import open_router
from tests.disturbed import BUSY
from tests.tiny import ROOM, digests, tiny_config
from tests.wanderer import Wanderer, endless

pytestmark = pytest.mark.system

REPO = Path(__file__).parents[3]


class Running:
    """A launcher and its children."""

    def __init__(self, folder: Path, mind: str = "endless", **settings: object) -> None:
        self.out = folder / "out"
        self.popen = subprocess.Popen(
            [sys.executable, "-m", "tests.launch_tiny", str(folder), mind, json.dumps(settings)],
            cwd=REPO,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C goes to a process group
        )
        self.launcher = psutil.Process(self.popen.pid)
        self.wait_for(lambda line: line["clock"]["tick"] > 20)
        self.all = [self.launcher, *self.launcher.children(recursive=True)]

    def line(self) -> dict[str, Any]:
        assert self.popen.stdout is not None
        text = self.popen.stdout.readline()
        if not text:
            raise EOFError(self.popen.communicate()[1])
        line: dict[str, Any] = json.loads(text)
        return line

    def wait_for(self, condition: Any) -> None:
        while not condition(self.line()):
            pass

    def result(self) -> dict[str, Any]:
        while "errors" not in (line := self.line()):
            pass
        assert self.popen.wait(10) == line["status"]
        return line

    def world(self) -> psutil.Process:
        (world,) = [process for process in self.all if _listens(process)]
        return world

    def agents(self) -> list[psutil.Process]:
        return [process for process in self.all if _links(process) and not _listens(process)]

    def gone_within(self, seconds: float) -> bool:
        return not psutil.wait_procs(self.all, timeout=seconds)[1]

    def events(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in (self.out / "events.jsonl").read_text().splitlines()]


def _links(process: psutil.Process) -> set[str]:
    """States of a process's sockets; none where it has just ended, as helpers of the start do."""
    with suppress(psutil.NoSuchProcess):
        return {connection.status for connection in process.net_connections("tcp")}
    return set()


def _listens(process: psutil.Process) -> bool:
    return psutil.CONN_LISTEN in _links(process)


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Any]:
    started: list[Running] = []

    def start(**settings: object) -> Running:
        started.append(Running(tmp_path, **settings))  # type: ignore[arg-type]
        return started[-1]

    yield start
    for run in started:
        for process in run.all:
            if process.is_running():
                process.kill()
        run.popen.communicate()


def dead(line: dict[str, Any]) -> int:
    return list(line["clock"]["status"].values()).count("dead")


def test_dead_robots_are_noticed_within_a_second_and_the_others_finish(running: Any) -> None:
    run = running(until=200.0)
    for count, victim in enumerate(run.agents()[:2], start=1):
        began = time.monotonic()
        victim.kill()
        run.wait_for(lambda line, count=count: dead(line) == count)
        assert time.monotonic() - began < 1.0 * BUSY
    result = run.result()
    assert (result["status"], result["ended"]) == (3, "time")
    reasons = [event["reason"] for event in run.events() if event["event"] == "dead"]
    assert reasons == ["its process ended"] * 2
    ended = [robot["ended"] for robot in json.loads((run.out / "summary.json").read_text())["robots"].values()]
    assert sorted(ended) == ["dead", "dead", "time"]
    assert run.gone_within(5)


def test_robots_look_for_a_slow_world_as_long_as_it_waits_for_them(running: Any) -> None:
    run = running(until=5.0, join_timeout_s=1e-3)
    assert run.result() == {"status": 0, "ended": "time", "errors": []}


def test_without_a_world_the_run_ends_at_once(running: Any) -> None:
    run = running(until=7000.0)
    agents = run.agents()
    run.world().kill()
    assert not psutil.wait_procs(agents, timeout=5.0)[1]
    result = run.result()
    assert result["status"] == 1
    assert result["errors"] == ["world: its process died (signal 9)"]
    told = json.loads((run.out / "manifest.json").read_text())
    assert (told["exit_status"], told["ended"], told["errors"]) == (1, "interrupted", result["errors"])
    assert run.gone_within(5)
    robots = json.loads((run.out / "summary.json").read_text())["robots"]
    assert [robot["ended"] for robot in robots.values()] == ["interrupted"] * len(agents)
    read_books(run.out)  # raises where they do not balance


@pytest.mark.slow
def test_a_run_that_lost_its_world_and_cannot_be_finished_says_both(running: Any) -> None:
    run = running(until=7000.0)
    (run.out / "world.yaml").write_text("[")
    run.world().kill()
    result = run.result()
    assert (result["status"], result["ended"]) == (1, "interrupted")
    died, unfinished = result["errors"]
    assert died == "world: its process died (signal 9)"
    assert unfinished.startswith(f"{run.out / 'world.yaml'}: no YAML")
    told = json.loads((run.out / "manifest.json").read_text())
    assert (told["exit_status"], told["ended"], told["errors"]) == (1, "interrupted", result["errors"])


@pytest.fixture
def hold(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file that keeps the robots of tests.wanderer.Held slow while it is there."""
    file = tmp_path / "hold"
    file.touch()
    monkeypatch.setenv("HOLD", str(file))
    return file


@pytest.mark.parametrize("pause_s", [1.0, *(pytest.param(s, marks=pytest.mark.slow) for s in (0.3, 5.5, 30.0))])
def test_a_pause_of_any_process_changes_no_byte_in_lockstep(
    running: Any, tmp_path: Path, pause_s: float, hold: Path
) -> None:
    run = running(mind="Held", until=120.0, reconnect_s=0.1)  # a robot of a launcher waits for longer
    for process in (run.world(), run.agents()[1]):
        process.suspend()
        time.sleep(pause_s)
        process.resume()
        tick = run.line()["clock"]["tick"]
        run.wait_for(lambda line, tick=tick: line["clock"]["tick"] > tick + 5)
    hold.unlink()
    assert run.result()["status"] == 0
    inprocess.run(tiny_config(tmp_path, until=120.0), AgentConfig(), tmp_path / "alone", make_mind=Wanderer)
    assert digests(run.out) == digests(tmp_path / "alone")


def test_without_a_launcher_every_process_ends_within_five_seconds(running: Any) -> None:
    run = running(until=7000.0)
    assert (run.out / "viewer.json").exists()
    run.launcher.kill()
    run.popen.wait()
    assert run.gone_within(5)
    assert not (run.out / "viewer.json").exists()
    assert {robot["ended"] for robot in json.loads((run.out / "summary.json").read_text())["robots"].values()} == {
        "interrupted"
    }


def test_ctrl_c_writes_the_run_directory_and_leaves_nothing(running: Any) -> None:
    run = running(until=7000.0)
    os.killpg(run.popen.pid, signal.SIGINT)
    result = run.result()
    assert (result["status"], result["ended"], result["errors"]) == (130, "interrupted", [])
    assert run.gone_within(5)
    assert json.loads((run.out / "manifest.json").read_text())["ended"] == "interrupted"
    assert (run.out / "maps" / "r1.json").exists()
    assert run.popen.communicate()[1] == ""


def launched(folder: Path, mind: str, robots: int, **more: Any) -> Any:
    """The launcher's result of a run of 10 s."""
    settings = json.dumps({"robots": robots, "until": 10.0} | more)
    command = [sys.executable, "-m", "tests.launch_tiny", str(folder), mind, settings]
    done = subprocess.run(command, cwd=REPO, capture_output=True, text=True, timeout=30, check=False)
    return json.loads(done.stdout.splitlines()[-1])


def test_robots_that_misbehave_are_given_up_each_with_its_reason(tmp_path: Path) -> None:
    result = launched(tmp_path, "Misbehaving", 4)
    assert (result["status"], result["ended"]) == (3, "time")
    liar, crasher, suicide = sorted(result["errors"])
    assert liar.startswith("r2: given up by the world: an action of tick 4")
    log = tmp_path / "out" / "logs" / "r3.log"
    mistake = "r3: stopped by a mistake in its program: ZeroDivisionError: as promised"
    assert crasher == f"{mistake}; what it said is in {log}"
    assert "in step\n" in log.read_text() and log.read_text().endswith("ZeroDivisionError: as promised\n")
    assert suicide == "r4: its process died (signal 9)"
    assert [file.name for file in log.parent.iterdir()] == ["r3.log"]  # the others said nothing
    events = [json.loads(line) for line in (tmp_path / "out" / "events.jsonl").read_text().splitlines()]
    assert [event["robot"] for event in events if event["event"] == "dead"] == ["r2", "r3", "r4"]


def test_a_robot_that_never_joins_ends_the_run_at_once(tmp_path: Path) -> None:
    result = launched(tmp_path, "stillborn", 2)  # the world alone would wait 60 s for them
    assert result["status"] == 1
    assert set(result["errors"]) >= {f"r{k}: its process died (exit status 7)" for k in (1, 2)}


def test_a_robot_that_fails_before_the_others_begin_ends_nothing(tmp_path: Path) -> None:
    """It ended the run, but not where it failed a moment later."""
    result = launched(tmp_path, "lame", 3, server={"begin_with": 2})
    assert (result["status"], result["ended"], len(result["errors"])) == (3, "time", 1)
    events = [json.loads(line) for line in (tmp_path / "out" / "events.jsonl").read_text().splitlines()]
    dead = [(event["robot"], event["reason"]) for event in events if event["event"] == "dead"]
    assert dead == [("r3", "its process ended")]


def test_robots_that_fail_at_once_end_a_run_that_cannot_begin_without_them(tmp_path: Path) -> None:
    """Each was counted for the other until its pipe closed, and the world waited join_timeout_s, 60 s."""
    result = launched(tmp_path, "lame", 4, server={"begin_with": 3})
    assert result["status"] == 1
    assert [error for error in result["errors"] if "did not join" in error] == []


@pytest.mark.parametrize(
    "after_s",
    [
        pytest.param(0.02, id="while it is joined", marks=pytest.mark.slow),
        pytest.param(0.3, id="just joined", marks=pytest.mark.slow),
        pytest.param(1.0, id="in the run"),
    ],
)
def test_a_world_that_comes_back_within_reconnect_is_joined_anew(tmp_path: Path, after_s: float) -> None:
    (tmp_path / "tiny.yaml").write_text(ROOM)
    with open_router() as (_, endpoint):
        pass  # a port that was free

    def world(out: str, until: str) -> subprocess.Popen[str]:
        code = "from deploy.cli import main; main()"
        options = ["--world", "tiny.yaml", "--robots", "1", "--until", until, "--listen", endpoint, "--out", out]
        return subprocess.Popen(
            [sys.executable, "-c", code, "world", *options], cwd=tmp_path, stdout=subprocess.PIPE, text=True
        )

    first = world("first", "7000")
    second: subprocess.Popen[str] | None = None
    try:
        with ThreadPoolExecutor() as pool:
            patience = JoinConfig(reconnect_s=15.0)
            robot = pool.submit(run_agent, "r1", endpoint, AgentConfig(), patience=patience, make_mind=endless)
            assert first.stdout is not None and "listening" in first.stdout.readline()
            time.sleep(after_s)
            first.kill()
            second = world("second", "4")
            assert robot.result(20) == "time"
        assert second.wait(10) == 0
    finally:
        for process in (first, second):
            if process is not None:
                process.kill()
                process.communicate()
    assert len((tmp_path / "second" / "trajectories" / "r1.tum").read_text().splitlines()) == 21


@pytest.mark.parametrize(
    "pause_s", [pytest.param(1.0, marks=pytest.mark.slow), pytest.param(6.0, marks=pytest.mark.slow)]
)  # shorter and longer than the lease
def test_in_real_time_the_others_go_on_and_the_paused_one_misses_ticks(running: Any, pause_s: float) -> None:
    run = running(until=7000.0, server={"real_time": 20.0})
    victim = run.agents()[1]
    tick = run.line()["clock"]["tick"]
    victim.suspend()
    time.sleep(pause_s)
    run.wait_for(lambda line: line["clock"]["tick"] > tick + 90 * pause_s)
    victim.resume()
    run.wait_for(lambda line: line["clock"]["tick"] > tick + 90 * pause_s + 300)
    os.killpg(run.popen.pid, signal.SIGINT)
    assert run.result()["status"] == 130
    summary = json.loads((run.out / "summary.json").read_text())
    assert summary["late_ticks"] >= 50 * pause_s
    fates = [event["event"] for event in run.events() if event["event"] in ("left", "rejoined", "dead")]
    assert fates == (["left", "rejoined"] if pause_s > 5 else [])
