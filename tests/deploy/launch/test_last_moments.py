"""A world that is killed when its run has ended: the run is over, and nothing of it is lost."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NoReturn

import pytest

from agent.config import AgentConfig, JoinConfig
from agent.shell.process import run_agent
from deploy import inprocess, manifest
from deploy.launch import launcher
from deploy.launch.processes import world_process
from protocol.errors import LinkError
from tests.disturbed import REPO
from tests.tiny import digests, tiny_config
from tests.wanderer import Wanderer, endless
from tests.world.shell.test_roll_call import world
from world.checkpoint import CHECKPOINT_FILE
from world.episode import Episode
from world.shell.voice import Voice
from world.tick import Outputs

pytestmark = pytest.mark.system


def die(*_: object, **__: object) -> NoReturn:
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def dies_before_its_manifest_is_written(launcher: Any, log: Any, *arguments: Any) -> None:
    """With summary and checkpoint in the directory. A world that was started again (resume) lives."""
    if len(arguments) < 4:
        manifest.finish = die
    world_process(launcher, log, *arguments)


def die_at_farewell() -> None:
    """When all is written and the checkpoint is gone."""
    tell = Voice.tell
    Voice.tell = lambda self, ended=None: die() if ended else tell(self)  # type: ignore[method-assign]


def dies_as_it_says_farewell(*arguments: Any) -> None:
    die_at_farewell()
    world_process(*arguments)


def dies_with_a_damaged_checkpoint(launcher: Any, log: Any, config: Any, out: Path, *arguments: Any) -> None:
    """In the midst of the run."""
    tell = Voice.tell

    def damage(self: Voice, ended: str | None = None) -> None:
        tell(self, ended)
        if self._episode.tick:
            (out / CHECKPOINT_FILE).write_bytes(b"")
            die()

    Voice.tell = damage  # type: ignore[method-assign]
    world_process(launcher, log, config, out, *arguments)


DIED = "world: its process died (signal 9)"


@pytest.mark.parametrize(
    ("dies", "restart", "status", "said"),
    [
        (dies_before_its_manifest_is_written, False, 1, DIED),
        (dies_before_its_manifest_is_written, True, 0, f"{DIED} and was started again"),
        (dies_as_it_says_farewell, False, 0, DIED),
        (dies_as_it_says_farewell, True, 0, DIED),
    ],
)
def test_a_run_that_has_ended_is_filed_as_it_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, dies: Callable[..., None], restart: bool, status: int, said: str
) -> None:
    config, out = tiny_config(tmp_path, robots=1, until=2.0, restart=restart), tmp_path / "out"
    monkeypatch.setattr(launcher, "world_process", dies)
    assert launcher.launch(config, out, make_mind=Wanderer) == (status, "time", [said])
    assert json.loads((out / "manifest.json").read_text())["ended"] == "time"
    assert not (out / CHECKPOINT_FILE).exists()
    inprocess.run(config, config.agent, tmp_path / "alone", make_mind=Wanderer)
    assert digests(out).items() >= digests(tmp_path / "alone").items()


def test_a_world_alone_files_its_run_before_it_says_farewell(tmp_path: Path) -> None:
    tiny_config(tmp_path)
    dies = "from tests.deploy.launch.test_last_moments import *; die_at_farewell(); from deploy.cli import main; main()"
    options = ["--world", "tiny.yaml", "--robots", "1", "--until", "1", "--out", "out"]
    command, environment = [sys.executable, "-c", dies, "world", *options], {**os.environ, "PYTHONPATH": str(REPO)}
    with subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        endpoint = process.stdout.readline().split()[-1]
        with pytest.raises(LinkError):
            run_agent("r1", endpoint, AgentConfig(), patience=JoinConfig(reconnect_s=0), make_mind=Wanderer)
    assert process.returncode == -signal.SIGKILL
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["ended"] == "time"


def test_a_run_that_cannot_go_on_keeps_its_manifest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config, out = tiny_config(tmp_path, robots=1, until=7000.0, restart=True), tmp_path / "out"
    monkeypatch.setattr(launcher, "world_process", dies_with_a_damaged_checkpoint)
    status, ended, (died, damaged) = launcher.launch(config, out, make_mind=endless)
    assert (status, ended, died) == (1, "interrupted", f"{DIED} and was started again")
    assert damaged.startswith(f"{out / CHECKPOINT_FILE} is damaged")
    assert json.loads((out / "manifest.json").read_text())["errors"] == [died, damaged]


def test_robots_that_come_back_to_a_run_that_had_ended_are_told_so(tmp_path: Path) -> None:
    """They waited a minute for a world that had gone."""
    config = tiny_config(tmp_path, robots=1, until=1.0)
    killed = Episode(config, tmp_path / "out")
    killed.arrive("r1", "its process")
    mind = Wanderer("r1", killed.welcome("r1").spec, AgentConfig(), 0)
    while killed.ended is None:
        step = mind.step(killed.inputs()["r1"].observation, [])
        killed.advance({"r1": Outputs(step.sends, step.action, step.map)})
    del killed  # it holds the directory
    again = world(config, tmp_path / "out", [], settle_s=None, resume=True)
    with again as (endpoint, ended), ThreadPoolExecutor() as pool:
        assert pool.submit(run_agent, "r1", endpoint, AgentConfig(), make_mind=Wanderer).result(20) == "time"
        assert ended.result(10) == "time"


def test_what_a_run_had_to_say_stays_where_its_report_is_broken_off(tmp_path: Path) -> None:
    manifest.begin(tmp_path, {"seed": 0})
    manifest.finish(tmp_path, ended="complete", exit_status=3, errors=[DIED])
    manifest.interrupt(tmp_path, "interrupted before the report was written")
    told = manifest.read(tmp_path)
    assert (told["ended"], told["errors"]) == ("complete", [DIED, "interrupted before the report was written"])
