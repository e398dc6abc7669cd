"""Walls sorted into tiles of their plane, so that a sample is held against those nearby alone (ours).

Matching holds each sample against walls a dozen times for each pose that is tried: with all walls of a submap that was
half of all work on recorded logs.
"""

from typing import NamedTuple

import numpy as np

from agent.geometry.wall_tiles import Tiles, tiles_of_boxes
from agent.kernels import kernel
from protocol.arrays import Records


class SegmentTiles(NamedTuple):
    """Walls, and which of them may lie within a margin of a point, by the point's tile."""

    walls: Records  # (n,) of SEGMENT
    tiles: Tiles


@kernel
def tiled(walls: Records, margin: float) -> SegmentTiles:
    """Tiles of segments (n,): a point outside of them all is farther than the margin, in metres, from each wall."""
    boxes = np.empty((len(walls), 4))
    for k in range(len(walls)):
        e = walls[k]
        ax, ay, bx, by = e.x + e.low * e.ux, e.y + e.low * e.uy, e.x + e.high * e.ux, e.y + e.high * e.uy
        boxes[k, 0], boxes[k, 1] = min(ax, bx) - margin, min(ay, by) - margin
        boxes[k, 2], boxes[k, 3] = max(ax, bx) + margin, max(ay, by) + margin
    return SegmentTiles(walls, tiles_of_boxes(boxes))
