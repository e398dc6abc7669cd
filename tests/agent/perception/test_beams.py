"""A lidar that turns while its robot drives: each beam from where it was taken, nothing said of what was not seen."""

import math

import numpy as np
import pytest

from agent.corner_scan import CornerScan
from agent.mapping.views import MARGIN_M, THROUGH, UNSEEN, look_at, view_of
from agent.perception.beams import ring_of
from agent.perception.config import PerceptionConfig
from agent.perception.perceive import Perception, perceive
from protocol.geometry import pose_of, relative
from protocol.messages import LidarSpec, Observation
from protocol.wireframe import Wireframe
from tests.ideal import ideal_lidar, ideal_spec
from world.lidar.lidar import Lidar
from world.worldfile import load

TURNING = ideal_lidar(turning=True, noise_m=0.0)
ROOM = np.array([(-1.0, -1, 3, -1), (3, -1, 3, 2), (3, 2, -1, 2), (-1, 2, -1, -1)])
PERIOD_S = 0.2


def way_of(end: np.ndarray, speed: float, turn: float, steps: int = 5, period_s: float = PERIOD_S) -> np.ndarray:
    """(steps + 1, 3) poses of a period at constant speed (m/s) and turn rate (rad/s) that ends at a pose (3,)."""
    back = period_s * np.linspace(-1, 0, steps + 1)
    theta = end[2] + turn * back
    chord = speed * back * np.sinc(turn * back / 2 / math.pi)
    middle = end[2] + 0.5 * turn * back
    return np.column_stack((end[0] + chord * np.cos(middle), end[1] + chord * np.sin(middle), theta))


def taken(walls: np.ndarray, spec: LidarSpec, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ranges (beams,) of one revolution along a way, and the walls met, each beam cast on its own."""
    at = np.linspace(0, 1, len(way))
    poses = np.column_stack([np.interp(spec.moments(), at, column) for column in way.T])
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    poses[:, 0] += c * spec.mount_x_m - s * spec.mount_y_m
    poses[:, 1] += s * spec.mount_x_m + c * spec.mount_y_m
    poses[:, 2] += spec.bearings()
    ranges, met = Lidar(walls, ideal_lidar(beams=8, range_max_m=spec.range_max_m)).trace(poses)
    return ranges[:, 0], met[:, 0]


def scan_of(walls: np.ndarray, spec: LidarSpec, way: np.ndarray) -> CornerScan:
    return perceive(taken(walls, spec, way)[0], ideal_spec(lidar=spec), way=way)


def off_the_walls(scan: CornerScan, walls: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """(k, 2) distance of each end of the scan's walls from the nearest true wall's line, metres."""
    wireframe = scan.wireframe()
    c, s = math.cos(pose[2]), math.sin(pose[2])
    points = wireframe.points @ np.array(((c, s), (-s, c))) + pose[:2]
    along = walls[:, 2:] - walls[:, :2]
    along /= np.hypot(*along.T)[:, None]
    off = (points[:, None] - walls[:, :2]) @ np.array(((0, -1), (1, 0)))
    return np.abs((off * along).sum(2)).min(1)[wireframe.edges]


@pytest.mark.parametrize("turn", [0.0, 2.8, -2.8])
@pytest.mark.parametrize("clockwise", [False, True])
def test_a_room_is_seen_as_straight_from_a_robot_that_drives_and_turns(turn: float, clockwise: bool) -> None:
    end = np.array((0.5, 0.3, 0.7))
    way = way_of(end, 0.22, turn)
    spec = TURNING.model_copy(update={"clockwise": clockwise, "mount_x_m": -0.03, "mount_yaw_deg": 20.0})
    scan = scan_of(ROOM, spec, way)
    assert len(scan.pieces) >= 4
    assert off_the_walls(scan, ROOM, end).max() < 0.002
    if turn:
        still = perceive(taken(ROOM, spec, way)[0], ideal_spec(lidar=spec))
        assert off_the_walls(still, ROOM, end).max() > 0.1


@pytest.mark.parametrize("turn", [0.0, 2.8, -2.8])
def test_a_scan_after_a_missed_one_is_unrolled_too(turn: float) -> None:
    """It was not: every scan of a robot whose driver passes on each second one had corners 6 to 11 cm off."""
    end = np.array((0.5, 0.3, 0.7))
    revolution = way_of(end, 0.22, turn)
    before = revolution[0] - 2 * (revolution[1] - revolution[0])  # wherever it was when the scan before was taken
    way = np.array([relative(pose_of(before), pose_of(pose)) for pose in (before, *revolution[1:])])
    ranges = taken(ROOM, TURNING, revolution)[0]
    sight = Perception(PerceptionConfig(), ideal_spec(lidar=TURNING), alone=True)
    seen = Observation(tick=7, odometry=pose_of(end), ranges=ranges.astype("<f4").tobytes())
    scan = sight.see(seen, way, pose_of(before), Wireframe())
    assert len(scan.pieces) >= 4
    assert off_the_walls(scan, ROOM, end).max() < 0.002


@pytest.mark.parametrize("turn", [0.0, 0.5, -0.5])
def test_a_scan_after_a_missed_one_is_unrolled_by_one_pose_a_scan(turn: float) -> None:
    """It was taken for that of a robot that stood: corners were up to 16 cm off."""
    end = np.array((0.5, 0.3, 0.7))
    both = way_of(end, 0.22, turn, steps=10, period_s=2 * PERIOD_S)
    way = np.array([relative(pose_of(both[0]), pose_of(pose)) for pose in both[[0, -1]]])
    ranges = taken(ROOM, TURNING, both[5:])[0].astype("<f4").tobytes()
    sight = Perception(PerceptionConfig(), ideal_spec(lidar=TURNING), alone=True)
    for tick in (5, 7):
        seen = Observation(tick=tick, odometry=pose_of(end), ranges=ranges)
        scan = sight.see(seen, way, pose_of(both[0]), Wireframe())
    assert len(scan.pieces) >= 4
    assert off_the_walls(scan, ROOM, end).max() < 0.005


def test_a_scan_at_one_instant_needs_no_way() -> None:
    spec = ideal_lidar(noise_m=0.0)
    way = way_of(np.zeros(3), 0.22, 2.8)
    ranges = Lidar(ROOM, spec).cast(np.zeros((1, 3)))[0]
    with_way, without = perceive(ranges, ideal_spec(lidar=spec), way=way), perceive(ranges, ideal_spec(lidar=spec))
    assert (with_way.pieces == without.pieces).all()


@pytest.mark.parametrize("turn", [2.8, -2.8])
def test_each_direction_is_in_the_ring_once(turn: float) -> None:
    way = way_of(np.zeros(3), 0.0, turn)
    beams = ring_of(taken(ROOM, TURNING, way)[0], TURNING, way)
    apart = np.diff(np.append(beams.bearings, beams.bearings[0] + 2 * math.pi))
    assert (apart > 0).all()
    assert (apart < 2 * beams.step).all()
    not_measured = np.isnan(beams.ranges).sum() * beams.step
    assert not_measured == pytest.approx(PERIOD_S * 2.8 if turn < 0 else beams.step, abs=2 * beams.step)


@pytest.mark.parametrize("field_of_view", [180.0, 270.0])
def test_of_what_lies_behind_a_limited_field_of_view_nothing_is_known(field_of_view: float) -> None:
    first = -field_of_view / 2
    spec = TURNING.model_copy(update={"beams": 180, "field_of_view_deg": field_of_view, "first_beam_deg": first})
    view = view_of(scan_of(ROOM, spec, way_of(np.zeros(3), 0.1, 0.3)), (0.0, 0.0, 0.0), MARGIN_M)
    bearings = np.radians(np.arange(-180, 180, 5))
    saw = np.array([look_at(0.5 * math.cos(b), 0.5 * math.sin(b), view, 0.0)[0] for b in bearings])
    beside = math.radians(field_of_view / 2)
    assert (saw[np.abs(bearings) > beside] == UNSEEN).all()
    assert (saw[np.abs(bearings) < beside - 0.1] == THROUGH).mean() > 0.8  # but for the corners of the room


@pytest.mark.parametrize("name", ["office", "apartment"])
def test_no_wall_is_seen_through_from_a_robot_that_drives_and_turns(name: str) -> None:
    """Near edges hide another part of what is behind from each beam's origin than from the stamp."""
    world, rng = load(name), np.random.default_rng(6)
    through, looked, missed = 0, 0, 0
    for pose in world.starts(40, 0.12, rng):
        way = way_of(pose, rng.uniform(-0.5, 0.5), rng.uniform(-2.8, 2.8))
        ranges, met = taken(world.segments, TURNING, way)
        view = view_of(perceive(ranges, ideal_spec(lidar=TURNING), way=way), tuple(pose), MARGIN_M)
        for wall in np.unique(met[met >= 0]):
            a, b = world.segments[wall, :2], world.segments[wall, 2:]
            for share in np.linspace(0, 1, 12)[1:-1]:
                saw, _ = look_at(*(a + share * (b - a)), view, 0.0)
                through, looked, missed = through + (saw == THROUGH), looked + 1, missed + (saw == UNSEEN)
    assert looked > 2000
    assert missed < 0.6 * looked
    assert through == 0


def test_a_teammate_is_a_disc_though_the_robot_turns() -> None:
    walls, spec = ROOM, ideal_spec(lidar=TURNING)
    sides = np.arange(24) * 2 * math.pi / 24
    ring = np.column_stack((0.2 + 0.105 * np.cos(sides), 1.1 + 0.105 * np.sin(sides)))
    mate = np.column_stack((np.roll(ring, -1, 0), ring))
    for turn in (0.0, 2.8, -2.8):
        way = way_of(np.array((0.2, 0.1, 0.4)), 0.22, turn)
        scan = perceive(taken(np.vstack((walls, mate)), TURNING, way)[0], spec, way=way)
        c, s = math.cos(0.4), math.sin(0.4)
        at = np.array((s, c))
        assert np.linalg.norm(scan.discs - at, axis=1).min() < 0.02, turn


def test_a_teammate_close_by_is_a_disc_though_parallax_leaves_gaps_beside_it() -> None:
    """From where its beam was taken a robot looked past a teammate elsewhere than from the scan's stamp."""
    found, rng, room = 0, np.random.default_rng(0), 3.0 * ROOM
    spec = ideal_spec(lidar=TURNING.model_copy(update={"noise_m": 0.01}))
    sides = np.arange(24) * 2 * math.pi / 24
    for bearing in np.linspace(0.0, 2 * math.pi, 40, endpoint=False):
        way = way_of(np.array((2.0, 1.0, 0.4)), 0.22, rng.uniform(-2.8, 2.8))
        distance = rng.uniform(0.25, 0.6)
        at = distance * np.array((math.cos(bearing), math.sin(bearing)))
        c, s = math.cos(0.4), math.sin(0.4)
        ring = way[-1, :2] + at @ np.array(((c, s), (-s, c)))
        ring = ring + 0.105 * np.column_stack((np.cos(sides), np.sin(sides)))
        ranges = taken(np.vstack((room, np.column_stack((np.roll(ring, -1, 0), ring)))), TURNING, way)[0]
        discs = perceive(ranges + rng.normal(0.0, 0.01, ranges.shape), spec, way=way).discs
        found += np.hypot(*(discs - at).T).min(initial=1.0) < 0.03
    assert found >= 36
