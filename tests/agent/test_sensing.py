"""A robot whose lidar turns and whose wheels err maps as one that sees and knows all at once."""

import pytest

from deploy.bench.explored import explore

HALF = {"turning": True, "field_of_view_deg": 180.0, "first_beam_deg": -90.0, "beams": 180}

FAST = pytest.param({"turning": True, "rate_hz": 20.0}, marks=pytest.mark.slow)


@pytest.mark.parametrize("lidar", [{"turning": True}, {"turning": True, "clockwise": True}, HALF, FAST])
def test_an_apartment_is_mapped_with_a_lidar_that_turns_and_wheels_that_err(lidar: dict) -> None:
    spec = {"lidar": lidar, "odometry": {"noisy": True}}
    run = explore({"world": "apartment", "robots": 1, "seed": 0, "until": 45.0, "spec": spec}, {})
    found = run.figures() | run.path_errors()
    assert found["odometry_rms_m"] > 0.1
    assert found["path_rms_m"] < 0.02
    assert found["wall_precision"] > 0.99
    assert found["corner_rmse_m"] < 0.01
    assert found["wall_recall"] > 0.25  # of 45 s; half a field of view shows less
    assert found["wall_contacts"] == 0
