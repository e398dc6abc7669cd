"""`wireswarm run --ros2`: our robots as those of ROS 2, driven by a Twist, or by our mind through the world's gate."""

import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agent.config import AgentConfig
from agent.robot import Step
from agent.shell.ros2 import showing, wire
from agent.shell.ros2.config import Ros2Config
from deploy import cli
from deploy.ros2 import DriverInbox, Ros2Robots, SimulatedRobot
from protocol.errors import LinkError
from protocol.messages import Heard, LidarSpec, Observation, RobotSpec
from protocol.session import open_ros2_client, open_router
from protocol.wireframe import decode_wireframe
from tests.agent.shell.ros2.bodies import PATIENCE_S, Agent, heard
from tests.agent.shell.ros2.test_process import Goer

SPEC = RobotSpec(lidar=LidarSpec(turning=True, rate_hz=20.0, mount_x_m=-0.03))
PERIOD_S = 1 / SPEC.lidar.rate_hz


@pytest.fixture
def endpoint() -> Iterator[str]:
    Goer.ears.clear()
    with open_router() as (_, found):
        yield found


class Run:
    """A world of one robot, tick by tick by the clock."""

    def __init__(self, endpoint: str, **settings: Any) -> None:
        config = Ros2Config(router=endpoint, **settings)
        made = Ros2Robots(config)("r1", SPEC, AgentConfig(), 0)
        assert isinstance(made, SimulatedRobot)
        self.robot, self.tick = made, 0

    def step(self, *said: Heard) -> Step:
        begin = time.monotonic()
        way = np.array([(0.01 * self.tick + 0.002 * k, 0.0, 0.1) for k in range(1, 6)])
        x, y, theta = way[-1].tolist()
        ranges = np.full(360, 2.0, "<f4")
        ranges[:2] = math.inf, math.nan
        seen = Observation(tick=self.tick, ranges=ranges.tobytes(), odometry=(x, y, theta), way=way.tobytes())
        step = self.robot.step(seen, said)
        self.tick += 1
        time.sleep(max(0.0, PERIOD_S - (time.monotonic() - begin)))
        return step

    def until(self, holds: Any, *said: Heard) -> Step:
        deadline = time.monotonic() + PATIENCE_S
        while not holds(step := self.step(*said)):
            assert time.monotonic() < deadline
        return step


def test_scan_odometry_and_tf_lie_under_the_robots_namespace(endpoint: str) -> None:
    with (
        heard(endpoint, "/r1/scan", wire.SCAN) as scans,
        heard(endpoint, "/r1/odom", wire.ODOMETRY) as odometry,
        heard(endpoint, "/r1/tf", wire.TRANSFORMS) as tf,
    ):
        run = Run(endpoint)
        run.until(lambda step: len(scans) > 3 and len(tf) > 3 and len(odometry) > 19)
    scan, stamp = scans[-1], scans[-1].header.stamp
    end_s = stamp.sec + 1e-9 * stamp.nanosec + 359 * scan.time_increment
    assert np.isinf(scan.ranges[0]) and np.isnan(scan.ranges[1]) and scan.ranges[2] == 2.0
    assert (scan.angle_increment, scan.scan_time) == pytest.approx((math.radians(1), PERIOD_S))
    stamps = [one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in odometry]
    apart = np.diff(stamps)  # a tick that comes late on a busy machine leaves a gap
    assert np.median(apart) == pytest.approx(PERIOD_S / 5, abs=1e-4) and apart.min() > PERIOD_S / 5 - 1e-4
    assert min(abs(one - end_s) for one in stamps) < 1e-3 and abs(end_s - time.time()) < PATIENCE_S
    assert odometry[-1].twist.twist.linear.x == pytest.approx(0.2 * math.cos(0.1), abs=0.01)
    (moved,) = tf[-1].transforms
    assert (moved.header.frame_id, moved.child_frame_id) == ("odom", "base_footprint")


def test_its_speed_is_that_of_its_way_where_it_came_late_and_missed_ticks(endpoint: str) -> None:
    with heard(endpoint, "/r1/odom", wire.ODOMETRY) as odometry:
        run = Run(endpoint)
        for tick in (40, 60):  # it said 5 and 0.8 m/s
            run.tick, already = tick, len(odometry)
            run.until(lambda step, already=already: len(odometry) > already + 4)
    stamps = [one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in odometry]
    assert np.diff(stamps).max() > 5 * PERIOD_S
    speeds = {round(math.hypot(one.twist.twist.linear.x, one.twist.twist.linear.y), 3) for one in odometry}
    assert 0.2 in speeds <= {0.0, 0.2}


def test_ticks_that_a_resumed_world_says_again_are_told_once(endpoint: str) -> None:
    """Stamps went back, and with one pose a scan a speed was divided by 0 s."""
    with heard(endpoint, "/r1/odom", wire.ODOMETRY) as odometry, heard(endpoint, "/r1/scan", wire.SCAN) as scans:
        run = Run(endpoint)
        run.until(lambda step: len(odometry) > 4 and len(scans) > 1)
        run.tick -= 1
        run.step()
        already = len(odometry)
        run.until(lambda step: len(odometry) > already + 4)
    for told in (odometry, scans):
        stamps = [(one.header.stamp.sec, one.header.stamp.nanosec) for one in told]
        assert stamps == sorted(set(stamps))


@pytest.mark.parametrize("stamped", [False, True])
def test_a_twist_drives_it_for_half_a_second(endpoint: str, stamped: bool) -> None:
    kind = wire.TWIST_STAMPED if stamped else wire.TWIST
    run = Run(endpoint, stamped=stamped)
    with open_ros2_client(endpoint, PATIENCE_S) as session:
        twist = showing.twist_stamped_of(0.1, -0.5, 0.0, "base") if stamped else showing.twist_of(0.1, -0.5)
        key = wire.Endpoint(0, "/r1/cmd_vel", kind).key
        session.put(key, b"nothing")
        session.put(key, wire.to_bytes(kind, twist))
        run.until(lambda step: (step.action.speed_mps, step.action.turn_rps) == (0.1, -0.5))
        run.until(lambda step: (step.action.speed_mps, step.action.turn_rps) == (0.0, 0.0))


@pytest.mark.parametrize("twist", [(math.nan, 0.1), (0.1, math.nan), (0.1, -math.inf)])
def test_a_twist_of_no_numbers_is_left_out(twist: tuple[float, float]) -> None:
    """A NaN that was not the first of the two ended the run."""
    driver = DriverInbox()
    driver.command(showing.twist_of(*twist))
    assert driver.take()[0] == (0.0, 0.0)


def test_without_a_router_nothing_is_begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deploy.ros2.JOIN_S", 0.1)
    monkeypatch.setattr("sys.argv", ["wireswarm", "run", "--ros2", "--set", "ros2.router=tcp/127.0.0.1:9"])
    monkeypatch.chdir(tmp_path)
    with pytest.raises(LinkError, match="no router of ROS 2 answers at tcp"):
        cli.app(standalone_mode=False)
    assert list(tmp_path.iterdir()) == []


def test_our_mind_drives_it_and_its_radio_and_map_pass_the_world(endpoint: str) -> None:
    run = Run(endpoint)
    with Agent(endpoint, "r1", Goer, radio="gated"):
        step = run.until(lambda step: step.map is not None and len(step.sends) > 0 and step.action.speed_mps > 0)
        tick = run.tick - 1
        assert step.map is not None and len(decode_wireframe(step.map.wireframe).edges) == 3
        assert {step.map.tick, step.action.tick, step.pose.tick, *(send.tick for send in step.sends)} == {tick}
        assert step.action.sent == len(step.sends) and {send.payload for send in step.sends} == {b"r1"}
        assert Goer.ears == {"r1": set()}
        message = Heard(tick=tick, sender="r2", kind="name", payload=b"r2")
        run.until(lambda step: Goer.ears == {"r1": {"r2"}}, message)
