"""Several logs as a team: who hears whom, and what becomes of their maps."""

import gzip
import json
import math
from pathlib import Path

import numpy as np
import pytest

from agent.config import AgentConfig
from agent.passenger import carried
from deploy.bench.rings import laps, ring
from deploy.recorded.lidar_log import LidarLog, Scan
from deploy.recorded.mapping import map_logs
from deploy.recorded.team import cut, play, refer
from protocol.arrays import Floats
from protocol.errors import InputError
from protocol.geometry import apply, pose_of, relative
from tests.carried import DRIFT, HALF_TURN, observations, outline, ring_corridor

SIDE = 14.0


def drive(walls: Floats, way: Floats, seed: int, *, begin_s: float = 0.0, told: bool = True) -> LidarLog:
    """The log of a drive, a scan a second, with its true places as reference where it is told."""
    seen = observations(walls, way, HALF_TURN, DRIFT, seed)
    scans = [Scan(k, begin_s + k, one.scan(), one.odometry) for k, one in enumerate(seen)]
    reference = {k: (x, y) for k, (x, y) in enumerate(way[:, :2].tolist())} if told else {}
    return LidarLog(HALF_TURN, f"drive {seed}", scans, reference=reference)


def ways() -> tuple[Floats, Floats]:
    """One and a half laps through a ring; and one lap, half a side ahead of it."""
    way = laps(SIDE, 2.2, 1.5, 0.5)
    return way, way[len(way) // 12 : len(way) * 3 // 4]


def furnished(side: float, seed: int) -> Floats:
    """(n, 4) walls of a ring with cupboards along its outer sides, of other sizes at other places for each seed."""
    rng, walls = (
        np.random.default_rng(seed),
        [np.array(wall) for part in ring(side, 2.2, niches=False) for wall in outline(*part)],
    )
    for k in range(4):
        turn = 0.5 * math.pi * k
        middle = np.array((0.5 * side, 0.5 * side))
        for low in np.arange(1.0, side - 2.0, 1.8) + rng.uniform(0, 0.5):
            wide, deep = rng.uniform(0.5, 1.3), rng.uniform(0.25, 0.6)
            box = np.array(((low, 0.0), (low, deep), (low + wide, deep), (low + wide, 0.0)))
            corners = apply((0.0, 0.0, turn), box - middle) + middle
            walls += outline(*map(tuple, corners.tolist()))
    return np.array(walls)


def both_ways(*, told: bool = True) -> list[LidarLog]:
    """The logs of both. Among cupboards 0 a quarter turn fits nearly as well, so one of the two may stay in doubt."""
    return [drive(furnished(SIDE, 2), way, 1 + k, told=told) for k, way in enumerate(ways())]


def said(out: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in (out / "events.jsonl").read_text().splitlines()]


def test_logs_of_one_building_merge_where_they_fit(tmp_path: Path) -> None:
    summary = map_logs(both_ways(), AgentConfig(), tmp_path, range_m=8.0, quiet=True)
    starts = [pose_of(way[0]) for way in ways()]
    for here, there in ((0, 1), (1, 0)):
        found = summary["robots"][f"r{here + 1}"]["merged"][f"r{there + 1}"]
        true = relative(starts[here], starts[there])
        assert math.dist(found[:2], true[:2]) < 0.5 and abs(math.remainder(found[2] - true[2], 2 * math.pi)) < 0.05
    assert {event["event"] for event in said(tmp_path)} >= {"contact", "proposed", "accepted"}
    for robot in ("r1", "r2"):
        merged, own = (json.loads((tmp_path / "maps" / f"{robot}{end}.json").read_text()) for end in ("", ".own"))
        assert len(merged["edges"]) >= len(own["edges"]) > 10


def test_without_sharing_maps_are_told_and_nothing_is_made_of_them() -> None:
    alone = AgentConfig.model_validate({"cooperation": {"sharing": False}})
    for player in play([log.part(0, 44, "begin") for log in both_ways()], carried(alone), 8.0, lambda *_: None):
        assert player.mind.exchange._known and all(known.maps for known in player.mind.exchange._known.values())
        assert player.events and {event["event"] for event in player.events} <= {"contact", "lost"}


def test_what_is_on_trial_at_the_end_is_judged_by_the_last_maps() -> None:
    """They have grown by too little to be aligned in a drive that goes on."""
    first, _ = play([log.part(8, 50, "begin") for log in both_ways()], carried(AgentConfig()), 8.0, lambda *_: None)
    last = first.events[-1]
    assert (last["event"], last["tick"], last["peer"]) == ("accepted", 41, "r2")
    assert [peer.log.name for peer in first.mind.team.merged] == ["r2"]


def test_transforms_are_fitted_on_the_last_own_maps() -> None:
    """Loops that were closed since a peer was heard have moved the own walls."""
    for player in play(both_ways(), carried(AgentConfig()), 8.0, lambda *_: None):
        assert [(peer.updated, peer.refused) for peer in player.mind.team.merged] == [(player.ticks[-1], 0)]


def test_nobody_is_heard_from_out_of_range() -> None:
    players = play(both_ways(), carried(AgentConfig()), 0.1, lambda robot, done: None)
    assert all(player.sent_bytes > 0 and player.received_bytes == 0 and not player.events for player in players)


def test_without_a_reference_all_hear_each_other() -> None:
    logs = [log.part(0, 20, "begin") for log in both_ways(told=False)]
    players = play(logs, carried(AgentConfig()), 0.1, lambda *_: None)
    assert all(player.received_bytes > 0 for player in players)


def test_logs_of_two_buildings_stay_apart(tmp_path: Path) -> None:
    other = drive(furnished(SIDE, 1), ways()[0], 3, told=False)
    summary = map_logs([both_ways(told=False)[0], other], AgentConfig(), tmp_path, quiet=True)
    assert all(not robot["merged"] for robot in summary["robots"].values())
    assert any(event["event"] == "attempt" for event in said(tmp_path))


def test_logs_that_were_recorded_at_once_are_played_so() -> None:
    walls, way = ring_corridor(SIDE, 2.2), laps(SIDE, 2.2, 0.5, 0.5)
    early, late = drive(walls, way, 1, begin_s=100.0), drive(walls, way, 2, begin_s=110.0)
    later = drive(walls, way, 2, begin_s=100_000.0)
    ticks = [
        [player.ticks[0] for player in play(logs, carried(AgentConfig()), 0.1, lambda *_: None)]
        for logs in ((early, late), (early, later))
    ]
    assert ticks == [[0, 10], [0, 0]]


def along(times: Floats, xs: Floats) -> LidarLog:
    """A log of scans at times (n,) from places x (n,), as its reference tells, too."""
    ways = enumerate(zip(times.tolist(), xs.tolist(), strict=True))
    scans = [Scan(k, t, np.full(HALF_TURN.beams, 2.0), (x, 0.0, 0.0)) for k, (t, x) in ways]
    return LidarLog(HALF_TURN, "along", scans, reference={scan.number: scan.odometry[:2] for scan in scans})


def test_logs_of_different_rates_are_played_by_the_clock() -> None:
    """The slower one has more scans."""
    slow, fast = np.arange(0.0, 3.0, 0.1), np.arange(0.0, 0.5, 0.025)
    players = play([along(slow, slow), along(fast, fast)], carried(AgentConfig()), 4.0, lambda *_: None)
    assert [player.ticks[:3] for player in players] == [[0, 4, 8], [0, 1, 2]]


def test_who_pauses_hears_nothing_meanwhile() -> None:
    """What was said in 4 s was heard at once 50 m away, where the log went on or began."""
    times = np.arange(0.0, 8.0, 0.2)
    stands, late = along(times, 0.0 * times), times[(times < 2.0) | (times >= 6.0)]
    pauses = along(late, np.where(late < 2.0, 1.0, 51.0))
    received = [
        play([stands, log], carried(AgentConfig()), 4.0, lambda *_: None)[1].received_bytes
        for log in (pauses, pauses.part(0, 10, "before"), pauses.part(10, 20, "after"))
    ]
    assert received[0] == received[1] > 0 == received[2]


def test_a_log_is_cut_into_robots_that_keep_the_numbers_of_their_scans() -> None:
    log = drive(ring_corridor(SIDE, 2.2), laps(SIDE, 2.2, 0.5, 0.5), 1)
    log.skipped["lines"] = 3
    parts = cut([log], 3)
    assert [scan.number for part in parts for scan in part.scans] == list(range(len(log.scans)))
    assert max(len(part.scans) for part in parts) - min(len(part.scans) for part in parts) <= 1
    assert [sum(part.skipped.values()) for part in parts] == [3, 0, 0]
    with pytest.raises(InputError, match="too few for 100 parts"):
        cut([log.part(0, 50, "begin")], 100)


def test_places_between_those_that_a_reference_names(tmp_path: Path) -> None:
    log = drive(ring_corridor(SIDE, 2.2), laps(SIDE, 2.2, 0.5, 0.5), 1)
    file = tmp_path / "some.tum"
    file.write_text("10 1 2 0 0 0 0 1\n20 2 2 0 0 0 0 1\n99999 7 7 0 0 0 0 1\n")
    refer([log], [file])
    assert log.places()[[0, 15, -1]].tolist() == [[1, 2], [1.5, 2], [2, 2]]


@pytest.mark.parametrize("content", ["", "1 2 3\n", "1 2 nan 0 0 0 0 1\n", "a b\n"])
def test_what_is_no_reference_is_a_sentence(tmp_path: Path, content: str) -> None:
    file = tmp_path / "some.tum"
    file.write_text(content)
    with pytest.raises(InputError, match=r"some\.tum: no reference poses: .*wanted|some\.tum: .*could not convert"):
        refer(both_ways()[:1], [file])
    with pytest.raises(InputError, match="there are 2 logs and 1 files"):
        refer(both_ways(), [file])


@pytest.mark.parametrize(
    ("number", "said"),
    [
        ("0.2", "a line begins with the number of a scan, counted from 0, and not with 0.2"),
        ("1700000000.2", "and not with 1700000000.2"),
        ("-1", "and not with -1"),
        ("1700000000", "its lines are of scans 1700000000 to 1700000000, and the log has 0 to 1"),
    ],
)
def test_a_reference_by_anything_but_numbers_of_scans_is_a_sentence(tmp_path: Path, number: str, said: str) -> None:
    """Stamps were cut to whole numbers, or the file was dropped without a word."""
    scans = [Scan(k, float(k), np.ones(180), (0.0, 0.0, 0.0)) for k in range(2)]
    (tmp_path / "some.tum").write_text(f"{number} 1 2 0 0 0 0 1\n")
    with pytest.raises(InputError, match=rf"some\.tum: no reference poses: .*{said}$"):
        refer([LidarLog(HALF_TURN, "log", scans)], [tmp_path / "some.tum"])


def test_a_compressed_reference_is_a_sentence(tmp_path: Path) -> None:
    """numpy unpacks by the name: a damaged one ended in a traceback, and a small one may be as large as memory."""
    (tmp_path / "some.tum.gz").write_bytes(gzip.compress(b"10 1 2 0 0 0 0 1\n" * 50)[:-9])
    with pytest.raises(InputError, match=r"some\.tum\.gz: no reference poses: no text in UTF-8"):
        refer(both_ways()[:1], [tmp_path / "some.tum.gz"])
