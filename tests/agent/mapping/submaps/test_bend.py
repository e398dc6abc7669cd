"""What a robot learns of how its odometry bends a straight drive, from walls that hold its scans."""

import math

import numpy as np
import pytest

from agent.mapping.submaps.bend import Bend
from protocol.geometry import compose, pose_of

BENT = 0.08  # rad a metre: wheels that differ by 1.3 %
DRIFT_SD, TRUSTED_SD = math.radians(1.5), math.radians(2.5)  # rad per sqrt(m) by which odometry errs, and is said to
MATCH_SD = math.radians(0.3)  # rad that walls know a heading by


def learned(step: float, metres: float = 100.0, held: bool = True, slip: int = 0, sd: float = 0.09) -> float:
    """The bend after so many metres in steps of a way of bends; every so many steps (slip) the robot is turned."""
    bend, rng = Bend(sd), np.random.default_rng(0)
    prior = np.diag((1e4, 1e4, 1 / (TRUSTED_SD**2 * step + math.radians(0.3) ** 2)))
    walls = np.diag((1e6, 1e6, MATCH_SD**-2 if held else 1e-3))
    true, at = (0.0, 0.0, 0.0), np.zeros(3)
    for k in range(round(metres / step)):
        turn, slipped = 0.4 * step * math.sin(0.1 * k), slip > 0 and k % slip == slip - 1
        true = compose(true, (step, 0.0, turn + (0.5 if slipped else 0.0)))
        by = (step, 0.0, turn - BENT * step + rng.normal(0.0, DRIFT_SD) * math.sqrt(step) + bend.mean * step)
        told, seen = np.array(compose(pose_of(at), by)), np.array(true)
        seen[2] += rng.normal(0.0, MATCH_SD)
        told[2] = seen[2] + math.remainder(told[2] - seen[2], 2 * math.pi)
        matched = np.linalg.solve(prior + walls, prior @ told + walls @ seen)
        bend.learn(by, at, matched, prior, prior + walls)
        at = matched
    return bend.mean


@pytest.mark.parametrize("step", [0.05, 0.2, 0.7, 1.5])
def test_a_bend_is_learned_from_steps_of_any_length(step: float) -> None:
    assert learned(step) == pytest.approx(BENT, abs=math.radians(0.5))


def test_a_few_metres_along_walls_already_tell_most_of_it() -> None:
    assert learned(0.1, metres=5.0) == pytest.approx(BENT, abs=math.radians(1.5))


def test_who_is_turned_by_others_learns_no_bend_from_it() -> None:
    assert learned(0.2, slip=25) == pytest.approx(BENT, abs=math.radians(1.0))


def test_where_no_wall_holds_the_heading_nothing_is_learned() -> None:
    assert learned(0.2, held=False) == 0.0


def test_wheels_that_are_known_stay_so() -> None:
    assert learned(0.2, sd=0.0) == 0.0
