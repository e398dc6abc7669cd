"""What a ROS 2 robot tells becomes observations; what cannot be used is skipped, counted and said once."""

import math
from typing import Any

import numpy as np
import pytest

from agent.shell.ros2.laser_scan import SET_ANEW
from agent.shell.ros2.sensing import ALIKE, SensedScan, Sensing
from agent.shell.ros2.ticks import EPOCH_S
from protocol.geometry import Pose, relative
from protocol.messages import MAX_TICK, LidarSpec, RobotSpec
from tests.agent.shell.ros2.messages import BEGIN_S, LIDAR, odometry, scan, tilted

TURN_S = 1 / LIDAR.rate_hz
ROBOT = RobotSpec(max_speed_mps=1.0)


class Clock:
    """Seconds that pass when a test says so."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def pose_at(t: float) -> Pose:
    """Ahead at 0.5 m/s from a place far from the odometry's origin, turning a little."""
    return 3.0 + 0.5 * t * math.cos(3.0), -1.0 + 0.5 * t * math.sin(3.0), 3.0 + 0.4 * t


def begun(spec: RobotSpec = ROBOT, lidar: LidarSpec = LIDAR) -> tuple[Sensing, Clock]:
    """One that believes the next scan's lidar."""
    clock = Clock()
    sensing = Sensing(spec, False, clock, wall=lambda: BEGIN_S + 100)
    for k in range(ALIKE - 1):
        sensing.take_scan(scan(BEGIN_S - 1 + 0.1 * k, lidar=lidar))
        assert not sensing.knows_lidar
    return sensing, clock


def feed(sensing: Sensing, times: Any, **more: Any) -> list[SensedScan]:
    """Odometry at 100 Hz and scans whose turns end at times from BEGIN_S on."""
    found = []
    for t in times:
        for k in range(-8, 2):
            if BEGIN_S + t + 0.01 * k > sensing.wheels.until_s:
                sensing.wheels.take(odometry(BEGIN_S + t + 0.01 * k, pose_at(t + 0.01 * k)))
        sensing.take_scan(scan(BEGIN_S + t, **more))
        if (seen := sensing.due()) is not None:
            found.append(seen)
    return found


def test_each_scan_is_a_tick_with_the_odometry_of_its_turn_once_the_lidar_is_known() -> None:
    sensing, _ = begun()
    found = feed(sensing, TURN_S * np.arange(1, 6))
    assert [seen.observation.tick - found[0].observation.tick for seen in found] == [0, 1, 2, 3, 4]
    assert found[0].observation.tick == round((BEGIN_S - EPOCH_S + TURN_S) / TURN_S)
    assert found[0].observation.odometry == pytest.approx((0, 0, 0), abs=1e-9)
    heading, way = 0.4 * TURN_S, 0.5 * 4 * TURN_S  # in the frame of the first scan
    x, y, theta = found[4].observation.odometry
    assert (x, y, theta) == pytest.approx((way * math.cos(-heading), way * math.sin(-heading), 1.6 * TURN_S), abs=1e-6)
    assert found[4].odometry == pytest.approx(pose_at(5 * TURN_S), abs=1e-6)  # as told, for tf
    steps = np.diff(np.vstack((found[3].observation.odometry, found[4].observation.poses())), axis=0)
    assert np.hypot(*steps[:, :2].T) == pytest.approx(0.5 * TURN_S / 5, abs=1e-6)  # between the odometry's messages
    assert not sensing.skipped


def test_the_lidar_is_known_by_scans_that_are_alike_and_its_mount_by_the_settings() -> None:
    known = LidarSpec(mount_x_m=-0.03, noise_share=0.02)
    lidar = LidarSpec(beams=400, turning=True, first_beam_deg=-170, rate_hz=8, range_min_m=0.2, range_max_m=12)
    sensing, _ = begun(RobotSpec(lidar=known), lidar)
    sensing.take_scan(scan(BEGIN_S, lidar=lidar))
    expected = lidar.model_copy(update={"mount_x_m": -0.03, "noise_share": 0.02})
    assert sensing.spec.lidar.bearings() == pytest.approx(expected.bearings(), abs=1e-5)
    assert sensing.spec.lidar.rate_hz == pytest.approx(8, abs=1e-4) and sensing.spec.lidar.turning
    assert (sensing.spec.lidar.mount_x_m, sensing.spec.lidar.noise_share) == (-0.03, 0.02)
    assert (sensing.spec.lidar.range_min_m, sensing.spec.lidar.range_max_m) == pytest.approx((0.2, 12))


@pytest.mark.parametrize("odd", [{"beams": 180, "field_of_view_deg": 180.0}, {"beams": 180}])
def test_a_first_scan_unlike_those_that_follow_is_left_out(odd: dict[str, Any]) -> None:
    """Half a revolution, or fewer beams, held for the whole run: half of each scan was thrown away."""
    sensing = Sensing(ROBOT, False)
    sensing.take_scan(scan(BEGIN_S - TURN_S, lidar=LIDAR.model_copy(update=odd)))
    (seen,) = feed(sensing, TURN_S * np.arange(ALIKE))
    assert len(seen.observation.scan()) == sensing.spec.lidar.beams == LIDAR.beams
    assert sensing.skipped == {"scans of another lidar": 1}


def test_a_lidar_whose_motor_speeds_up_is_believed_once_it_turns_evenly() -> None:
    """The rate of the third scan held for the whole run, and of each five scans three were used."""
    sensing, t = Sensing(ROBOT, False), BEGIN_S
    for turns_hz in (8.0, 12.0, 16.0, 20.3, 19.8, 20.1):
        assert not sensing.knows_lidar and sensing.is_unsure == (t > BEGIN_S)
        t += 1 / turns_hz
        sensing.take_scan(scan(t, lidar=LIDAR.model_copy(update={"rate_hz": turns_hz})))
    assert sensing.spec.lidar.rate_hz == 20 and sensing.skipped == {"scans from before the lidar turned evenly": 3}


def test_of_two_lidars_on_one_topic_one_is_known() -> None:
    sensing, rear = Sensing(ROBOT, False), scan(BEGIN_S, lidar=LIDAR.model_copy(update={"beams": 180}))
    rear.header.frame_id = "rear"
    for k in range(ALIKE):
        sensing.take_scan(scan(BEGIN_S + k * TURN_S))
        sensing.take_scan(rear)
    assert sensing.spec.lidar.beams == LIDAR.beams and sensing.skipped == {"scans of another lidar": ALIKE}


def test_a_direction_that_comes_again_at_the_end_of_a_turn_counts_once() -> None:
    sensing, _ = begun()
    message = scan(BEGIN_S)
    message.ranges = np.full(361, 2.0, np.float32)
    sensing.take_scan(message)
    sensing.wheels.take(odometry(BEGIN_S + 0.1))
    seen = sensing.due()
    assert sensing.spec.lidar.bearings() == pytest.approx(LIDAR.bearings(), abs=1e-5)
    assert seen is not None and len(seen.observation.scan()) == 360


def test_nothing_there_and_nothing_measured_are_told_apart() -> None:
    sensing, _ = begun()
    ranges = np.full(360, 2.0)
    ranges[:6] = 0.0, math.nan, math.inf, -math.inf, 3.6, 0.1
    (seen,) = feed(sensing, [0.0], ranges=ranges)
    read = seen.observation.scan()
    assert np.isnan(read[[0, 1, 3, 5]]).all() and np.isinf(read[[2, 4]]).all() and (read[6:] == 2.0).all()


def test_a_scan_waits_for_odometry_of_its_end_a_while() -> None:
    sensing, clock = begun()
    sensing.wheels.take(odometry(BEGIN_S))
    sensing.take_scan(scan(BEGIN_S + 0.02))
    assert sensing.due() is None
    sensing.wheels.take(odometry(BEGIN_S + 0.03))
    assert sensing.due() is not None
    sensing.take_scan(scan(BEGIN_S + 0.07))
    assert sensing.due() is None
    clock.now += 0.2
    assert sensing.due() is not None
    sensing.take_scan(scan(BEGIN_S + 2))
    clock.now += 0.2
    assert sensing.due() is None and sensing.skipped == {"scans without odometry within 0.5 s": 1}


@pytest.mark.parametrize("late", [2, 5])
def test_odometry_that_is_later_than_the_next_scan_starves_no_robot(late: int) -> None:
    """late: ticks. Each scan was thrown away for the next one: of a hundred one was used."""
    sensing, clock = begun()
    used = []
    for k in range(100):
        clock.now += TURN_S
        sensing.wheels.take(odometry(BEGIN_S + (k - late) * TURN_S + 0.01, pose_at(k * TURN_S)))
        sensing.take_scan(scan(BEGIN_S + k * TURN_S))
        if (seen := sensing.due()) is not None:
            used.append(seen.observation.tick)
    assert len(used) > 90 and set(np.diff(used)) == {1} and not sensing.skipped


@pytest.mark.parametrize("unstamped", [(odometry,), (scan,), (odometry, scan)])
def test_messages_without_a_stamp_are_of_when_they_came(unstamped: tuple[Any, ...]) -> None:
    """As of micro-ROS without synchronised time: the robot stood for ever, for wrong reasons. Scans come when over."""
    now = BEGIN_S
    sensing, used = Sensing(ROBOT, False, lambda: now, lambda: now), 0
    for k in range(100):
        now = BEGIN_S + 0.01 * k
        told: dict[Any, Any] = {odometry: pose_at(0.01 * k), scan: 1 + 0.01 * k}  # ranges tell when it came
        for make, take, every in ((odometry, sensing.wheels.take, 2), (scan, sensing.take_scan, 5)):
            if k % every == 0:
                message = make(now, told[make])
                if make in unstamped:
                    message.header.stamp.sec = message.header.stamp.nanosec = 0
                take(message)
        if (seen := sensing.due()) is not None:
            used += 1
            came = pose_at(seen.observation.scan()[0] - 1)
            assert relative(came, seen.odometry) == pytest.approx((0, 0, 0), abs=1e-4)
    assert used >= 16 and "odometry whose time jumps back" not in sensing.skipped


def test_half_a_second_without_scans_is_as_many_ticks_and_the_way_goes_on() -> None:
    sensing, _ = begun()
    found = feed(sensing, [0.0, TURN_S, TURN_S + 0.5, TURN_S + 0.5 + TURN_S])
    first = found[0].observation.tick
    assert [seen.observation.tick - first for seen in found] == [0, 1, 11, 12]
    assert np.hypot(*found[2].observation.odometry[:2]) == pytest.approx(0.5 * (0.5 + TURN_S), abs=1e-6)


@pytest.mark.parametrize("share", [0.97, 1.03])
def test_ticks_follow_the_clock_where_the_lidar_is_not_as_fast_as_it_says(share: float) -> None:
    sensing, _ = begun()
    times = share * TURN_S * np.arange(400)
    found = feed(sensing, times)
    ticks = [seen.observation.tick for seen in found]
    assert min(np.diff(ticks)) >= 1 and max(np.diff(ticks)) <= 2
    for seen in found:
        assert abs(seen.observation.tick - (seen.stamp_s - EPOCH_S) / TURN_S) < 3
    assert sum(sensing.skipped.values()) == (pytest.approx(12, abs=3) if share < 1 else 0)


def test_a_time_that_jumps_back_is_skipped_and_a_clock_set_back_is_followed() -> None:
    sensing, _ = begun()
    feed(sensing, [0.0, TURN_S])
    sensing.take_scan(scan(BEGIN_S))
    sensing.wheels.take(odometry(BEGIN_S))
    back = {"scans whose time jumps back": 1, "odometry whose time jumps back": 1}
    assert sensing.skipped == back and sensing.due() is None
    last = feed(sensing, [2 * TURN_S])[0].observation
    for k in range(60):
        sensing.wheels.take(odometry(BEGIN_S - 1000 + 0.05 * k, pose_at(2 * TURN_S + 0.05 * k)))
        sensing.take_scan(scan(BEGIN_S - 1000 + 0.05 * k - 0.01))
        if (seen := sensing.due()) is not None:
            break
    assert seen is not None and k < 12 and seen.observation.tick == last.tick + 1
    moved = np.hypot(*(np.array(seen.observation.odometry[:2]) - last.odometry[:2]))
    assert moved < 0.5  # m: what it drove until the clock was believed is not known
    assert sensing.skipped["times at which the clock of the scans was set anew"] == 1
    assert sensing.skipped["times at which the clock of the odometry was set anew"] == 1
    assert len(sensing.news) == len(set(sensing.news)) == 4


def seen_at(sensing: Sensing, times: Any) -> list[SensedScan]:
    """Scans of these times by the robot's clock, each with its odometry."""
    found = []
    for t in times:
        sensing.wheels.take(odometry(t - 0.02))
        sensing.wheels.take(odometry(t + 0.01))
        sensing.take_scan(scan(t))
        if (seen := sensing.due()) is not None:
            found.append(seen)
    return found


@pytest.mark.parametrize("year", [1965, 1970, 1999, 2025])
def test_a_clock_of_long_ago_serves_and_ntp_sets_it_right(year: int) -> None:
    """That of a board without one begins in 1970 or with its system's build: each scan was of an impossible time."""
    sensing, _ = begun()
    times = TURN_S * np.arange(1, 21)
    before = seen_at(sensing, (year - 1970) * 365.25 * 86400 + times)
    assert len(before) == 20
    after = seen_at(sensing, BEGIN_S + times)
    assert len(after) >= 20 - SET_ANEW and after[0].observation.tick > before[-1].observation.tick
    # ticks are those of the other robots from here on
    assert after[-1].observation.tick == round((after[-1].stamp_s - EPOCH_S) / TURN_S)


@pytest.mark.parametrize(("told_hz", "turns_hz"), [(5.0, 20.0004), (5.0, 20.3), (20.0, 19.2), (20.5, 20.0)])
def test_robots_whose_lidars_turn_almost_equally_fast_agree_on_ticks(told_hz: float, turns_hz: float) -> None:
    """Ticks since 2026 of 20.0004 Hz were 11 minutes ahead of those of 20 Hz. Scans are unrolled by what they take."""
    lidar = LIDAR.model_copy(update={"rate_hz": turns_hz})
    sensing, _ = begun(ROBOT.model_copy(update={"lidar": LIDAR.model_copy(update={"rate_hz": told_hz})}), lidar)
    (seen,) = feed(sensing, [TURN_S], lidar=lidar)
    rate_hz = sensing.spec.lidar.rate_hz
    assert rate_hz == (20.5 if told_hz == 20.5 else 20)
    assert seen.observation.tick == round((BEGIN_S + TURN_S - EPOCH_S) * rate_hz)
    (way, *_), last = seen.observation.poses(), seen.observation.odometry
    assert math.dist(way[:2], last[:2]) == pytest.approx(0.5 * 0.8 / turns_hz, rel=1e-3)


def test_robots_whose_clocks_agree_on_a_wrong_year_agree_on_ticks() -> None:
    first, later = (begun()[0] for _ in range(2))
    (one,), (other,) = seen_at(first, [1.705e9]), seen_at(later, [1.705e9 + 3600])
    assert other.observation.tick - one.observation.tick == round(3600 / TURN_S)


def test_odometry_that_begins_anew_leaves_no_jump() -> None:
    sensing, _ = begun()
    found = feed(sensing, [0.0, TURN_S])
    t = BEGIN_S + TURN_S + 0.01
    sensing.wheels.take(odometry(t + 0.01, (0.0, 0.0, 0.0)))
    sensing.wheels.take(odometry(t + 0.06, (0.02, 0.0, 0.0)))
    sensing.take_scan(scan(t + 0.06))
    seen = sensing.due()
    assert seen is not None and sensing.skipped == {"times at which odometry began anew": 1}
    moved = np.hypot(*(np.array(seen.observation.odometry[:2]) - found[-1].observation.odometry[:2]))
    assert moved == pytest.approx(0.02 + 0.5 * 0.01, abs=1e-4)
    assert seen.odometry == pytest.approx((0.02, 0.0, 0.0), abs=1e-6)


def test_a_base_that_is_started_again_after_a_while_leaves_no_jump() -> None:
    """In 6 s it might have driven home, and was taken to be there."""
    sensing, _ = begun()
    last = feed(sensing, [0.0])[0].observation
    sensing.wheels.take(odometry(BEGIN_S + 6, (0.0, 0.0, 0.0)))
    sensing.take_scan(scan(BEGIN_S + 6))
    seen = sensing.due()
    assert seen is not None and sensing.skipped == {"times at which odometry began anew": 1}
    assert math.dist(seen.observation.odometry, last.odometry) < 0.02


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        ({"angle_increment": 0.0}, "scans of no possible lidar"),
        ({"angle_increment": math.nan}, "scans of no possible lidar"),
        ({"angle_min": math.inf}, "scans of no possible lidar"),
        ({"time_increment": -1.0}, "scans of no possible lidar"),
        ({"angle_increment": 1e-6}, "scans of no possible lidar"),
        ({"angle_increment": 2e-4}, "scans of no possible lidar"),
        ({"time_increment": 1.0}, "scans of no possible lidar"),
    ],
)
def test_scans_that_cannot_be_are_skipped(more: dict[str, Any], reason: str) -> None:
    sensing, _ = begun()
    sensing.take_scan(scan(BEGIN_S, **more))
    assert not sensing.knows_lidar and sensing.due() is None
    feed(sensing, [0.0])
    sensing.take_scan(scan(BEGIN_S + TURN_S, **more))
    assert sensing.skipped == {reason: 2} and sensing.news == [reason]


@pytest.mark.parametrize("number", [0, 3, 5000])
def test_scans_of_too_few_or_too_many_readings_are_skipped(number: int) -> None:
    sensing, _ = begun()
    message = scan(BEGIN_S)
    message.ranges = np.zeros(number, np.float32)
    sensing.take_scan(message)
    assert sensing.skipped == {"scans of no possible lidar": 1}


def test_odometry_that_cannot_be_is_skipped() -> None:
    sensing, _ = begun()
    sensing.wheels.take(odometry(BEGIN_S))
    for place in (math.nan, math.inf, 1e12):
        sensing.wheels.take(odometry(BEGIN_S + 1, (place, 0.0, 0.0)))
    blank = odometry(BEGIN_S + 1)
    blank.pose.pose.orientation.w = 0.0
    sensing.wheels.take(blank)
    sensing.wheels.take(tilted(BEGIN_S + 1, 1.0))
    sensing.wheels.take(odometry(BEGIN_S + 1, frame="other"))
    assert sensing.wheels.until_s == BEGIN_S
    assert sensing.skipped == {
        "odometry that is no number": 4,
        "odometry of a robot that is not level": 1,
        "odometry of another frame": 1,
    }


def test_another_lidar_and_a_second_publisher_are_left_out() -> None:
    sensing, clock = begun()
    feed(sensing, [0.0])
    other = scan(BEGIN_S + TURN_S)
    other.header.frame_id = "rear"
    sensing.take_scan(other)
    assert sensing.skipped == {"scans of another lidar": 1}
    assert sensing.is_known("scan", "a", 0.5) and not sensing.is_known("scan", "b", 0.5)
    clock.now += 1.0  # the first was started again
    assert sensing.is_known("scan", "b", 0.5) and not sensing.is_known("scan", "a", 0.5)


def test_a_scan_of_the_far_future_is_skipped() -> None:
    sensing, _ = begun()
    feed(sensing, [0.0])
    late_s = EPOCH_S + (MAX_TICK + 10) * TURN_S
    sensing.wheels.take(odometry(late_s + 0.1))
    sensing.take_scan(scan(late_s))
    assert sensing.due() is None and sensing.skipped["scans of a time that cannot be"] == 1


def test_scans_that_come_faster_than_steps_are_taken_leave_the_newest() -> None:
    sensing, _ = begun()
    sensing.wheels.take(odometry(BEGIN_S + 1))
    for k in range(3):
        sensing.take_scan(scan(BEGIN_S + 0.9 + 0.01 * k, ranges=1.0 + k))
    seen = sensing.due()
    assert seen is not None and seen.observation.scan()[0] == 3.0
    assert sensing.skipped == {"scans that came too fast to be used": 2}
