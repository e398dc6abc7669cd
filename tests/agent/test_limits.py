"""A robot that cannot map says so before it drives."""

import pytest

from agent.limits import doubts
from protocol.messages import LidarSpec, RobotSpec


@pytest.mark.parametrize(
    "lidar",
    [
        {},
        {"turning": True},
        {"beams": 180},
        {"beams": 90, "field_of_view_deg": 180.0},
        {"field_of_view_deg": 180.0, "first_beam_deg": 90.0, "clockwise": True},
        {"range_max_m": 25.0},
        {"dropout": 0.9},
        {"range_min_m": 0.4},
        {"mount_x_m": -0.1},
        {"noise_share": 0.03},
        {"noise_m": 0.07},
    ],
)
def test_of_a_usual_robot_nothing_is_doubted(lidar: dict) -> None:
    assert doubts(RobotSpec(lidar=LidarSpec(**lidar))) == []


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        (RobotSpec(lidar=LidarSpec(field_of_view_deg=90.0, beams=90)), "looks at 90 degrees"),
        (
            RobotSpec(lidar=LidarSpec(field_of_view_deg=180.0, first_beam_deg=-90.0, clockwise=True)),
            "no nearer than 90 degrees to straight ahead",
        ),
        (RobotSpec(lidar=LidarSpec(beams=90)), "90 beams a revolution"),
        (RobotSpec(lidar=LidarSpec(range_min_m=4.0)), "measures nothing"),
        (
            RobotSpec(lidar=LidarSpec(range_max_m=0.15, range_min_m=0.0)),
            "sees 0.15 m around the robot, which reaches 0.19",
        ),
        (RobotSpec(radius_m=4.0), "sees 3.50 m"),
        (RobotSpec(radius_m=0.35, lidar=LidarSpec(range_max_m=0.6)), "the body is 0.35 m of it"),
        (RobotSpec(max_speed_mps=10.0), "lower spec.max_speed_mps"),
        (RobotSpec(radius_m=4.5, lidar=LidarSpec(mount_x_m=-4.0)), "sees 0.00 m"),
        (RobotSpec(lidar=LidarSpec(range_min_m=0.45)), "nothing nearer than 0.45 m"),
        (RobotSpec(lidar=LidarSpec(mount_x_m=0.1, mount_y_m=0.1)), "stands 0.14 m from the middle of a body"),
        (RobotSpec(lidar=LidarSpec(noise_share=0.04)), "errs by 4 % of a range"),
        (RobotSpec(lidar=LidarSpec(noise_m=0.1)), "errs by 0.1 m: with more than 0.07 m walls are missed"),
        (RobotSpec(lidar=LidarSpec(dropout=1.0)), "loses 100 % of its beams"),
        (RobotSpec(max_turn_rps=15.0, lidar=LidarSpec(turning=True)), "172 degrees during one scan"),
    ],
)
def test_what_cannot_work_is_said(spec: RobotSpec, said: str) -> None:
    (sentence,) = doubts(spec)
    assert said in sentence
    assert "spec.lidar.range_" not in sentence and "first_beam_deg" not in sentence  # scans of ROS 2 overwrite these
