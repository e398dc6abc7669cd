"""A first start with nothing compiled and no cache to write: it says so, is waited for, and ends when told."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from protocol import keys
from protocol.codec import encode
from protocol.errors import LinkError
from protocol.messages import PROTOCOL_VERSION, Join
from protocol.session import open_client
from tests.agent.shell.test_process import JOIN_S, World
from tests.tiny import ROOM, tiny_config

pytestmark = pytest.mark.system

REPO = Path(__file__).parents[3]
NOWHERE = {**os.environ, "PYTHONPATH": str(REPO), "NUMBA_CACHE_DIR": "/proc/nowhere"}  # empty, and nobody can write it


def test_a_robot_that_was_let_in_is_waited_for_while_it_has_its_link(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, robots=1, server={"join_timeout_s": 2.0, "insecure": True})
    with World(config, tmp_path / "out") as world:
        with open_client(world.endpoint.result(JOIN_S), JOIN_S) as session:
            join = Join(version=PROTOCOL_VERSION, robot="r1", session=str(session.info.zid()), process="1")
            (reply,) = session.get(keys.service("r1", keys.JOIN), payload=encode(join))
            assert reply.ok is not None
            time.sleep(4.5)  # the world looks again every 2 s
            assert not world.ended.done()
        with pytest.raises(LinkError, match="r1 did not join within 2 s"):
            world.ended.result(20)


def test_a_robot_that_compiles_says_so_and_ends_when_told(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, robots=1, server={"insecure": True})
    with World(config, tmp_path / "out") as world:
        command = [sys.executable, "-m", "agent", "--id", "r1", "--connect", world.endpoint.result(JOIN_S)]
        with subprocess.Popen(command, env=NOWHERE, stderr=subprocess.PIPE, text=True) as robot:
            assert robot.stderr is not None
            assert robot.stderr.readline().startswith("wireswarm: compiling kernels")
            robot.send_signal(signal.SIGTERM)
            assert robot.wait(30) == 130  # what LLVM is at is compiled to its end


def test_a_run_that_compiles_says_so_and_ends_when_told(tmp_path: Path) -> None:
    (tmp_path / "tiny.yaml").write_text(ROOM)
    command = [sys.executable, "-m", "wireswarm", "run", "--world", "tiny.yaml", "--out", "out"]
    with subprocess.Popen(command, cwd=tmp_path, env=NOWHERE, stderr=subprocess.PIPE, text=True) as run:
        assert run.stderr is not None
        assert run.stderr.readline().startswith("wireswarm: compiling kernels")
        run.send_signal(signal.SIGTERM)
        assert run.wait(30) == 130
        assert "Traceback" not in run.stderr.read()
