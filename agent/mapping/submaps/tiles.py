"""Walls sorted into tiles of their plane, so that a sample is held against those nearby alone (ours).

Matching holds each sample against walls a dozen times for each pose that is tried: with all walls of a submap that was
half of all work on recorded logs.
"""

from typing import NamedTuple

import numpy as np

from agent.kernels import kernel
from protocol.arrays import Ints, Records

TILE_M = 1.0  # side of a tile, at least: most walls of cluttered rooms are shorter
MOST = 64  # tiles along a side: where walls lie kilometres apart, tiles are larger instead


class Tiles(NamedTuple):
    """Walls, and which of them may lie within a margin of a point, by the point's tile."""

    walls: Records  # (n,) of SEGMENT
    x: float  # m, lower left corner of the first tile
    y: float
    per_m: float  # tiles in a metre
    columns: int
    rows: int
    listed: Ints
    """(tiles + 1 + k,) where in this array the walls of each tile begin, and where the last one's end; their numbers,
    rising in each tile."""


@kernel
def tiled(walls: Records, margin: float) -> Tiles:
    """Tiles of segments (n,): a point outside of them all is farther than the margin, in metres, from each wall."""
    boxes = np.empty((len(walls), 4))
    for k in range(len(walls)):
        e = walls[k]
        ax, ay, bx, by = e.x + e.low * e.ux, e.y + e.low * e.uy, e.x + e.high * e.ux, e.y + e.high * e.uy
        boxes[k, 0], boxes[k, 1] = min(ax, bx) - margin, min(ay, by) - margin
        boxes[k, 2], boxes[k, 3] = max(ax, bx) + margin, max(ay, by) + margin
    if len(walls) == 0:
        return Tiles(walls, 0.0, 0.0, 1.0, 0, 0, np.zeros(1, np.int64))
    left, bottom, right, top = boxes[:, 0].min(), boxes[:, 1].min(), boxes[:, 2].max(), boxes[:, 3].max()
    per_m = 1.0 / max(TILE_M, (right - left) / MOST, (top - bottom) / MOST)
    columns, rows = int((right - left) * per_m) + 1, int((top - bottom) * per_m) + 1
    spans = np.empty((len(walls), 4), np.int64)
    counts = np.zeros(columns * rows + 1, np.int64)
    for k in range(len(walls)):
        for j in range(4):
            spans[k, j] = int((boxes[k, j] - (bottom if j % 2 else left)) * per_m)
        for row in range(spans[k, 1], spans[k, 3] + 1):
            for column in range(spans[k, 0], spans[k, 2] + 1):
                counts[row * columns + column + 1] += 1
    begins = len(counts) + np.cumsum(counts)
    listed = np.empty(begins[-1], np.int64)
    listed[: len(begins)] = begins
    for k in range(len(walls)):
        for row in range(spans[k, 1], spans[k, 3] + 1):
            for column in range(spans[k, 0], spans[k, 2] + 1):
                listed[begins[row * columns + column]] = k
                begins[row * columns + column] += 1
    return Tiles(walls, left, bottom, per_m, columns, rows, listed)
