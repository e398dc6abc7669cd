"""A run as MCAP, read back by the MCAP project's own reader."""

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from deploy.exchange.mcap import write_mcap
from protocol.errors import InputError
from protocol.geometry import apply
from tests.deploy.test_report import RING, STARTS, write_run


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = write_run(tmp_path_factory.mktemp("mcap") / "run")
    (path / "scans").mkdir()
    scan = {"t": 0.4, "tick": 2, "odometry": [0, 0, 0], "ranges": [None, -1, *[1.5] * 358]}
    (path / "scans" / "r2.jsonl").write_text(json.dumps(scan) + "\n")
    return path


@pytest.fixture(scope="module")
def topics(run: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[tuple[int, Any]]]:
    """By topic, log times (ns) and messages."""
    (file,) = write_mcap(run, tmp_path_factory.mktemp("out"))
    found = defaultdict(list)
    wanted = ["/tf", "/frames", "/walls", "/maps/r1", "/events", "/scan/r2"]
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages(topics=wanted):
            found[channel.topic].append((message.log_time, decoded))
    return found


def test_robots_and_frames_are_where_they_are(run: Path, topics: dict[str, list[tuple[int, Any]]]) -> None:
    true = np.loadtxt(run / "trajectories" / "r2.tum")
    told = [(t, one) for t, said in topics["/tf"] for one in said.transforms if one.child_frame_id == "r2"]
    assert [t for t, _ in told] == [round(t * 1e9) for t in true[:, 0]]
    assert np.array([(one.translation.x, one.translation.y) for _, one in told]) == pytest.approx(true[:, 1:3])
    ((_, frames),) = topics["/frames"]
    assert {one.child_frame_id: one.translation.x for one in frames.transforms} == {"r1/map": 1.0, "r2/map": 5.0}


def test_walls_of_a_map_lie_within_a_millimetre(topics: dict[str, list[tuple[int, Any]]]) -> None:
    (entity,) = topics["/maps/r1"][-1][1].entities
    assert entity.frame_id == "r1/map" and len(entity.spheres) == len(RING)
    (walls,) = entity.lines
    points = apply(STARTS["r1"], np.array([[point.x, point.y] for point in walls.points]))
    ring = shapely.Polygon(RING).exterior
    assert len(points) == 2 * len(RING)
    assert shapely.distance(ring, shapely.points(points)).max() < 1e-3
    assert shapely.length(shapely.linestrings(points.reshape(-1, 2, 2))).sum() == pytest.approx(ring.length)


def test_every_event_is_a_line_of_the_log(run: Path, topics: dict[str, list[tuple[int, Any]]]) -> None:
    events = [json.loads(line) for line in (run / "events.jsonl").read_text().splitlines()]
    assert [t for t, _ in topics["/events"]] == [round(event["t"] * 1e9) for event in events]
    assert topics["/events"][0][1].message == "r1 hears r2"


def test_scans_tell_nothing_measured_from_nothing_there(topics: dict[str, list[tuple[int, Any]]]) -> None:
    ((t, scan),) = topics["/scan/r2"]
    assert (t, scan.frame_id, len(scan.ranges)) == (400_000_000, "r2", 360)
    assert np.isnan(scan.ranges[0]) and scan.ranges[1] == np.inf and scan.ranges[2] == 1.5
    assert scan.end_angle - scan.start_angle == pytest.approx(2 * np.pi * 359 / 360)


def test_the_same_run_gives_the_same_bytes(run: Path, tmp_path: Path) -> None:
    first, second = (write_mcap(run, tmp_path / name)[0].read_bytes() for name in ("first", "second"))
    assert first == second


def test_without_a_world_there_is_nothing_to_write(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text("{}")
    with pytest.raises(InputError, match="no world"):
        write_mcap(tmp_path, tmp_path / "out")
    with pytest.raises(InputError, match="no run directory"):
        write_mcap(tmp_path / "absent", tmp_path / "out")
