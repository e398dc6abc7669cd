"""How segments of scans and submaps become one map: those on one line are merged (ours)."""

import math
from collections.abc import Sequence

import numpy as np

from agent.corner_scan import BRIDGE_M
from agent.geometry.lines import Record, above, along, pool
from agent.geometry.wall_tiles import Tiling, tiling_of
from agent.kernels import kernel
from agent.mapping.submaps.segments import SEGMENT
from agent.mapping.submaps.tiles import box_of
from protocol.arrays import Ints, Records

MERGE_M = 0.08  # a piece this near to a segment's line is of that segment: a cupboard's face keeps apart from its wall
MERGE_COSINE = math.cos(math.radians(8.0))  # and turned against it by no more
MARGIN_M, MARGIN_SHARE = 0.4, 0.02
"""The boxes about two segments that are merged are no farther apart than this, and this share of the new one's length:
the gap, the distance from the line, and by how much a turn of 8 degrees shortens a projection."""
PASSES = 4  # as merged segments grow, they meet others; after four passes 1 in 100 still does


def united(parts: Sequence[Records]) -> Records:
    """All segments of several maps in one frame as one map: (n,), those of most hits first, or nearly so."""
    walls = np.concatenate((np.zeros(0, SEGMENT), *parts))
    for _ in range(PASSES):
        walls = walls[np.argsort(-walls["hits"], kind="stable")]
        merged = np.zeros(len(walls), SEGMENT)
        count = merge(merged, 0, walls)
        if count == len(walls):
            break
        walls = merged[:count]
    return walls


@kernel
def merge(walls: Records, count: int, new: Records) -> int:
    """Merge segments `new` (k,) into the first `count` of `walls` in place, both in one frame; returns the new count.

    Each goes to the segment beside whose line it lies nearest; one that fits none is added, while there is room.
    """
    tiling = _tiling(walls[:count], new)
    first = np.full(tiling.columns * tiling.rows, -1)  # where the list of each tile begins, or -1
    listed = [(0, 0) for _ in range(0)]  # a segment that touches the tile, and where the list goes on
    spans, looked = np.full((len(walls), 4), -1), np.full(len(walls), -1)
    for k in range(-count, len(new)):
        e = count + k  # the first ones only enter the lists
        if k >= 0:
            e = _nearest(tiling, first, listed, looked, walls, new, k)
            if e >= 0:
                _fuse(walls[e], new[k])
            elif count < len(walls):
                walls[count], e = new[k], count
                count += 1
            else:
                continue
        c0, r0, c1, r1 = _span(tiling, walls[e], 0.0)
        span = spans[e]
        if c0 == span[0] and r0 == span[1] and c1 == span[2] and r1 == span[3]:
            continue
        span[0], span[1], span[2], span[3] = c0, r0, c1, r1
        for row in range(r0, r1 + 1):
            for column in range(c0, c1 + 1):
                listed.append((e, first[row * tiling.columns + column]))
                first[row * tiling.columns + column] = len(listed) - 1
    return count


@kernel
def _nearest(
    tiling: Tiling, first: Ints, listed: list[tuple[int, int]], looked: Ints, walls: Records, new: Records, k: int
) -> int:
    """The wall beside whose line segment k of the new ones lies nearest, or -1.

    looked: (n,) the new segment for which each wall was looked at last.
    """
    p = new[k]
    best, e = MERGE_M, -1
    c0, r0, c1, r1 = _span(tiling, p, MARGIN_M + MARGIN_SHARE * (p.high - p.low))
    for row in range(r0, r1 + 1):
        for column in range(c0, c1 + 1):
            at = first[row * tiling.columns + column]
            while at >= 0:
                f, at = listed[at]
                if looked[f] == k:
                    continue
                looked[f] = k
                off = _apart(walls[f], p)
                if off < best or (off == best and f < e):
                    best, e = off, f
    return e


@kernel
def _tiling(walls: Records, new: Records) -> Tiling:
    """Tiles about segments (n,) and (k,)."""
    left, bottom, right, top = math.inf, math.inf, -math.inf, -math.inf
    for records in (walls, new):
        for e in range(len(records)):
            x0, y0, x1, y1 = box_of(records[e])
            left, bottom, right, top = min(left, x0), min(bottom, y0), max(right, x1), max(top, y1)
    return tiling_of(left, bottom, right, top) if left <= right else Tiling(0.0, 0.0, 1.0, 1, 1)


@kernel
def _span(tiling: Tiling, e: Record, margin: float) -> tuple[int, int, int, int]:
    """First column and row of the tiles that a segment comes within a margin of, metres, and the last ones.

    What lies beyond a side counts to the tiles along it.
    """
    x0, y0, x1, y1 = box_of(e)
    return (
        max(0, min(int((x0 - margin - tiling.x) * tiling.per_m), tiling.columns - 1)),
        max(0, min(int((y0 - margin - tiling.y) * tiling.per_m), tiling.rows - 1)),
        max(0, min(int((x1 + margin - tiling.x) * tiling.per_m), tiling.columns - 1)),
        max(0, min(int((y1 + margin - tiling.y) * tiling.per_m), tiling.rows - 1)),
    )


@kernel
def _apart(e: Record, p: Record) -> float:
    """How far p lies beside segment e, at most, metres; inf where they are turned or a gap is between them."""
    if e.ux * p.ux + e.uy * p.uy < MERGE_COSINE:
        return math.inf
    t = along(e, p.x, p.y)
    if t + p.low > e.high + BRIDGE_M or t + p.high < e.low - BRIDGE_M:
        return math.inf
    # at both ends of what they share, or of the gap: lines of short pieces swing far out beyond
    a, b = max(t + p.low, e.low), min(t + p.high, e.high)
    off = abs(above(p, e.x + a * e.ux, e.y + a * e.uy))
    return max(off, abs(above(p, e.x + b * e.ux, e.y + b * e.uy)))


@kernel
def _fuse(e: Record, p: Record) -> None:
    """Fuse segment p into e on the same line."""
    ends = (e.x + e.low * e.ux, e.y + e.low * e.uy, e.x + e.high * e.ux, e.y + e.high * e.uy)
    pool(e, p.hits, p.x, p.y, (p.xx, p.xy, p.yy))
    e.seen += p.seen
    t = along(e, p.x, p.y)
    e.low = min(along(e, ends[0], ends[1]), t + p.low)
    e.high = max(along(e, ends[2], ends[3]), t + p.high)
