"""Walls sorted into tiles of their plane, so that a sample is held against those nearby alone (ours).

Matching holds each sample against walls a dozen times for each pose that is tried: with all walls of a submap that was
half of all work on recorded logs.
"""

from typing import NamedTuple

import numpy as np

from agent.geometry.wall_tiles import tiles_of_boxes
from agent.kernels import kernel
from protocol.arrays import Ints, Records


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
    tiles = tiles_of_boxes(boxes)
    return Tiles(walls, tiles.x, tiles.y, tiles.per_m, tiles.columns, tiles.rows, tiles.listed)
