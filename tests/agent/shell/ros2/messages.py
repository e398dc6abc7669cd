"""Messages of a ROS 2 robot as tests want them."""

import math
from typing import Any

import numpy as np

from agent.shell.ros2 import showing, wire
from protocol.geometry import Pose
from protocol.messages import LidarSpec

BEGIN_S = 1_800_000_000.0
"""A moment of 2027."""
LIDAR = LidarSpec(turning=True, rate_hz=20.0)


def scan(end_s: float, ranges: Any = 2.0, lidar: LidarSpec = LIDAR, **more: Any) -> Any:
    """A LaserScan whose turn ends then; ranges: m, all or each; further fields as they are."""
    message = showing.scan_of(lidar, np.broadcast_to(ranges, lidar.beams), end_s, "laser")
    for name, value in more.items():
        setattr(message, name, value)
    return message


def odometry(time_s: float, pose: Pose = (0.0, 0.0, 0.0), frame: str = "odom") -> Any:
    return showing.odometry_of(pose, (0.0, 0.0, 0.0), 0.05, time_s, (frame, "base"))


def tilted(time_s: float, roll: float) -> Any:
    message = odometry(time_s)
    message.pose.pose.orientation.x, message.pose.pose.orientation.w = math.sin(roll / 2), math.cos(roll / 2)
    return message


def said(kind: str, **fields: Any) -> Any:
    return wire.types().types[kind](**fields)
