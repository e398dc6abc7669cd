"""The paper's sensing, for tests of what comes after it: scans of one instant, equal noise, and exact odometry."""

from typing import Any

from deploy.sensing import IDEAL
from protocol.messages import LidarSpec, OdometrySpec, RobotSpec

EXACT = OdometrySpec(**IDEAL["odometry"])


def ideal_lidar(**settings: Any) -> LidarSpec:
    return LidarSpec(**IDEAL["lidar"] | settings)


def ideal_spec(**settings: Any) -> RobotSpec:
    return RobotSpec(**{"lidar": ideal_lidar(), "odometry": EXACT} | settings)
