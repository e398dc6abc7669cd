"""Angles and their periods."""

from __future__ import annotations

from agent.kernels import kernel


@kernel
def wrapped(angle: float, period: float) -> float:
    """The angle nearest to zero that differs by a multiple of the period."""
    return angle - period * round(angle / period)
