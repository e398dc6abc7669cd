"""examples/bare_robot.py: docs/protocol.md is enough to write a robot that maps a flat."""

import ast
import subprocess
import sys
from pathlib import Path
from queue import SimpleQueue
from threading import Thread

import pytest
import zenoh

from deploy.metrics import score_walls, truth_of
from deploy.report.rundir import read_run
from deploy.revision import ROOT
from deploy.sensing import IDEAL
from protocol import keys
from protocol.codec import encode
from protocol.messages import Refused
from protocol.session import open_router
from world.config import ServerConfig, WorldConfig
from world.shell.server import serve
from world.worldfile import load

pytestmark = pytest.mark.system

ROBOT = ROOT / "examples" / "bare_robot.py"


def test_the_robot_has_nothing_of_ours() -> None:
    nodes = list(ast.walk(ast.parse(ROBOT.read_text())))
    names = {one.name for node in nodes if isinstance(node, ast.Import) for one in node.names}
    names |= {node.module or "." for node in nodes if isinstance(node, ast.ImportFrom)}
    assert names - sys.stdlib_module_names == {"msgpack", "numpy", "zenoh"}


@pytest.mark.parametrize("arguments", [["-h"], []])
def test_the_robot_says_how_it_is_called(arguments: list[str]) -> None:
    command = [sys.executable, str(ROBOT), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert "python examples/bare_robot.py r1 tcp/" in done.stderr and "Traceback" not in done.stderr


def test_the_robot_asks_until_it_is_answered_and_says_why_it_is_refused() -> None:
    answers = [b"", b"Timeout", encode(Refused(reason="no r9 takes part"))]

    def reply(query: zenoh.Query) -> None:
        answer = answers.pop(0)
        with query:
            if answer:
                query.reply_err(answer)

    with open_router() as (world, endpoint):
        world.declare_queryable(keys.service("r9", keys.JOIN), reply)
        command = [sys.executable, str(ROBOT), "r9", endpoint]
        done = subprocess.run(command, env={}, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (1, "r9 is not let in: no r9 takes part\n") and not answers


def test_the_robot_maps_a_flat(tmp_path: Path) -> None:
    config = WorldConfig.model_validate({"world": "apartment", "robots": 1, "max_time_s": 300, "spec": IDEAL})
    endpoints: SimpleQueue[str] = SimpleQueue()
    world = Thread(target=serve, args=(config, ServerConfig(), tmp_path / "run"), kwargs={"listening": endpoints.put})
    world.start()
    command = [sys.executable, str(ROBOT), "r1", endpoints.get(timeout=20)]
    done = subprocess.run(command, cwd=tmp_path, env={}, capture_output=True, text=True, timeout=100)
    world.join(20)
    assert done.stdout == "r1: complete\n", done.stderr
    run = read_run(tmp_path / "run")
    assert run.summary["robots"]["r1"]["coverage"] > 0.9
    found, (x, y, _) = run.map("r1", frame="world"), run.frames["r1"]
    truth = truth_of(load("apartment"), (float(x), float(y)), config.spec.radius_m, config.spec.lidar.range_max_m)
    score = score_walls(found.vertices[found.edges].reshape(-1, 4), truth)
    assert score.recall > 0.8 and score.precision > 0.98 and score.repeated < 1.05
