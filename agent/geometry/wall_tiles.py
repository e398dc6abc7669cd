"""Walls by the tiles of the plane that they reach into: a way or a view meets those of the tiles that it passes alone.

Walls are (m, 4) x1, y1, x2, y2 in metres. In a maze of 40 m a way between two corners asks 8 of 450 walls.
"""

import math
from typing import NamedTuple

import numpy as np

from agent.geometry.clearance import bars, crosses, to_wall2
from agent.kernels import kernel, shared_kernel
from protocol.arrays import Bools, Floats, Ints

TILE_M = 1.0  # side of a tile, at least: most walls of cluttered rooms are shorter
MOST = 64  # tiles along a side: where walls lie kilometres apart, tiles are larger instead
ROUNDING_M = 1e-9  # a tile is looked into where a way passes so near to it


class Tiling(NamedTuple):
    """Square tiles of the plane, numbered row by row."""

    x: float  # m, lower left corner of the first tile
    y: float
    per_m: float  # tiles in a metre
    columns: int
    rows: int


class Tiles(NamedTuple):
    """Tiles of the plane, and which of some boxes reach into each."""

    tiling: Tiling
    listed: Ints
    """(tiles + 1 + k,) where in this array the boxes of each tile begin, and where the last one's end; their numbers,
    rising in each tile."""


class WallTiles(NamedTuple):
    """Walls, and the tiles that their bounding boxes reach into."""

    walls: Floats  # (m, 4)
    tiles: Tiles


@kernel
def tiling_of(left: float, bottom: float, right: float, top: float) -> Tiling:
    """Tiles that cover a box, metres."""
    per_m = 1.0 / max(TILE_M, (right - left) / MOST, (top - bottom) / MOST)
    return Tiling(left, bottom, per_m, int((right - left) * per_m) + 1, int((top - bottom) * per_m) + 1)


@kernel
def tiles_of_boxes(boxes: Floats) -> Tiles:
    """Tiles that cover boxes (n, 4) of least x and y, greatest x and y."""
    if len(boxes) == 0:
        return Tiles(Tiling(0.0, 0.0, 1.0, 0, 0), np.zeros(1, np.int64))
    left, bottom = boxes[:, 0].min(), boxes[:, 1].min()
    tiling = tiling_of(left, bottom, boxes[:, 2].max(), boxes[:, 3].max())
    per_m, columns, rows = tiling.per_m, tiling.columns, tiling.rows
    spans = np.empty((len(boxes), 4), np.int64)
    counts = np.zeros(columns * rows + 1, np.int64)
    for k in range(len(boxes)):
        for j in range(4):
            spans[k, j] = int((boxes[k, j] - (bottom if j % 2 else left)) * per_m)
        for row in range(spans[k, 1], spans[k, 3] + 1):
            for column in range(spans[k, 0], spans[k, 2] + 1):
                counts[row * columns + column + 1] += 1
    begins = len(counts) + np.cumsum(counts)
    listed = np.empty(begins[-1], np.int64)
    listed[: len(begins)] = begins
    for k in range(len(boxes)):
        for row in range(spans[k, 1], spans[k, 3] + 1):
            for column in range(spans[k, 0], spans[k, 2] + 1):
                listed[begins[row * columns + column]] = k
                begins[row * columns + column] += 1
    return Tiles(tiling, listed)


@kernel
def boxes_at(tiles: Tiles, x: float, y: float) -> Ints:
    """Numbers of the boxes that reach into the tile of a point, rising; none where it is outside of all tiles."""
    at = tiles.tiling
    column, row = (x - at.x) * at.per_m, (y - at.y) * at.per_m
    if not (0.0 <= column < at.columns and 0.0 <= row < at.rows):
        return tiles.listed[:0]
    tile = int(row) * at.columns + int(column)
    return tiles.listed[tiles.listed[tile] : tiles.listed[tile + 1]]


@shared_kernel
def wall_tiles(walls: Floats) -> WallTiles:
    """The tiles of walls (m, 4)."""
    boxes = np.empty((len(walls), 4))
    for k in range(len(walls)):
        boxes[k, 0], boxes[k, 2] = min(walls[k, 0], walls[k, 2]), max(walls[k, 0], walls[k, 2])
        boxes[k, 1], boxes[k, 3] = min(walls[k, 1], walls[k, 3]), max(walls[k, 1], walls[k, 3])
    return WallTiles(walls, tiles_of_boxes(boxes))


@kernel
def _numbers(low: float, high: float, origin: float, per_m: float, count: int) -> tuple[int, int]:
    """The first of the `count` columns, or rows, between two coordinates, and the one after the last."""
    first, last = (low - ROUNDING_M - origin) * per_m, (high + ROUNDING_M - origin) * per_m
    if last < 0.0 or first >= count:
        return 0, 0
    return int(max(first, 0.0)), int(min(last, count - 1.0)) + 1


@kernel
def _rows_beside(
    ax: float, ay: float, bx: float, by: float, column: int, reach: float, tiling: Tiling
) -> tuple[int, int]:
    """The first of a column's rows, and the one after the last, in which a point is within reach of the segment a-b."""
    low, high = min(ay, by), max(ay, by)
    if ax != bx:
        left = tiling.x + column / tiling.per_m - reach
        right = tiling.x + (column + 1) / tiling.per_m + reach
        slope = (by - ay) / (bx - ax)
        one, other = ay + (left - ax) * slope, ay + (right - ax) * slope
        low, high = max(low, min(one, other)), min(high, max(one, other))
    return _numbers(low - reach, high + reach, tiling.y, tiling.per_m, tiling.rows)


@kernel
def keep_off(points: Floats, of: WallTiles, clearance: float) -> Bools:
    """(n,) which of points (n, 2) stay at least the clearance away from every wall."""
    w, tiling, listed = of.walls, of.tiles.tiling, of.tiles.listed
    out = np.ones(len(points), np.bool_)
    for i in range(len(points)):
        x, y = points[i]
        first, end = _numbers(x - clearance, x + clearance, tiling.x, tiling.per_m, tiling.columns)
        low, high = _numbers(y - clearance, y + clearance, tiling.y, tiling.per_m, tiling.rows)
        for row in range(low, high):
            for column in range(first, end):
                tile = row * tiling.columns + column
                for n in range(listed[tile], listed[tile + 1]):
                    k = listed[n]
                    away2 = to_wall2(x, y, w[k, 0], w[k, 1], w[k, 2], w[k, 3])
                    out[i] &= math.sqrt(away2) >= clearance
    return out


@kernel
def barred_by(ax: float, ay: float, bx: float, by: float, of: WallTiles, clearance: float, likely: int) -> int:
    """Row of a wall nearer than the clearance (metres) to the motion a-b, -1 if none is.

    likely: the row that is looked at first, or -1. Tiles are looked into from a on, as most motions are barred nearby.
    """
    w, tiling, listed = of.walls, of.tiles.tiling, of.tiles.listed
    if likely >= 0 and bars(ax, ay, bx, by, w[likely, 0], w[likely, 1], w[likely, 2], w[likely, 3], clearance):
        return likely
    first, end = _numbers(min(ax, bx) - clearance, max(ax, bx) + clearance, tiling.x, tiling.per_m, tiling.columns)
    for i in range(end - first):
        column = first + i if ax <= bx else end - 1 - i
        low, high = _rows_beside(ax, ay, bx, by, column, clearance, tiling)
        for j in range(high - low):
            tile = (low + j if ay <= by else high - 1 - j) * tiling.columns + column
            for n in range(listed[tile], listed[tile + 1]):
                k = listed[n]
                if bars(ax, ay, bx, by, w[k, 0], w[k, 1], w[k, 2], w[k, 3], clearance):
                    return int(k)
    return -1


@kernel
def all_in_view(eyes: Floats, targets: Floats, of: WallTiles) -> Bools:
    """(n,) whether each of targets (n, 2) is seen from the eye (n, 2) of the same row."""
    out = np.empty(eyes.shape[0], np.bool_)
    for k in range(eyes.shape[0]):
        out[k] = not _is_cut(eyes[k, 0], eyes[k, 1], targets[k, 0], targets[k, 1], of)
    return out


@kernel
def _is_cut(ax: float, ay: float, bx: float, by: float, of: WallTiles) -> bool:
    """Whether a wall cuts the line of sight a-b."""
    w, tiling, listed = of.walls, of.tiles.tiling, of.tiles.listed
    first, end = _numbers(min(ax, bx), max(ax, bx), tiling.x, tiling.per_m, tiling.columns)
    for column in range(first, end):
        low, high = _rows_beside(ax, ay, bx, by, column, 0.0, tiling)
        for row in range(low, high):
            tile = row * tiling.columns + column
            for n in range(listed[tile], listed[tile + 1]):
                k = listed[n]
                if crosses(ax, ay, bx, by, w[k, 0], w[k, 1], w[k, 2], w[k, 3]):
                    return True
    return False
