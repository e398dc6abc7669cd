"""Walls sorted into tiles of their plane, so that a sample is held against those nearby alone (ours).

Matching holds each sample against walls a dozen times for each pose that is tried: with all walls of a submap that was
half of all work on recorded logs.
"""

from typing import NamedTuple

import numpy as np

from agent.geometry.lines import Record
from agent.geometry.wall_tiles import Tiles, tiles_of_boxes
from agent.kernels import kernel
from protocol.arrays import Records


class SegmentTiles(NamedTuple):
    """Walls, and which of them may lie within a margin of a point, by the point's tile."""

    walls: Records  # (n,) of SEGMENT
    tiles: Tiles


@kernel
def box_of(e: Record) -> tuple[float, float, float, float]:
    """Least x and y of a segment, and greatest, metres."""
    ax, ay, bx, by = e.x + e.low * e.ux, e.y + e.low * e.uy, e.x + e.high * e.ux, e.y + e.high * e.uy
    return min(ax, bx), min(ay, by), max(ax, bx), max(ay, by)


@kernel
def tiled(walls: Records, margin: float) -> SegmentTiles:
    """Tiles of segments (n,): a point outside of them all is farther than the margin, in metres, from each wall."""
    boxes = np.empty((len(walls), 4))
    for k in range(len(walls)):
        left, bottom, right, top = box_of(walls[k])
        boxes[k, 0], boxes[k, 1], boxes[k, 2], boxes[k, 3] = (
            left - margin,
            bottom - margin,
            right + margin,
            top + margin,
        )
    return SegmentTiles(walls, tiles_of_boxes(boxes))
