"""Walls as arrays: segments (m, 4) x1, y1, x2, y2 in metres, or edges (m, 2) from and to vertices."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Floats, Ints


def lengths(walls: Floats) -> Floats:
    """Metres (m,) of walls (m, 4)."""
    return np.hypot(walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1])


def directions(walls: Floats) -> Floats:
    """Unit vectors (m, 2) from the start of each wall (m, 4) to its end; zero for a wall without length."""
    return np.asarray((walls[:, 2:] - walls[:, :2]) / np.maximum(lengths(walls), 1e-9)[:, None], np.float64)


def main_direction(walls: Floats) -> float:
    """Direction that most length of walls (m, 4) keeps to, modulo a right angle, radians; 0 without walls."""
    x, y = (walls[:, 2:] - walls[:, :2]).T
    return float(np.angle(lengths(walls) @ np.exp(4j * np.arctan2(y, x)))) / 4


def points_along(walls: Floats, counts: Ints) -> tuple[Floats, Ints]:
    """Middles (k, 2) of as many equal pieces of each wall (m, 4) as counts (m,) says, and (k,) the walls' rows."""
    wall, nth = repeated(counts)
    share = (nth + 0.5) / counts[wall]
    start, end = walls[:, :2], walls[:, 2:]
    return start[wall] + share[:, None] * (end - start)[wall], wall


def repeated(counts: Ints) -> tuple[Ints, Ints]:
    """Rows (k,), each as often as counts (m,) says, and (k,) the number of each among its like, from 0."""
    row = np.repeat(np.arange(len(counts)), counts)
    return row, np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)


def neighbours(edges: NDArray[np.signedinteger[Any]], count: int) -> tuple[Ints, Ints]:
    """The vertex before and the vertex after each of `count` vertices, (count,) each; -1 where there is none."""
    before, after = np.full(count, -1), np.full(count, -1)
    before[edges[:, 1]], after[edges[:, 0]] = edges[:, 0], edges[:, 1]
    return before, after
