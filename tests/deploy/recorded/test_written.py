"""Runs as CARMEN logs: what a lidar measured comes back, line by line."""

import json
import math
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from agent.config import AgentConfig
from deploy import inprocess
from deploy.bandwidth.books import NoRunError
from deploy.recorded.carmen import read_carmen
from deploy.recorded.lidar_log import Given
from deploy.recorded.reading import read_logs
from deploy.recorded.runs import kept_scans
from deploy.recorded.written import write_carmen
from deploy.revision import ROOT
from protocol.geometry import compose
from tests.scripted import Wanderer
from tests.tiny import tiny_config

TURTLEBOT = {"turning": True, "dropout": 0.05, "range_max_m": 2.0}
CLOCKWISE = {"beams": 90, "clockwise": True, "first_beam_deg": -30.0, "range_max_m": 2.0}
HALF = {"beams": 180, "field_of_view_deg": 180.0, "first_beam_deg": 89.0, "clockwise": True, "mount_x_m": 0.05}
AHEAD, SICK = HALF | {"range_max_m": 5.0}, HALF | {"range_max_m": 80.0}


def run(folder: Path, lidar: dict[str, object]) -> Path:
    spec = {"lidar": lidar, "odometry": {"noisy": True}}
    config = tiny_config(folder, until=4.0, robots=2, scans=True, spec=spec)
    inprocess.run(config, AgentConfig(), folder / "run", make_mind=Wanderer)  # type: ignore[arg-type]
    return folder / "run"


@pytest.mark.parametrize(("lidar", "kind"), [(TURTLEBOT, "ROBOTLASER1"), (AHEAD, "ROBOTLASER1"), (SICK, "FLASER")])
def test_what_was_measured_comes_back(tmp_path: Path, lidar: dict[str, object], kind: str) -> None:
    out = run(tmp_path, lidar)
    logs = write_carmen(out, tmp_path / "logs")
    assert [log.name for log in logs] == ["r1.log", "r2.log"]
    kept = [json.loads(line) for line in (out / "scans" / "r1.jsonl").read_text().splitlines()]
    assert len(kept) == 20 and {line.split()[0] for line in logs[0].read_text().splitlines()} == {"PARAM", "ODOM", kind}
    log = read_carmen(logs[0], Given())
    assert len(log.scans) == 20 and log.lidar.range_max_m == lidar["range_max_m"]
    mount = (float(lidar.get("mount_x_m", 0.0)), 0.0, 0.0)  # type: ignore[arg-type]
    for scan, line in zip(log.scans, kept, strict=True):
        readings = np.array([math.nan if one is None else math.inf if one < 0 else one for one in line["ranges"]])
        np.testing.assert_allclose(scan.ranges, readings, atol=1e-4)
        assert scan.odometry == pytest.approx(compose(tuple(line["odometry"]), mount), abs=1e-5)
        assert scan.time_s == pytest.approx(line["t"])
    first, last = (0, 359) if lidar == TURTLEBOT else (89, -90)
    assert np.degrees(log.lidar.bearings())[[0, -1]] == pytest.approx((first, last), abs=1e-5)


@pytest.mark.parametrize("lidar", [TURTLEBOT, CLOCKWISE, SICK])
def test_a_run_is_a_log_for_each_robot(tmp_path: Path, lidar: dict[str, object]) -> None:
    out = run(tmp_path, lidar)
    logs = read_logs([out], Given())
    assert [log.source for log in logs] == [f"{out}, r1", f"{out}, r2"]
    for log, file in zip(logs, write_carmen(out, tmp_path / "logs"), strict=True):
        assert log.lidar.mount_x_m == 0 and not log.skipped
        for scan, written in zip(log.scans, read_carmen(file, Given()).scans, strict=True):
            np.testing.assert_allclose(scan.ranges, written.ranges, atol=1e-4)
            assert scan.odometry == pytest.approx(written.odometry, abs=1e-5)
            assert written.way is not None
            if scan.way is not None:  # of the first one nothing tells
                assert written.way[[0, -1]] == pytest.approx(scan.way, abs=1e-5)
        for before, scan in pairwise(log.scans):
            assert scan.way is not None and scan.way == pytest.approx(np.array((before.odometry, scan.odometry)))


def test_scans_of_one_moment_and_a_revolution_that_the_user_tells(tmp_path: Path) -> None:
    (instant, _) = write_carmen(run(tmp_path, TURTLEBOT | {"turning": False}), tmp_path / "logs")
    log = read_carmen(instant, Given())
    assert not log.lidar.turning and all(scan.way is None for scan in log.scans)
    log = read_carmen(instant, Given(revolution_s=0.1))
    assert log.lidar.turning
    half = np.mean([log.scans[9].odometry, log.scans[10].odometry], 0)
    way = log.scans[10].way
    assert way is not None and way[0] == pytest.approx(half, abs=1e-5)


def test_the_scorer_of_recorded_logs_reads_both_files(tmp_path: Path) -> None:
    scorer = ROOT.parent / "shared" / "score" / "score_log.py"
    if not scorer.exists():
        pytest.skip("no scorer beside the repository")
    out = run(tmp_path, SICK | {"first_beam_deg": -90.0, "clockwise": False, "mount_x_m": 0.0})
    (log, _), folder = write_carmen(out, tmp_path / "logs"), tmp_path / "judged"
    (folder / "estimate").mkdir(parents=True)
    (folder / "maps").mkdir()
    reference = log.with_name("r1.ref.tum")
    (folder / "estimate" / "r1.tum").write_bytes(reference.read_bytes())
    walls = json.loads((out / "maps" / "r1.json").read_text())
    (folder / "maps" / "r1.json").write_text(json.dumps(walls))
    words = [sys.executable, str(scorer), str(log), str(reference), str(folder)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=60)
    judged = json.loads(done.stdout)
    assert judged["ate_m"] == 0 and judged["scans"] == 20


@pytest.mark.parametrize(
    "line",
    [
        "[" * 99_000,
        '{"t": 0, "tick": 0, "odometry": [0, 0, 0], "ranges": [1' + "0" * 400 + "]}",
        '{"t": -1, "tick": 0, "odometry": [0, 0, 0], "ranges": [1]}',
        '{"t": 1e300, "tick": 0, "odometry": [0, 0, 0], "ranges": [1]}',
        '{"t": 0, "tick": NaN, "odometry": [0, 0, 0], "ranges": [1]}',
        '{"t": 0, "tick": 0, "odometry": [0, 1e300, 0], "ranges": [1]}',
        '{"t": 0, "tick": 0, "odometry": [0, 0, 0], "ranges": [""]}',
    ],
)
def test_a_line_that_no_run_wrote_is_a_sentence(tmp_path: Path, line: str) -> None:
    (tmp_path / "r1.jsonl").write_text(line + "\n")
    with pytest.raises(NoRunError, match=r"r1.jsonl: no scans of a run, or damaged"):
        list(kept_scans(tmp_path / "r1.jsonl", 1))


def test_a_run_without_scans_says_what_to_do(tmp_path: Path) -> None:
    out = run(tmp_path, TURTLEBOT)
    file = out / "scans" / "r2.jsonl"
    file.write_text(file.read_text()[:-30])
    with pytest.raises(NoRunError, match=r"r2.jsonl: no scans of a run, or damaged"):
        write_carmen(out, tmp_path / "logs")
    for name in ("r1", "r2"):
        (out / "scans" / f"{name}.jsonl").unlink()
    with pytest.raises(NoRunError, match="--set scans=true"):
        write_carmen(out, tmp_path / "logs")


def test_a_way_that_never_ends_is_not_waited_for(tmp_path: Path) -> None:
    out = run(tmp_path, TURTLEBOT)
    way = out / "trajectories" / "r1.tum"
    way.unlink()
    os.mkfifo(way)
    with pytest.raises(NoRunError, match=r"no true way for each scan of r1\.jsonl: this is no file"):
        write_carmen(out, tmp_path / "logs")
    for told, why in (("", r"r1\.tum holds no pose"), ("0 1e300 0 0 0 0 0 1\n" * 30, "a number in it is not finite")):
        way.unlink()
        way.write_text(told)
        with pytest.raises(NoRunError, match=f"no true way for each scan of r1\\.jsonl: {why}"):
            write_carmen(out, tmp_path / "logs")
