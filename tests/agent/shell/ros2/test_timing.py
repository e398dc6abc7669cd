"""Lidars whose drivers do not tell right when readings are taken: what the user sets, and what is said of it."""

import math
from typing import Any

import numpy as np
import pytest

from agent.shell.ros2.laser_scan import LaserScan, stamp_of
from agent.shell.ros2.sensing import Sensing
from agent.shell.ros2.timing import AS_TOLD, FAR, IN_A_ROW, LATE, ONE_MOMENT, OTHER, Timing
from protocol.messages import RobotSpec
from tests.agent.shell.ros2.messages import BEGIN_S, LIDAR, odometry, scan

TURN_S = 1 / LIDAR.rate_hz


def taken(message: Any) -> LaserScan:
    return LaserScan.told(message, stamp_of(message, 0.0))


@pytest.mark.parametrize("shown", [TURN_S, 0.001, 0.0])
def test_a_lidar_that_is_told_backwards_and_stamped_at_its_end_is_set_right(shown: float) -> None:
    """As the LDS-01 of a TurtleBot3, whose readings were placed up to two revolutions from where they were taken."""
    ranges = np.linspace(1, 2, LIDAR.beams).astype(np.float32)
    true = taken(scan(BEGIN_S, ranges, LIDAR.model_copy(update={"clockwise": True})))
    first = true.bearings.first + (LIDAR.beams - 1) * true.bearings.step
    message = scan(BEGIN_S, ranges[::-1], angle_min=first, time_increment=shown / LIDAR.beams)
    message.header.stamp = odometry(BEGIN_S).header.stamp
    mended = Timing(-TURN_S, at_end=True).mended(taken(message))
    assert mended.begin_s == pytest.approx(true.begin_s, abs=1e-6) and mended.between_s == pytest.approx(true.between_s)
    assert mended.bearings == pytest.approx(true.bearings) and (mended.readings == true.readings).all()


def test_a_lidar_of_one_moment_is_set_to_turn_and_the_other_way_round() -> None:
    still = scan(BEGIN_S, lidar=LIDAR.model_copy(update={"turning": False}))
    assert Timing(TURN_S).mended(taken(still)).end_s == pytest.approx(BEGIN_S + TURN_S * (1 - 1 / LIDAR.beams))
    assert Timing(0.0).mended(taken(scan(BEGIN_S))).period_s == 0


def said_of(
    late_s: float = 0.0, apart_s: float = TURN_S, timing: Timing = AS_TOLD, ahead_s: float = 0.0, **told: Any
) -> dict[str, int]:
    """What is said of scans that come so late after their ends, as told, with odometry of just then.

    ahead_s: by which the own clock is ahead of stamps.
    """
    now = BEGIN_S
    sensing = Sensing(RobotSpec(), False, lambda: now, lambda: now + ahead_s, timing)
    for k in range(5 + 2 * IN_A_ROW):
        now = BEGIN_S + apart_s * k
        sensing.wheels.take(odometry(now - 0.01))
        sensing.take_scan(scan(now - late_s, **({} if k < 5 and "lidar" in told else told)))
        sensing.due()
    return dict(sensing.skipped)


def test_what_speaks_against_the_times_of_scans_is_said_once_with_what_to_set() -> None:
    assert not said_of(0.01)
    assert said_of(-TURN_S) == {LATE: 1}
    assert said_of(-TURN_S, ahead_s=1e9) == {LATE: 1}
    assert not said_of(0.01, ahead_s=1e9)
    assert not said_of(-TURN_S, timing=Timing(at_end=True))
    assert not said_of(-2 * TURN_S, timing=Timing(at_end=True))
    assert said_of(time_increment=0.0) == {ONE_MOMENT: 1}
    assert not said_of(time_increment=0.0, angle_increment=math.radians(0.5))
    assert not said_of(time_increment=0.0, timing=Timing(0.0))
    assert not said_of(apart_s=2 * TURN_S)
    assert said_of(apart_s=4 * TURN_S) == {FAR: 1}
    assert not said_of(4 * TURN_S, apart_s=4 * TURN_S, timing=Timing(4 * TURN_S))
    slower = LIDAR.model_copy(update={"rate_hz": 15.0})
    assert said_of(apart_s=1 / 15, lidar=slower) == {OTHER: 1}
