"""A robot that gets nowhere though it drives pushes against something unseen."""

import numpy as np
import pytest

from agent.exploration.config import DrivingConfig
from agent.exploration.surroundings import Touch
from protocol.messages import LidarSpec, RobotSpec


@pytest.mark.parametrize(("rate_hz", "ticks"), [(0.1, 1), (0.5, 1), (1.0, 1), (5.0, 5)])
def test_a_robot_that_has_not_driven_does_not_push_however_slow_its_lidar_is(rate_hz: float, ticks: int) -> None:
    touch = Touch(RobotSpec(lidar=LidarSpec(rate_hz=rate_hz)), DrivingConfig())
    here = np.zeros(2)
    touch.feel(here)
    for _ in range(ticks):
        assert not touch.pushes
        touch.command(0.2)
        touch.feel(here)
    assert touch.pushes
