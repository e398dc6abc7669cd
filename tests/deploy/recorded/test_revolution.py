"""Lidars that turn, in logs that do not say so: how they are recognised, and what they err by."""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely

from agent.config import AgentConfig
from agent.passenger import carried as of_passengers
from deploy.bench.rings import STEP_S, carried
from deploy.recorded.lidar_log import OF_LOGS, LidarLog, Scan
from deploy.recorded.noise import measured_noise
from deploy.recorded.revolution import Revolution, unroll
from deploy.recorded.team import play
from deploy.sensing import REAL
from protocol.arrays import Floats
from protocol.errors import InputError
from protocol.geometry import Pose, pose_of, relative
from protocol.messages import LidarSpec, RobotSpec
from world.worldfile import from_document

ROOMS = from_document(
    {
        "units": "m",
        "boxes": [
            *([x, y, 0.0, 6.1, 0.1] for x, y in ((3, 0), (3, 4))),
            *([x, 2, math.pi / 2, 4.1, 0.1] for x in (0, 6)),
            [3, 3.2, math.pi / 2, 1.6, 0.1],
            [3, 0.75, math.pi / 2, 1.5, 0.1],
            [4.5, 1.5, 0.0, 0.4, 0.4],
        ],
        "spawns": [[1, 1, 0]],
    }
)


def drive() -> Floats:
    """(n, 3) a way around the rooms, with turns on the spot, a pose each STEP_S."""
    corners = [(1.0, 1.0), (2.0, 1.95), (5.2, 1.95), (5.2, 3.2), (3.8, 2.2), (2.0, 2.0), (1.0, 3.0), (1.0, 1.0)]
    way, heading = [np.tile((1.0, 1.0, 0.0), (round(2 / STEP_S), 1))], 0.0
    for (ax, ay), (bx, by) in pairwise(corners):
        turn = math.remainder(math.atan2(by - ay, bx - ax) - heading, 2 * math.pi)
        count = max(2, round(abs(turn) / 1.0 / STEP_S))
        way.append(np.column_stack((np.full((count, 2), (ax, ay)), heading + np.linspace(0, turn, count))))
        heading += turn
        count = round(math.dist((ax, ay), (bx, by)) / 0.2 / STEP_S)
        way.append(np.column_stack((np.linspace((ax, ay), (bx, by), count), np.full(count, heading))))
    return np.concatenate(way)


def recorded(turning: bool, early_s: float = 0.0) -> tuple[LidarLog, Floats]:
    """What a log without a word on its lidar tells of that drive, and the true poses (n, 3) at the ends of its scans.

    early_s: 0, or the time from scan to scan, by which stamps, and the odometry, are earlier.
    """
    spec = RobotSpec.model_validate(REAL | {"lidar": REAL["lidar"] | {"turning": turning}})
    log, true = LidarLog(LidarSpec(range_max_m=spec.lidar.range_max_m, **OF_LOGS), "drive"), []
    before: Pose | None = None
    for seen, place in carried(ROOMS, drive(), spec, 3):
        pose = before if early_s and before is not None else seen.odometry
        log.add(Scan(seen.tick, 0.2 * seen.tick - early_s, log.lidar.cleaned(seen.scan()), pose))
        true.append(place)
        before = seen.odometry
    return log, np.array(true)


def off_m(log: LidarLog, true: Floats) -> float:
    """Metres that the mapped path is off, rms, in the frame of its first pose."""
    (player,) = play([log], of_passengers(AgentConfig()), math.inf, lambda *_: None)
    places = np.array([relative(pose_of(true[0]), pose_of(pose)) for pose in true])
    return float(np.sqrt(((player.mind.path()[:, :2] - places[:, :2]) ** 2).sum(1).mean()))


@pytest.mark.parametrize("early_s", [0.0, 0.2])
@pytest.mark.parametrize("backwards", [False, True])
def test_a_lidar_that_turns_is_recognised_and_mapped_as_if_it_had_said_so(early_s: float, backwards: bool) -> None:
    """early_s: by which stamps are before the end of the scan, as those of ROS are at its begin."""
    log, true = recorded(turning=True, early_s=early_s)
    if backwards:
        told_so = Revolution(0.2, backwards=True)
        unroll(log, told_so, None)
        log.lidar = log.lidar.model_copy(update={"turning": False})
        log.scans = [scan._replace(way=None) for scan in log.scans]
    as_one_moment = off_m(log, true)
    unroll(log, None, None)
    where = "from each stamp" if early_s else "up to each stamp"
    assert log.lidar.turning and f"for 0.20 s {where}" in log.notes[0]
    assert ("against the order" in log.notes[0]) == backwards
    measured_noise(log)
    assert log.lidar.noise_share == pytest.approx(0.0175, abs=0.002)
    unrolled_m = off_m(log, true)
    assert unrolled_m < 0.03 and unrolled_m < 0.7 * as_one_moment


def test_the_map_of_a_lidar_of_short_range_has_no_wall_across_a_door() -> None:
    """Hits 2 m apart on a line were one wall, also of a lidar that reaches 3.5 m."""
    log, true = recorded(turning=True)
    unroll(log, None, None)
    (player,) = play([log], of_passengers(AgentConfig()), math.inf, lambda *_: None)
    start, ends = pose_of(true[0]), player.mind.drawn().segments().reshape(-1, 2, 2)
    walls = shapely.union_all(shapely.linestrings(ends))
    x, y, _ = relative(start, (3.0, 1.95, 0.0))
    assert walls.distance(shapely.Point(x, y)) > 0.3  # in the doorway of 0.9 m
    x, y, _ = relative(start, (3.0, 3.2, 0.0))
    assert walls.distance(shapely.Point(x, y)) < 0.15


def test_scans_of_one_moment_stay_so_unless_the_user_says_otherwise() -> None:
    log, _ = recorded(turning=False)
    unroll(log, None, None)
    assert not log.lidar.turning and not log.notes and all(scan.way is None for scan in log.scans)
    unroll(log, None, 0.1)
    assert log.lidar.turning and "for 0.10 s" in log.notes[0]


def test_who_looks_ahead_or_stands_tells_nothing() -> None:
    ahead, _ = recorded(turning=True)
    ahead.lidar = ahead.lidar.model_copy(update={"beams": 180, "field_of_view_deg": 180.0})
    ahead.scans = [scan._replace(ranges=scan.ranges[:180]) for scan in ahead.scans]
    stands, _ = recorded(turning=True)
    stands.scans = [scan._replace(odometry=(0.0, 0.0, 0.0)) for scan in stands.scans]
    for log in (ahead, stands, LidarLog(ahead.lidar, "empty")):
        unroll(log, None, None)
        assert not log.lidar.turning and not log.notes


@pytest.mark.parametrize(("from_stamp", "first"), [(False, 0.5), (True, 0.75)])
def test_where_scans_do_not_show_it_stamps_are_taken_as_they_should_be(from_stamp: bool, first: float) -> None:
    lidar = LidarSpec(beams=8, field_of_view_deg=180.0, first_beam_deg=-90.0, turning=False)
    log = LidarLog(lidar, "three")
    for k in range(3):
        log.add(Scan(k, float(k), np.ones(8), (float(k), 0.0, 0.0)))
    unroll(log, None, 0.5, from_stamp)
    way = log.scans[1].way
    assert way is not None and way[0, 0] == pytest.approx(first) and way[-1, 0] == pytest.approx(first + 0.5)


def test_a_revolution_that_takes_longer_than_from_scan_to_scan_is_refused() -> None:
    log = LidarLog(LidarSpec(beams=8, field_of_view_deg=180.0, turning=False), "three")
    for k in range(3):
        log.add(Scan(k, 0.2 * k, np.ones(8), (float(k), 0.0, 0.0)))
    with pytest.raises(InputError, match=r"^--revolution 2: scans are 0.2 s apart; give at most that$"):
        unroll(log, None, 2.0)
    unroll(log, None, 0.21)  # as near as a lidar's speed is
    assert log.lidar.turning


def test_readings_that_are_told_backwards_come_in_the_order_in_which_they_were_taken() -> None:
    lidar = LidarSpec(beams=8, field_of_view_deg=180.0, first_beam_deg=-90.0, turning=False)
    log = LidarLog(lidar, "backwards")
    for k in range(2):
        log.add(Scan(k, float(k), np.arange(1.0, 9.0), (0.0, 0.0, 0.0)))
    unroll(log, Revolution(0.2, backwards=True), 0.5)  # the user tells for how long, and the log in which order
    assert log.scans[1].ranges.tolist() == list(range(8, 0, -1))
    assert log.lidar.bearings() == pytest.approx(lidar.bearings()[::-1]) and log.lidar.turning


def test_scans_of_one_stamp_are_taken_where_odometry_has_them() -> None:
    log = LidarLog(LidarSpec(beams=8, turning=False), "seconds")
    for k in range(9):
        log.add(Scan(k, float(k // 3), np.ones(8), (0.1 * k, 0.0, 0.0)))
    unroll(log, Revolution(0.2), None)
    assert log.notes == ["9 scans share their stamp with another, and are taken as of one moment"]
    assert all(scan.way is not None and (scan.way[:, 0] == scan.odometry[0]).all() for scan in log.scans)


@pytest.mark.parametrize(("share", "constant_m", "beams"), [(0.02, 0.0, 360), (0.0, 0.01, 360), (0.0, 0.01, 90)])
def test_noise_is_told_apart_from_walls_and_from_a_constant_part(share: float, constant_m: float, beams: int) -> None:
    rng, lidar = np.random.default_rng(0), LidarSpec(beams=beams, turning=False, range_max_m=12.0, noise_share=0.0)
    log, bearings = LidarLog(lidar, "square room"), lidar.bearings()
    walls = 4.0 / np.maximum(np.abs(np.cos(bearings)), np.abs(np.sin(bearings)))
    for k in range(200):
        ranges = walls * (1 + share * rng.standard_normal(beams)) + constant_m * rng.standard_normal(beams)
        ranges[:: 1 + beams // 4] = 0.0  # not measured
        log.add(Scan(k, float(k), ranges, (0.0, 0.0, 0.0)))
    measured_noise(log)
    assert log.lidar.noise_share == pytest.approx(share, abs=0.001)


@pytest.mark.parametrize(
    ("share", "constant_m", "clutter_m", "told"),
    [(0.02, 0.0, 0.0, 0.02), (0.0, 0.03, 0.0, 0.0), (0.0, 0.003, 0.15, 0.0)],
    ids=["a share", "constant", "a cluttered room"],
)
def test_noise_of_a_lidar_of_270_degrees_is_told_apart_from_a_room(
    share: float, constant_m: float, clutter_m: float, told: float
) -> None:
    rng = np.random.default_rng(0)
    lidar = LidarSpec(beams=270, field_of_view_deg=270.0, turning=False, range_max_m=12.0, noise_share=0.0)
    log, bearings = LidarLog(lidar, "long room"), lidar.bearings()
    walls = 2.0 / np.maximum(0.25 * np.abs(np.cos(bearings)), np.abs(np.sin(bearings)))
    walls *= np.exp(-clutter_m * rng.standard_exponential(270) ** 3)  # things that stand before the walls
    for k in range(200):
        ranges = walls * (1 + share * rng.standard_normal(270)) + constant_m * rng.standard_normal(270)
        log.add(Scan(k, float(k), ranges, (0.0, 0.0, 0.0)))
    measured_noise(log)
    assert log.lidar.noise_share == pytest.approx(told, abs=0.001)
