"""`python -m agent`, as in the agents' image: with neither the world nor what only people and the world need."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.system

ABSENT = ["deploy", "matplotlib", "psutil", "pymunk", "rich", "wireswarm", "world"]
ALONE = f"""
import runpy, sys
sys.modules.update(dict.fromkeys({ABSENT}))  # an import of any of these fails
runpy.run_module("agent", run_name="__main__", alter_sys=True)
"""
LOADED = "import agent.warmup\nagent.warmup._rehearsed = True  # no kernel is asked for\n"


def alone(*arguments: str) -> tuple[int, str, str]:
    done = subprocess.run(
        [sys.executable, "-c", LOADED + ALONE, *arguments], capture_output=True, text=True, timeout=100, check=False
    )
    return done.returncode, done.stdout, done.stderr


def test_it_tells_its_options_without_rich() -> None:
    status, out, _ = alone("--help")
    assert status == 0 and "--secrets <path>" in out and "\u2500" not in out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--id", "r1"], "--connect: name the endpoint of the world"),
        (["--connect", "tcp/127.0.0.1:1"], "--id: name the robot"),
        (["--connect", "tcp/127.0.0.1:1", "--id", "r1", "--set", "robots=2"], "robots: there is no such setting"),
        (["--connect", "tcp/127.0.0.1:1", "--id", "r1", "--set", "agent.wings=2"], "agent.wings: there is no such"),
        (["--ros2", "r 1"], "--ros2 /r 1: it is no namespace of ROS 2"),
        (["--ros2", "/"], "--ros2 /: name the robot, such as --id r1"),
        (["--ros2", "r1", "--reconnect", "3"], "--ros2: it goes without --secrets"),
        (["--ros2", "r1", "--set", "ros2.range_m=4"], "range_m and position_topic go together"),
        (["--ros2", "r1", "--set", "spec=3"], "spec: "),
        (["--ros2", "r1", "--connect", "127.0.0.1"], "'127.0.0.1' is no endpoint"),
    ],
)
def test_what_is_wrong_is_one_sentence(arguments: list[str], sentence: str) -> None:
    status, out, err = alone(*arguments)
    assert (status, out, err.count("\n")) == (2, "", 1) and sentence in err


def test_it_takes_its_part_of_the_file_of_a_whole_run(tmp_path: Path) -> None:
    file = tmp_path / "run.yaml"
    file.write_text("robots: 2\njoin_timeout_s: 0.1\nserver: {real_time: 1}\n")
    status, _, err = alone("--connect", "tcp/127.0.0.1:1", "--id", "r1", "--config", str(file))
    assert status == 1 and "no world answers at tcp/127.0.0.1:1 within 0.1 s" in err
    file.write_text("agent: {wings: 2}\n")
    status, _, err = alone("--connect", "tcp/127.0.0.1:1", "--id", "r1", "--config", str(file))
    assert status == 2 and "agent.wings: there is no such setting" in err


@pytest.mark.parametrize("rehearsed", [False, True])
def test_it_leaves_at_once_while_it_loads_or_looks_for_a_world(rehearsed: bool) -> None:
    loaded = LOADED if rehearsed else ""
    arguments = ["--connect", "tcp/127.0.0.1:1", "--id", "r1", "--set", "join_timeout_s=60"]
    robot = subprocess.Popen([sys.executable, "-c", loaded + ALONE, *arguments])
    status, term = Path(f"/proc/{robot.pid}/status"), 1 << (signal.SIGTERM - 1)
    deadline = time.monotonic() + 60
    while not int(status.read_text().split("SigCgt:")[1].split()[0], 16) & term:  # not yet: it imports
        assert time.monotonic() < deadline
        time.sleep(0.02)
    time.sleep(0.5)
    robot.terminate()
    assert robot.wait(2) == 130
