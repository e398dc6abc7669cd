"""Numbers that are taken together change estimates and covariance as one after the other does."""

import math

import numpy as np
import pytest

from agent.mapping.kalman import TOGETHER, observe, settle, take, update_of
from protocol.arrays import Floats

SIZE, ROWS = 20, 3


def numbers(rng: np.random.Generator, count: int) -> list[tuple[np.ndarray, Floats, float, float]]:
    """Rows, slopes, how far off and variance of some numbers."""
    return [
        (rng.permutation(SIZE)[:ROWS], rng.normal(size=ROWS), float(rng.normal(0, 0.1)), float(rng.uniform(0.001, 0.1)))
        for _ in range(count)
    ]


def covariance(rng: np.random.Generator) -> Floats:
    root = rng.normal(size=(SIZE, SIZE))
    return np.asarray(root @ root.T / SIZE)


def by_the_book(joint: Floats, shift: Floats, rows: np.ndarray, slopes: Floats, off: float, variance: float) -> float:
    """Kalman's update with Cauchy's weight, in matrices."""
    h = np.zeros(SIZE)
    h[rows] = slopes
    known, left = float(h @ joint @ h), off - float(h @ shift)
    gain = joint @ h / (known + variance * (1 + left**2 / (4 * (known + variance))))
    shift += gain * left
    joint -= np.outer(gain, h @ joint)
    return left / math.sqrt(known + variance)


@pytest.mark.parametrize("count", [1, TOGETHER - 1, TOGETHER, 3 * TOGETHER + 2])
def test_numbers_taken_together_are_taken_as_by_the_book(count: int) -> None:
    rng = np.random.default_rng(count)
    joint, shift = covariance(rng), np.zeros(SIZE)
    expected, moved = joint.copy(), np.zeros(SIZE)
    update = update_of(joint, shift)
    for number in numbers(rng, count):
        deviations = by_the_book(expected, moved, *number)
        assert take(update, *number, math.inf).deviations == pytest.approx(deviations)
    settle(update)
    assert np.allclose(joint, expected) and np.allclose(shift, moved)
    assert np.abs(joint - joint.T).max() < 1e-15


def test_what_is_too_far_off_changes_nothing() -> None:
    rng = np.random.default_rng(0)
    joint, shift = covariance(rng), np.zeros(SIZE)
    before = joint.copy()
    assert observe(joint, shift, np.array((3,)), np.array((1.0,)), 100.0, 0.01, 5.0).deviations > 5.0
    assert np.array_equal(joint, before) and not shift.any()
