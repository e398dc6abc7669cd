"""What a robot learns of its odometry's metres from walls that hold its scans."""

import math

import numpy as np
import pytest

from agent.mapping.submaps.length_scale import LengthScale
from protocol.arrays import Floats
from protocol.geometry import compose

PLACE_SD, MATCH_SD = 0.06, 0.02  # m per sqrt(m) that odometry is trusted with, and m that walls know a place by
HELD = np.diag((MATCH_SD**-2, MATCH_SD**-2, 1e6))
BESIDE = np.diag((1e-3, MATCH_SD**-2, 1e6))  # by the walls of a corridor along x
LONG = 1.02  # metres told for a metre
DRIFT_SD = 0.03  # m per sqrt(m) by which odometry errs


def learned(step: float, walls: Floats = HELD, turn: float = 0.3, slip: int = 0, sd: float = 0.03) -> float:
    """The scale after 200 m in steps, m, that turn by so many radians a metre; every so many (slip) goes nowhere."""
    scale, rng = LengthScale(sd), np.random.default_rng(0)
    still = 0.01
    prior = np.diag((1 / (PLACE_SD**2 * step + still**2), 1 / (PLACE_SD**2 * step + still**2), 1e4))
    true, at = (0.0, 0.0, 0.0), np.zeros(3)
    for k in range(round(200 / step)):
        slipped = slip > 0 and k % slip == slip - 1
        true = compose(true, (0.0 if slipped else step, 0.0, turn * step))
        ahead, aside = rng.normal((LONG * step, 0.0), DRIFT_SD * math.sqrt(step)).tolist()
        by = (scale.mean * ahead, scale.mean * aside, turn * step)
        told = np.array(compose((float(at[0]), float(at[1]), float(at[2])), by))
        told[2] = true[2]
        seen = np.array(true) + rng.normal(0.0, MATCH_SD, 3) * (1.0, 1.0, 0.0)
        matched = np.linalg.solve(prior + walls, prior @ told + walls @ seen)
        scale.learn(by, at, matched, prior, prior + walls)
        at = matched
    return scale.mean


@pytest.mark.parametrize("step", [0.05, 0.1, 0.7, 1.5])
def test_metres_that_odometry_tells_too_long_are_learned_from_steps_of_any_length(step: float) -> None:
    assert learned(step) == pytest.approx(1 / LONG, abs=0.006)


def test_wheels_that_slip_tell_nothing_of_their_size() -> None:
    assert learned(1.5, slip=5) == pytest.approx(1 / LONG, abs=0.006)


def test_where_no_wall_holds_a_scan_along_the_way_nothing_is_learned() -> None:
    assert learned(0.5, BESIDE, turn=0.0) == 1.0


def test_what_happened_while_the_place_was_lost_tells_no_length() -> None:
    scale, prior = LengthScale(0.03), np.diag((100.0, 100.0, 1e4))
    for k in range(40):
        before, after = np.array((k, 0.0, 0.0)), np.array((k + 0.9, 0.0, 0.0))
        scale.learn((1.0, 0.0, 0.0), before, after, prior, prior + HELD)
        scale.lose()
    assert scale.mean == 1.0


def test_metres_that_are_known_stay() -> None:
    assert learned(0.5, sd=0.0) == 1.0
