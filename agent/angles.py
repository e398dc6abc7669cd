"""Angles and their periods."""

from __future__ import annotations

from numba import njit


@njit(cache=True)
def wrapped(angle: float, period: float) -> float:
    """The angle nearest to zero that differs by a multiple of the period."""
    return angle - period * round(angle / period)
