"""Runs on small and full disks: one sentence with the paths, and every file that is there is whole."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from agent.config import AgentConfig, JoinConfig
from agent.shell.process import run_agent
from deploy import inprocess
from deploy.cli import app
from deploy.commands.results import write_results
from protocol.files import UnwritableError
from protocol.status import Status
from tests.scripted import Wanderer
from tests.tiny import ROOM, tiny_config
from tests.world.shell.test_roll_call import world
from world.recorder import Recorder

pytestmark = pytest.mark.system

REPO = Path(__file__).parents[2]
MOUNTS = subprocess.run(["unshare", "-rm", "true"], capture_output=True, check=False).returncode == 0

needs_mounts = pytest.mark.skipif(not MOUNTS, reason="a small disk needs a user namespace, and unshare -rm is refused")

RUN = """
import json, sys
from pathlib import Path
from agent.config import AgentConfig
from deploy.inprocess import run
from protocol.files import UnwritableError
from tests.scripted import Wanderer
from world.config import WorldConfig

out, fill_at = Path("disk/out"), int(sys.argv[1])

def whole(file):
    text = file.read_text() if file.suffix != ".msgpack" else ""
    if file.suffix == ".json":
        json.loads(text)
    return text[-1:] in ("", "\\n")

def fill(episode):
    if episode.tick == fill_at:
        with Path("disk/other").open("wb", buffering=0) as other:
            try:
                while True:
                    other.write(bytes(1000))
            except OSError:
                pass

try:
    run(WorldConfig(world=sys.argv[2], until=20000.0, max_time_s=20000.0), AgentConfig(), out, fill, make_mind=Wanderer)
    said = "nothing"
except UnwritableError as error:
    said = str(error)
found = {str(file.relative_to(out)): whole(file) for file in out.rglob("*") if file.is_file()}
print(json.dumps({"said": said, "found": found}))
"""


def on_disk(folder: Path, options: str, *command: str) -> subprocess.CompletedProcess[str]:
    """Run a command where `disk` is a small one."""
    (folder / "disk").mkdir()
    (folder / "tiny.yaml").write_text(ROOM)
    return subprocess.run(
        ["unshare", "-rm", "sh", "-c", f'mount -t tmpfs -o {options} none disk && exec "$@"', "sh", *command],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(REPO)},
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )


@needs_mounts
@pytest.mark.parametrize(
    ("size", "fill_at"), [("60k", -1), ("300k", -1), ("1m", 60)], ids=["60 kB", "300 kB", "full in mid-run"]
)
def test_a_run_ends_at_once_when_the_disk_is_full_and_what_is_there_is_whole(
    tmp_path: Path, size: str, fill_at: int
) -> None:
    done = on_disk(tmp_path, f"size={size}", sys.executable, "-c", RUN, str(fill_at), "tiny.yaml")
    assert done.returncode == 0, done.stderr
    result: dict[str, Any] = json.loads(done.stdout)
    assert result["said"].startswith("cannot write disk/out/") and result["said"].endswith(": No space left on device")
    assert all(result["found"].values()), result
    assert {"manifest.json", "truth.json", "events.jsonl"} <= result["found"].keys()
    assert not any(Path(file).name.startswith(".") for file in result["found"])


@pytest.mark.parametrize(
    ("steps", "told"),
    [(("check", "close"), "interrupted"), (("close",), "time")],
    ids=["full in mid-run", "full at the end"],
)
def test_robots_are_told_of_the_end_of_a_run_that_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, steps: tuple[str, ...], told: str
) -> None:
    """Those that were started by hand waited a minute for their world, and blamed the network."""

    def refuse(*_: object) -> None:
        raise UnwritableError((tmp_path / "events.jsonl", "No space left on device"))

    for step in steps:
        monkeypatch.setattr(Recorder, step, refuse)
    with world(tiny_config(tmp_path, robots=1, until=1.0), tmp_path / "out", [], settle_s=None) as (endpoint, ended):
        patience = JoinConfig(reconnect_s=1.0)
        assert run_agent("r1", endpoint, AgentConfig(), patience=patience, make_mind=Wanderer) == told
        with pytest.raises(UnwritableError):
            ended.result(10)


@needs_mounts
def test_the_command_says_which_files_a_full_disk_did_not_take(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "wireswarm", "run", "--world", "tiny.yaml", "--until", "20", "--quiet"]
    done = on_disk(tmp_path, "size=60k", *command, "--out", "disk/out")
    assert done.returncode == 1 and "Traceback" not in done.stderr
    lines = done.stderr.splitlines()
    assert all(line.startswith("wireswarm: ") and line.endswith(": No space left on device") for line in lines)
    assert "disk/out/report.html" in done.stderr and "disk/out/manifest.json" in done.stderr


def test_a_run_without_its_report_has_not_ended_as_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(run: Path) -> Path:
        raise UnwritableError((run / "report.png", "No space left on device"))

    inprocess.run(tiny_config(tmp_path, until=2.0), AgentConfig(), tmp_path / "out", make_mind=Wanderer)
    assert write_results(tmp_path / "out") == Status.OK
    monkeypatch.setattr("deploy.report.write_report", refuse)
    assert write_results(tmp_path / "out") == Status.FAILURE
    assert write_results(tmp_path / "out", status=Status.INCOMPLETE) == Status.INCOMPLETE
    assert f"cannot write {tmp_path}/out/report.png: No space left on device" in capsys.readouterr().err
    again = CliRunner().invoke(app, ["report", str(tmp_path / "out")])
    assert again.exit_code == Status.FAILURE and "team" in again.stdout


@needs_mounts
def test_a_disk_that_takes_nothing_is_refused_before_anything_starts(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "wireswarm", "run", "--world", "tiny.yaml", "--out", "disk/out"]
    done = on_disk(tmp_path, "ro", *command)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert done.stderr.startswith("wireswarm: --out disk/out: Read-only file system")
