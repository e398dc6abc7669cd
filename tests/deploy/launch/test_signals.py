"""Ctrl-C, SIGTERM and kill -9 in every phase of `wireswarm run`: it ends soon, says so, and leaves nothing running."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.disturbed import AS_TERMINAL, BEGUN_S, BUSY, REPO, Command, handles
from tests.tiny import ROOM

pytestmark = pytest.mark.system

ENDED_S = 5.0 * BUSY


@pytest.fixture
def command(tmp_path: Path) -> Iterator[Any]:
    started: list[Command] = []

    def start(*options: str) -> Command:
        started.append(Command(tmp_path, *options))
        return started[-1]

    yield start
    for one in started:
        one.end()


SIGNALS = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])


@SIGNALS
def test_a_command_that_is_still_being_imported_leaves_without_a_word(command: Any, number: signal.Signals) -> None:
    run = command()
    end = time.monotonic() + BEGUN_S
    while not handles(run.popen.pid, signal.SIGTERM):
        assert time.monotonic() < end
    run.popen.send_signal(number)
    assert run.ended(ENDED_S) == (130, "")
    assert not run.out.exists()


@SIGNALS
def test_the_server_that_children_are_forked_from_goes_with_a_command_that_is_being_imported(
    command: Any, number: signal.Signals
) -> None:
    run = command()
    end = time.monotonic() + BEGUN_S
    while len(run.processes) < 3:  # with the tracker of resources
        assert run.popen.poll() is None and time.monotonic() < end
        run.note()
    run.popen.send_signal(number)
    assert run.popen.wait(ENDED_S) == 130
    began = time.monotonic()
    run.popen.communicate(timeout=ENDED_S)  # while the server lives, it holds the streams
    assert time.monotonic() - began < ENDED_S / 10


def test_the_server_goes_with_a_launcher_that_is_killed_while_it_still_imports(command: Any) -> None:
    run = command()
    end = time.monotonic() + BEGUN_S
    while (server := run.server()) is None or not handles(server.pid, signal.SIGALRM):
        assert run.popen.poll() is None and time.monotonic() < end
        run.note()
    run.popen.kill()
    began = time.monotonic()
    run.popen.communicate(timeout=ENDED_S)  # while the server lives, it holds the streams
    assert time.monotonic() - began < ENDED_S / 10


@SIGNALS
@pytest.mark.parametrize("after_s", [0.3, 1.0])
def test_a_signal_in_the_first_second_is_no_traceback(command: Any, number: signal.Signals, after_s: float) -> None:
    run = command()
    time.sleep(after_s)
    run.popen.send_signal(number)
    status, errors = run.ended(ENDED_S)
    assert status == 130 and "Traceback" not in errors
    assert not run.out.exists() or run.manifest()["ended"] == "interrupted"


@pytest.mark.parametrize(
    ("phase", "number", "group"),
    [
        ("manifest.json", signal.SIGINT, True),
        ("summary.json", signal.SIGTERM, False),
        ("report.html", signal.SIGINT, True),
        pytest.param("manifest.json", signal.SIGTERM, False, marks=pytest.mark.slow),
        pytest.param("truth.json", signal.SIGINT, False, marks=pytest.mark.slow),
        pytest.param("truth.json", signal.SIGTERM, True, marks=pytest.mark.slow),
        pytest.param("summary.json", signal.SIGINT, True, marks=pytest.mark.slow),
        pytest.param("report.png", signal.SIGTERM, False, marks=pytest.mark.slow),
    ],
)
def test_a_signal_ends_a_run_in_any_phase(command: Any, phase: str, number: signal.Signals, group: bool) -> None:
    run = command("--until", "10")
    run.wait_for(phase)
    (os.killpg if group else os.kill)(run.popen.pid, number)
    status, errors = run.ended(ENDED_S)
    manifest = run.manifest()
    assert status == manifest["exit_status"] == 130
    assert "interrupted" in errors and "Traceback" not in errors
    if phase in ("manifest.json", "truth.json"):
        assert manifest["ended"] == "interrupted"
    else:
        assert manifest["ended"] == "time" and manifest["errors"][0].startswith("interrupted")
    assert not list(run.out.rglob(".*"))


def test_a_second_signal_kills_what_the_first_does_not_end(command: Any) -> None:
    run = command("--until", "5000", "--set", "server.silence_s=600")
    run.wait_for("snapshots/r1.jsonl")
    while not (run.out / "snapshots/r1.jsonl").stat().st_size:
        time.sleep(0.01)
    run.note()
    world = next(p for p in run.processes if any(c.status == psutil.CONN_LISTEN for c in p.net_connections("tcp")))
    world.suspend()
    run.popen.send_signal(signal.SIGINT)
    with pytest.raises(subprocess.TimeoutExpired):
        run.popen.wait(0.5)
    run.popen.send_signal(signal.SIGINT)
    assert run.ended(ENDED_S)[0] == 130
    assert run.manifest()["ended"] == "interrupted"


@SIGNALS
def test_a_world_that_waits_for_a_silent_router_hears_a_signal(tmp_path: Path, number: signal.Signals) -> None:
    (tmp_path / "tiny.yaml").write_text(ROOM)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        silent.settimeout(BEGUN_S)
        router = f"tcp/127.0.0.1:{silent.getsockname()[1]}"
        options = ("--world", "tiny.yaml", "--out", "out", "--connect", router, "--set", "join_timeout_s=600")
        world = subprocess.Popen(
            [*AS_TERMINAL, sys.executable, "-m", "wireswarm", "world", *options],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(REPO)},
            stderr=subprocess.PIPE,
            text=True,
        )
        with silent.accept()[0]:
            world.send_signal(number)
            errors = world.communicate(timeout=ENDED_S)[1]
    assert (world.returncode, errors) == (130, "")
    assert not (tmp_path / "out").exists()  # no run had begun


def test_an_interrupted_world_that_hangs_is_killed(tmp_path: Path) -> None:
    hangs = """
import os, signal, sys
from pathlib import Path
import psutil
from deploy.launch import launcher
from tests.tiny import tiny_config
from tests.wanderer import Wanderer
launcher.LAST_S = 1.0
hanging = []
def show(progress):
    if hanging:
        return  # a second signal would kill it
    processes = psutil.Process().children(recursive=True)
    hanging.extend(p for p in processes if any(c.status == psutil.CONN_LISTEN for c in p.net_connections("tcp")))
    hanging[0].suspend()
    os.kill(os.getpid(), signal.SIGINT)
folder = Path(sys.argv[1])
config = tiny_config(folder, until=5000.0)
status, ended, errors = launcher.launch(config, folder / "out", show=show, make_mind=Wanderer)
assert (status, ended) == (130, "interrupted")
sys.exit(errors[0])
"""
    command = [*AS_TERMINAL, sys.executable, "-c", hangs, str(tmp_path)]
    done = subprocess.run(command, cwd=REPO, capture_output=True, text=True, timeout=BEGUN_S)
    assert (done.returncode, done.stderr.strip()) == (1, "world: it did not end within 1 s and was killed")
    assert '"ended": "interrupted"' in (tmp_path / "out" / "manifest.json").read_text()


def test_a_child_whose_launcher_dies_before_it_says_what_to_do_ends_without_a_word() -> None:
    dies = """
import os
from multiprocessing import forkserver
from deploy.launch import forks
forks.begin()
child, told = forkserver.connect_to_new_process([])
os.close(told)
os.read(child, 8), os.read(child, 8)  # the child's number and status
"""
    done = subprocess.run([sys.executable, "-c", dies], cwd=REPO, capture_output=True, text=True, timeout=BEGUN_S)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("victim", "phase"),
    [
        ("launcher", "snapshots/r1.jsonl"),
        ("server", "truth.json"),
        *(
            pytest.param(victim, phase, marks=pytest.mark.slow)
            for victim, phase in [
                ("launcher", "manifest.json"),
                ("launcher", "truth.json"),
                ("server", "manifest.json"),
                ("server", "snapshots/r1.jsonl"),
            ]
        ),
    ],
)
def test_without_launcher_or_server_of_forks_a_run_ends_as_interrupted(command: Any, victim: str, phase: str) -> None:
    run = command("--until", "5000")
    run.wait_for(phase)
    if phase.startswith("snapshots"):
        while not (run.out / phase).stat().st_size:
            time.sleep(0.01)
        run.note()
    server = run.server()
    if victim == "launcher":
        run.popen.kill()
    elif server:
        server.kill()
    else:
        pytest.skip("the server had not started")
    status, errors = run.ended(ENDED_S)
    manifest = run.manifest()
    assert "Traceback" not in errors
    if victim == "server":
        assert status == manifest["exit_status"] == 130
        assert "wireswarm: interrupted: the server from which world and robots are forked was killed" in errors
    assert manifest["ended"] == "interrupted" or (victim == "launcher" and phase != "snapshots/r1.jsonl")
