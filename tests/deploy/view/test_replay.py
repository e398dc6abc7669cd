"""A finished run as a Rerun recording, read back by Rerun's reader."""

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rerun", reason="the extra view is not installed")

from deploy.view.command import save
from deploy.view.replay import record
from protocol.errors import InputError
from tests.deploy.test_report import STARTS, write_run
from tests.deploy.view.read_back import Rows, read_back, strict
from world.recorder import REPLACED


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = write_run(tmp_path_factory.mktemp("replay") / "run")
    more = [
        {"t": 20.0, "robot": "r1", "event": "proposed", "peer": "r2", "transform": [4.0, 1.0, 1.5], "inliers": 7},
        {"t": 40.0, "robot": "r1", "event": "lost", "peer": "r2"},
        {"t": 50.0, "robot": "r1", "event": "unmerged", "peer": "r2", "reason": "it contradicts"},
        {"t": 55.0, "robot": "r1", "event": "frontier", "what": "chosen"},
        {"t": 56.0, "robot": "ghost", "event": "proposed", "peer": ["r1"], "transform": "here"},
    ]
    events = [json.loads(line) for line in (path / "events.jsonl").read_text().splitlines()]
    lines = (json.dumps(event) + "\n" for event in sorted(events + more, key=lambda event: event["t"]))
    (path / "events.jsonl").write_text("".join(lines))
    (path / "scans").mkdir()
    scans = ({"t": 0.2 * k, "tick": k, "odometry": [0, 0, 0], "ranges": [None, -1, *[1.0] * 358]} for k in range(11))
    (path / "scans" / "r2.jsonl").write_text("".join(json.dumps(scan) + "\n" for scan in scans))
    return path


@pytest.fixture(scope="module")
def found(run: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Rows]:
    file = tmp_path_factory.mktemp("recording") / "run.rrd"
    with strict():
        record(run, file)
    return read_back(file)


def test_every_event_is_a_line_of_the_log_at_its_tick(run: Path, found: dict[str, Rows]) -> None:
    events = [json.loads(line) for line in (run / "events.jsonl").read_text().splitlines()]
    assert len(events) == 8
    ticks = [tick for tick, values in found["events"]["TextLog:text"].items() for _ in values]
    assert sorted(ticks) == sorted(round(event["t"] / 0.2) for event in events)
    assert found["events"]["TextLog:text"][100] == [["r1 proposes how r2's map fits; 7 corners fit"]]
    assert found["events"]["TextLog:level"][250] == [["WARN"]]
    assert found["events"]["TextLog:level"][275] == [["DEBUG"]]


@pytest.mark.parametrize("robot", STARTS)
def test_robots_are_where_they_were_at_every_tick(run: Path, found: dict[str, Rows], robot: str) -> None:
    true = np.loadtxt(run / "trajectories" / f"{robot}.tum")
    places = found[f"world/{robot}"]["Transform3D:translation"]
    assert list(places) == list(range(len(true)))
    assert np.array([value[0][0] for value in places.values()])[:, :2] == pytest.approx(true[:, 1:3], abs=1e-6)


def test_a_map_grows_with_the_labels_of_its_vertices(found: dict[str, Rows]) -> None:
    walls, labels = (
        found["world/maps/r1/own"]["LineStrips3D:strips"],
        found["world/maps/r1/vertices"]["Points3D:class_ids"],
    )
    assert [len(walls[50 * k][0]) for k in range(7)] == [1, 2, 3, 4, 5, 6, 8]
    assert labels[50] == [[1, 0, 2]]
    assert labels[300] == [[0] * 8]
    x, y = STARTS["r1"][:2]
    assert found["world/maps/r1"]["Transform3D:translation"][None] == [[pytest.approx([x, y, 0.0])]]


def test_a_proposal_stands_while_it_is_on_trial_and_names_tell_whom_a_robot_trusts(found: dict[str, Rows]) -> None:
    trial, names = found["world/trials/r1/r2"], found["world/r1/name"]["Points3D:labels"]
    assert len(trial["LineStrips3D:strips"][100][0]) == 3  # r2's map of that time
    assert trial["LineStrips3D:labels"][100] == [["r1 tries r2: 7 corners fit"]]
    assert trial["LineStrips3D:strips"][150] == [[]]
    told = {0: "r1", 100: "r1: tries r2", 150: "r1: merged r2", 250: "r1"}
    assert names == {tick: [[name]] for tick, name in told.items()}


def test_a_line_joins_robots_while_they_hear_each_other(found: dict[str, Rows]) -> None:
    links = found["world/radio"]["LineStrips3D:strips"]
    assert [len(links[tick][0]) for tick in (14, 15, 199, 200)] == [0, 1, 1, 0]
    ends = [found[f"world/{robot}"]["Transform3D:translation"][15][0][0][:2] for robot in STARTS]
    assert np.array(links[15][0][0])[:, :2] == pytest.approx(np.array(ends))


def test_a_robot_whose_process_is_another_hears_has_merged_and_tries_nobody(tmp_path: Path) -> None:
    path = write_run(tmp_path / "run")
    told = [
        (10.0, {"event": "contact", "peer": "r1"}),
        (12.0, {"event": "accepted", "peer": "r1"}),
        (20.0, {"event": "proposed", "peer": "r1", "transform": [0, 0, 0]}),
        (30.0, {"event": "rejoined", "reason": REPLACED}),
    ]
    (path / "events.jsonl").write_text("".join(json.dumps({"t": t, "robot": "r2"} | one) + "\n" for t, one in told))
    record(path, tmp_path / "run.rrd")
    found = read_back(tmp_path / "run.rrd")
    links = found["world/radio"]["LineStrips3D:strips"]
    assert [len(links[tick][0]) for tick in (49, 50, 149, 150)] == [0, 1, 1, 0]
    trial, names = (found[path] for path in ("world/trials/r2/r1", "world/r2/name"))
    assert trial["LineStrips3D:strips"][100] != [[]] == trial["LineStrips3D:strips"][150]
    told_of = {0: "r2", 60: "r2: merged r1", 100: "r2: merged r1; tries r1", 150: "r2"}
    assert names["Points3D:labels"] == {tick: [[name]] for tick, name in told_of.items()}


def test_beams_that_met_something_are_drawn_once_a_second(found: dict[str, Rows]) -> None:
    beams = found["world/r2/beams"]["LineStrips3D:strips"]
    assert list(beams) == [0, 5, 10]
    assert len(beams[0][0]) == 89  # of each fourth of 360, all but the first
    assert np.hypot(*np.array(beams[0][0])[:, 1, :2].T) == pytest.approx(1.0)


@pytest.mark.parametrize("ticks", [[], [3]])
def test_scans_of_which_none_is_drawn_are_no_error(tmp_path: Path, ticks: list[int]) -> None:
    path = write_run(tmp_path / "run")
    (path / "scans").mkdir()
    scans = ({"t": 0.2 * k, "tick": k, "odometry": [0, 0, 0], "ranges": [1.0] * 360} for k in ticks)
    (path / "scans" / "r2.jsonl").write_text("".join(json.dumps(scan) + "\n" for scan in scans))
    record(path, tmp_path / "run.rrd")
    assert "world/r2/beams" not in read_back(tmp_path / "run.rrd")


def test_coverage_of_robots_and_team_is_a_curve(found: dict[str, Rows]) -> None:
    assert found["coverage/team"]["Scalars:scalars"][100] == [[pytest.approx(20 / 35)]]
    assert len(found["coverage/r1"]["Scalars:scalars"]) == 61


def test_a_recording_takes_the_place_of_another_and_of_nothing_else(run: Path, tmp_path: Path) -> None:
    for _ in range(2):
        save(run, tmp_path / "run.rrd")
    (mine := tmp_path / "manifest.json").write_text("{}")
    with pytest.raises(InputError, match="what is there already is no recording; name another file"):
        save(run, mine)
    assert mine.read_text() == "{}"


def test_paths_without_a_pose_are_said(tmp_path: Path) -> None:
    for file in (path := write_run(tmp_path / "run")).glob("trajectories/*"):
        file.write_text("")
    with pytest.raises(InputError, match=r"no paths to be drawn: no file in trajectories/ holds a pose$"):
        record(path, tmp_path / "run.rrd")


def test_without_a_world_there_is_nothing_to_replay(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text("{}")
    with pytest.raises(InputError, match="no world"):
        record(tmp_path, tmp_path / "run.rrd")
    with pytest.raises(InputError, match="no run directory"):
        record(tmp_path / "absent", tmp_path / "run.rrd")
