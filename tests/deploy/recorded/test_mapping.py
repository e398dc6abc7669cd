"""`wireswarm map`: logs in place of the world, to the run directory."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agent.config import AgentConfig
from agent.passenger import IN_LIVED_ROOMS
from deploy import manifest
from deploy.bandwidth.books import read_books
from deploy.bandwidth.representations import measure
from deploy.bench.rings import laps
from deploy.cli import app
from deploy.exchange.mcap import write_mcap
from deploy.finish import finish
from deploy.launch import forks
from deploy.recorded import mapping
from deploy.recorded.lidar_log import LidarLog, Scan
from deploy.recorded.words import print_mapped
from deploy.recorded.written import write_carmen
from deploy.report import write_report
from deploy.report.rundir import read_drawable, read_run
from protocol.arrays import Floats
from protocol.errors import InputError, ProtocolError
from tests.carried import DRIFT, HALF_TURN, observations, path_error, ring_corridor

pytestmark = pytest.mark.system

LOGS = Path("/work/shared/logs")
SCORER = Path("/work/shared/score/score_log.py")


def record(file: Path, seed: int) -> Floats:
    """Write the CARMEN log of a drive through a ring; returns its true way."""
    way = laps(18.0, 2.2, 1.25, step=0.5)
    with file.open("w") as lines:
        for seen in observations(ring_corridor(18.0, 2.2), way, HALF_TURN, DRIFT, seed):
            ranges = " ".join(f"{r:.2f}" if np.isfinite(r) else "81.83" for r in seen.scan())
            pose = " ".join(f"{value:.4f}" for value in seen.odometry)
            lines.write(f"FLASER 180 {ranges} {pose} {pose} {seen.tick} host {seen.tick}\n")
    return way


def wireswarm(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "wireswarm", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=110)


@pytest.mark.parametrize("written", [False, True])
def test_an_interrupted_command_says_so_and_leaves_no_stub(
    tmp_path: Path, written: bool, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """It ended without a word, and its manifest kept the same command from its directory."""
    out = tmp_path / "new" / "my run"

    def stop(*_: object, **__: object) -> Any:
        raise RuntimeError("left", out.parent.exists())

    def map_logs(logs: object, config: AgentConfig, directory: Path, **_: object) -> None:
        manifest.begin(directory, {})
        if written:
            (directory / "maps").mkdir()
        os.kill(os.getpid(), signal.SIGTERM)

    record(tmp_path / "1.log", 1)
    monkeypatch.setattr(forks, "leave", stop)
    monkeypatch.setattr(mapping, "map_logs", map_logs)
    with pytest.raises(RuntimeError) as left:
        app(["map", str(tmp_path / "1.log"), "--out", str(out)], standalone_mode=False)
    assert left.value.args == ("left", written)
    said = capfd.readouterr().err.splitlines()[-1]  # after changed kernels it says first that it compiles them
    if written:
        assert manifest.read(out)["ended"] == "interrupted"
        assert said == f"wireswarm: interrupted before the report was written; `wireswarm report '{out}'` writes it"
    else:
        assert said == f"wireswarm: interrupted before a map was written to {out}"


def test_two_logs_become_a_run_directory(tmp_path: Path) -> None:
    ways = [record(tmp_path / f"{seed}.log", seed) for seed in (1, 2)]
    with (tmp_path / "1.log").open("a") as file:
        file.write("FLASER 180 1 2\n")
    out = tmp_path / "out"
    done = wireswarm("map", tmp_path / "1.log", tmp_path / "2.log", "--out", out)
    assert done.returncode == 0, done.stderr
    assert "r1: skipped 1 lines that are cut" in done.stdout and str(out / "report.html") in done.stdout
    summary = json.loads((out / "summary.json").read_text())
    for robot, way in zip(("r1", "r2"), ways, strict=True):
        rows = np.loadtxt(out / "estimate" / f"{robot}.tum")
        assert rows.shape == (len(way), 8) and np.array_equal(rows[:, 0], np.arange(len(way)))
        assert np.allclose(np.hypot(rows[:, 6], rows[:, 7]), 1, atol=1e-5)
        assert path_error(rows[:, 1:3], way) < 0.12
        figures = summary["robots"][robot]
        assert figures["scans"] == len(way) and figures["loops"] > 0 and 50 < figures["map_bytes"] < 1000
    run = read_run(out)
    assert run.robots == ["r1", "r2"] and not run.notes
    assert json.loads((out / "manifest.json").read_text())["ended"] == "complete"


def test_a_map_that_is_too_large_for_the_radio_has_no_size_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object) -> None:
        raise ProtocolError("a map of more than 3000 vertices")

    monkeypatch.setattr(mapping, "encode_map", refuse)
    scan = Scan(0, 0.0, np.full(180, 2.0), (0.0, 0.0, 0.0))
    summary = mapping.map_logs([LidarLog(HALF_TURN, "log", [scan])], AgentConfig(), tmp_path, quiet=True)
    assert json.loads((tmp_path / "summary.json").read_text()) == summary
    assert summary["robots"]["r1"]["map_bytes"] is None
    print_mapped(tmp_path, summary)
    write_report(tmp_path)
    assert "too large" in capsys.readouterr().out


@pytest.mark.parametrize("arguments", [["no.log"], [], ["some.log", "--field-of-view", "0"]])
def test_what_cannot_be_mapped_leaves_nothing_behind(tmp_path: Path, arguments: list[str]) -> None:
    (tmp_path / "some.log").write_text("FLASER 3 1 2 3\n")
    files = [str(tmp_path / word) if word.endswith(".log") else word for word in arguments]
    done = wireswarm("map", *files, "--out", tmp_path / "out")
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(not LOGS.exists(), reason="recorded logs lie beside the project only")
def test_a_recorded_log_is_mapped_as_well_as_by_grid_slam(tmp_path: Path) -> None:
    log, out = LOGS / "intel-drift.log.gz", tmp_path / "out"
    assert wireswarm("map", log, "--out", out, "--quiet").returncode == 0
    score = [sys.executable, str(SCORER), str(log), str(LOGS / "intel-drift.ref.tum"), str(out)]
    found = json.loads(subprocess.run(score, check=True, capture_output=True, text=True, timeout=110).stdout)
    assert found["ate_m"] < 0.12, "iris_lama's, /work/shared/facts/real.md"
    assert found["explained"] > 0.85 and found["supported"] > 0.9
    assert json.loads((out / "summary.json").read_text())["robots"]["r1"]["map_bytes"] < 8000


@pytest.mark.parametrize(
    "ask",
    [
        read_drawable,
        lambda run: write_carmen(run, run / "carmen"),
        lambda run: write_mcap(run, run / "mcap"),
        finish,
        measure,
        read_books,
    ],
)
def test_what_needs_a_world_says_that_logs_have_none(tmp_path: Path, ask: Callable[[Path], object]) -> None:
    scan = Scan(0, 0.0, np.full(180, 2.0), (0.0, 0.0, 0.0))
    mapping.map_logs([LidarLog(HALF_TURN, "log", [scan])], AgentConfig(), tmp_path, quiet=True)
    files = sorted(tmp_path.iterdir())
    with pytest.raises(InputError, match="is a directory of `wireswarm map`: recorded logs have no world"):
        ask(tmp_path)
    assert sorted(tmp_path.iterdir()) == files


def test_a_log_has_no_settings_of_a_run(tmp_path: Path) -> None:
    """They were taken without a word, and changed nothing."""
    record(tmp_path / "a.log", 0)
    done = wireswarm("map", tmp_path / "a.log", "--out", tmp_path / "run", "--set", "starts=random")
    assert done.returncode == 2 and "starts" in done.stderr and not (tmp_path / "run").exists()


def test_settings_of_alignment_hold_for_logs_and_stand_in_the_manifest(tmp_path: Path) -> None:
    """What is not set is as lived-in rooms need it."""
    record(tmp_path / "whole.log", 0)
    (tmp_path / "a.log").write_text("\n".join((tmp_path / "whole.log").read_text().splitlines()[:8]))
    done = wireswarm("map", tmp_path / "a.log", "--out", tmp_path / "run", "--set", "agent.alignment.min_score_m=6")
    assert done.returncode == 0, done.stderr
    told = json.loads((tmp_path / "run" / "manifest.json").read_text())["config"]
    assert told["alignment"]["min_score_m"] == 6.0
    assert told["alignment"]["max_conflict"] == IN_LIVED_ROOMS["max_conflict"]
    assert told["cooperation"]["verification"]["discs"] is False
