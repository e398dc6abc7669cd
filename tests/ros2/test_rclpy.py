"""Against real ROS 2: rclpy over DDS, with a relay to Zenoh.

They need a Python with rclpy, eclipse-zenoh and the messages (docs/ros2.md), which WIRESWARM_ROS2_PYTHON names.
"""

import json
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from agent.shell.ros2 import wire
from protocol.session import open_router
from tests.agent.shell.ros2.bodies import Agent, Body, until
from tests.agent.shell.ros2.test_process import POSE, Goer

PYTHON = os.environ.get("WIRESWARM_ROS2_PYTHON", "")
DOMAIN = str(60 + os.getpid() % 40)
ENVIRONMENT = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": DOMAIN, "PYTHONPATH": ""}
HERE = Path(__file__).parent
PATIENCE_S = 60.0
pytestmark = pytest.mark.skipif(
    not PYTHON, reason="WIRESWARM_ROS2_PYTHON names no Python with rclpy and eclipse-zenoh (docs/ros2.md)"
)

HASHES = """
import rclpy, time, sys
from importlib import import_module
rclpy.init()
node = rclpy.create_node("hashes")
for kind in sys.argv[1:]:
    package, _, name = kind.split("/")
    publisher = node.create_publisher(getattr(import_module(f"{package}.msg"), name), f"/{name}", 1)
    while not (found := node.get_publishers_info_by_topic(f"/{name}")):
        time.sleep(0.05)
    print(kind, found[0].topic_type_hash, flush=True)
"""
GRID = """
import rclpy, json
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import DurabilityPolicy, QoSProfile
rclpy.init()
node = rclpy.create_node("reader")
got = []
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
node.create_subscription(OccupancyGrid, "/real/r1/map", got.append, latched)
while not got:
    rclpy.spin_once(node, timeout_sec=0.2)
info = got[0].info
place = info.origin.position
print(json.dumps([info.width, info.height, info.resolution, place.x, place.y, list(got[0].data)]))
"""


def rclpy_says(code: str, *arguments: str) -> list[str]:
    done = subprocess.run(
        [PYTHON, "-c", code, *arguments],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=True,
    )
    return done.stdout.splitlines()


@contextmanager
def relay(endpoint: str, links: list[list[str]]) -> Iterator[None]:
    asked = json.dumps({"endpoint": endpoint, "links": links})
    process = subprocess.Popen(
        [PYTHON, str(HERE / "relay.py"), asked], env=ENVIRONMENT, stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
        yield
    finally:
        process.kill()
        process.wait()


def test_type_hashes_are_those_of_rclpy() -> None:
    kinds = [wire.SCAN, wire.ODOMETRY, wire.TWIST, wire.TWIST_STAMPED, wire.GRID, wire.MARKERS, wire.DIAGNOSTICS]
    kinds += [wire.POSE, wire.HELD]  # there is no wheel of tf2_msgs
    assert rclpy_says(HASHES, *kinds) == [f"{kind} {wire.type_hash(kind)}" for kind in kinds]


def test_tokens_and_keys_are_those_that_the_relay_declares_by_rclpy() -> None:
    with (
        open_router() as (session, endpoint),
        relay(endpoint, [["in", "/r1/scan", "/real/r1/scan", "sensor_msgs/LaserScan"]]),
    ):
        (told,) = [
            str(reply.ok.key_expr)
            for reply in session.liveliness().get(wire.tokens_of(0, wire.PUBLISHER, "/r1/scan"))
            if reply.ok
        ]
    where = wire.Endpoint(0, "/r1/scan", wire.SCAN)
    zid = told.split("/")[2]
    expected = wire.token(0, zid, 1, wire.PUBLISHER, "/relay", "relay", f"{where.words}/{wire.Quality()}")
    assert told == expected and wire.kind_in(told) == wire.SCAN


def test_scans_go_through_rclpy_and_commands_back_and_it_reads_the_latched_map() -> None:
    """body - Zenoh - relay - DDS - relay - Zenoh - mind, and back."""
    body_side = [
        ["out", "/body/scan", "/real/r1/scan", "sensor_msgs/LaserScan"],
        ["out", "/body/odom", "/real/r1/odom", "nav_msgs/Odometry"],
        ["in", "/body/cmd_vel", "/real/r1/cmd_vel", "geometry_msgs/TwistStamped"],
    ]
    mind_side = [
        ["in", "/r1/scan", "/real/r1/scan", "sensor_msgs/LaserScan"],
        ["in", "/r1/odom", "/real/r1/odom", "nav_msgs/Odometry"],
        ["out", "/r1/cmd_vel", "/real/r1/cmd_vel", "geometry_msgs/TwistStamped"],
        ["out", "/r1/map", "/real/r1/map", "nav_msgs/OccupancyGrid", "latched"],
    ]
    Goer.ears.clear()
    with (
        open_router() as (_, endpoint),
        relay(endpoint, body_side),
        relay(endpoint, mind_side),
        Body(endpoint, "/body", wire.TWIST_STAMPED) as body,
        Agent(endpoint, "r1", Goer),
    ):
        until(body.drives)
        (said,) = rclpy_says(GRID)
        assert body.drives()
    width, height, resolution, x, y, cells = json.loads(said)
    assert len(cells) == width * height and resolution == pytest.approx(0.05)

    def at(px: float, py: float) -> int:
        return int(cells[int((py - y) / 0.05) * width + int((px - x) / 0.05)])

    assert (at(*POSE[:2]), at(0.0, -1.001), at(0.0, -1.2)) == (0, 100, -1)
