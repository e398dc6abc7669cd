"""What a robot learns of its odometry's metres from walls that hold its scans."""

import numpy as np
import pytest

from agent.mapping.length_scale import LengthScale
from protocol.arrays import Floats

PRIOR = np.diag((100.0, 100.0, 1e4))  # 10 cm
HELD = np.diag((2500.0, 2500.0, 1e6))  # 2 cm, by walls
LONG = 1.02  # metres told for a metre


def learned(held: Floats, slip: int = 0, sd: float = 0.03) -> float:
    """The scale after 200 steps of a metre in all directions, of which every so many (slip) goes nowhere."""
    scale, rng = LengthScale(sd), np.random.default_rng(0)
    for k in range(200):
        way = np.array((np.cos(k), np.sin(k), 0.0))
        told = scale.mean * LONG * way
        true = 0.0 * way if slip and k % slip == slip - 1 else way
        information = PRIOR + held
        seen = true + rng.normal(0.0, 0.02, 3)
        matched = np.linalg.solve(information, PRIOR @ told + held @ seen)
        scale.learn(np.zeros(3), told, matched, PRIOR, information)
    return scale.mean


def test_metres_that_odometry_tells_too_long_are_learned() -> None:
    assert learned(HELD) == pytest.approx(1 / LONG, abs=0.004)


def test_wheels_that_slip_tell_nothing_of_their_size() -> None:
    assert learned(HELD, slip=5) == pytest.approx(1 / LONG, abs=0.004)


def test_where_no_wall_holds_a_scan_along_the_way_nothing_is_learned() -> None:
    assert learned(0.5 * PRIOR) == 1.0


def test_metres_that_are_known_stay() -> None:
    assert learned(HELD, sd=0.0) == 1.0
