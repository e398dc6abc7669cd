"""Odd terminals, streams that nobody reads, and pipes in the place of files: no traceback, no hang, no lost run."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from deploy.exchange.raster import read_bitmap
from deploy.manifest import read
from deploy.recorded.lidar_log import Given
from deploy.recorded.reading import read_logs
from deploy.report.rundir import read_run
from deploy.terminal.live import Display
from protocol.errors import InputError
from protocol.messages import Clock, Progress
from tests.tiny import ROOM

pytestmark = pytest.mark.system

WIRESWARM = f"{sys.executable} -m wireswarm"


def shell(command: str, folder: Path, **more: str) -> "subprocess.CompletedProcess[bytes]":
    return subprocess.run(command, shell=True, cwd=folder, env=os.environ | more, timeout=60, capture_output=True)


@pytest.mark.parametrize("surroundings", [{"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0"}])
def test_a_terminal_without_the_characters_gets_question_marks(surroundings: dict[str, str], tmp_path: Path) -> None:
    done = shell(f"{WIRESWARM} worlds", tmp_path, **surroundings, PYTHONUTF8="0")
    assert done.returncode == 0 and b"???" in done.stdout and not done.stderr


def test_a_run_whose_streams_are_closed_is_whole(tmp_path: Path) -> None:
    (tmp_path / "room.yaml").write_text(ROOM)
    command = f"{WIRESWARM} run --world room.yaml --robots 1 --until 1 --out out"
    assert shell(f"{command} <&- >&- 2>&-", tmp_path).returncode == 0
    told = json.loads((tmp_path / "out/manifest.json").read_text())
    assert told["ended"] == "time" and (tmp_path / "out/report.html").exists()


def test_a_run_goes_on_beside_a_temporary_folder_whose_path_no_socket_can_have(tmp_path: Path) -> None:
    (tmp_path / "room.yaml").write_text(ROOM)
    (long := tmp_path / ("long" * 40)).mkdir()
    command = f"{WIRESWARM} run --world room.yaml --robots 1 --until 1 --out out --quiet"
    done = shell(command, tmp_path, TMPDIR=str(long))
    assert done.returncode == 0, done.stderr
    assert not list(long.iterdir())


def test_a_run_whose_progress_nobody_reads_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    monkeypatch.setattr(sys, "stderr", os.fdopen(writing, "w", closefd=False))
    display = Display("room", "range 4 m", quiet=False)
    os.close(reading)
    clock = Clock(tick=1, t=0.2, status={"r1": "exploring"})
    with display:
        for _ in range(2):
            display.show(Progress(clock=clock, coverage={"r1": 0.5}, team=0.5, late_ticks=0))
    os.close(writing)


@pytest.mark.parametrize(
    "open_",
    [
        lambda folder: read_logs([folder / "pipe.log"], Given()),
        lambda folder: read_logs([folder / "pipe.db3"], Given()),
        lambda folder: read_bitmap(folder / "pipe.png", 3.0, straighten=False, boundary=False),
        read,
    ],
)
def test_a_pipe_in_the_place_of_a_file_is_refused(open_: Callable[[Path], object], tmp_path: Path) -> None:
    for name in ("pipe.log", "pipe.db3", "pipe.png", "manifest.json"):
        os.mkfifo(tmp_path / name)
    with pytest.raises(InputError, match="this is no file"):
        open_(tmp_path)


def test_pipes_in_a_run_directory_become_notes(tmp_path: Path) -> None:
    for name in ("manifest.json", "events.jsonl", "metrics.csv", "world.yaml"):
        os.mkfifo(tmp_path / name)
    notes = "; ".join(read_run(tmp_path).notes)
    assert all(f"{name} cannot be read: this is no file" in notes for name in ("manifest.json", "events.jsonl"))
    assert "metrics.csv cannot be read" in notes and "world.yaml cannot be read" in notes
