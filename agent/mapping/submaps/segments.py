"""Walls of a submap as straight segments with the moments of their hits, and how pieces of scans are merged into them.

A segment is less than a wall of the wireframe: it has no labels, links or evidence, and is only matched and merged.
"""

import math
from collections.abc import Sequence

import numpy as np

from agent.corner_scan import to_map_frame
from agent.geometry.lines import Record, above, along, pool
from agent.kernels import kernel, shared_kernel
from agent.mapping.layers import Layer
from protocol.arrays import Floats, Records

SAMPLE_M = 0.2  # distance of the samples of a piece: points, not beams, so that density does not count
MERGE_M = 0.08  # a piece this near to a segment's line is of that segment: a cupboard's face keeps apart from its wall
MERGE_COSINE = math.cos(math.radians(8.0))  # and turned against it by no more
MERGE_GAP_M = 0.25  # two on one line are one across such a gap, as in a scan (`corner_scan.BRIDGE_M`)
SURE = 100.0  # scans that a received wall's likelihood stands for, at most
PASSES = 4  # as merged segments grow, they meet others; after four passes 1 in 100 still does

SEGMENT = np.dtype(
    [
        ("x", "f8"),  # m, centroid of the hits, on the line
        ("y", "f8"),
        ("ux", "f8"),  # unit direction, free space on the left
        ("uy", "f8"),
        ("low", "f8"),  # m along the line from the centroid, where it was seen to begin (< 0) and to end (> 0)
        ("high", "f8"),
        ("hits", "f8"),  # weight: metres of pieces, so that neither distance nor density of beams counts
        ("xx", "f8"),  # m2, scatter of the hits about the centroid, weighted like them
        ("xy", "f8"),
        ("yy", "f8"),
        ("seen", "f8"),  # scans that showed it
    ],
    align=True,
)
"""One segment. An aligned record, so that numba reads its fields like attributes."""


def segments_of(pieces: Records) -> Records:
    """Segments (k,) of the pieces (k,) of one scan, in the frame of the pieces."""
    out = np.zeros(len(pieces), SEGMENT)
    for name in ("x", "y", "ux", "uy"):
        out[name] = pieces[name]
    out["low"], out["high"] = pieces["end"].T
    size = out["high"] - out["low"]
    out["hits"], out["seen"] = size, 1.0
    along_line, across = size**3 / 12.0, size * pieces["residual"] / pieces["hits"]
    out["xx"] = along_line * out["ux"] ** 2 + across * out["uy"] ** 2
    out["yy"] = along_line * out["uy"] ** 2 + across * out["ux"] ** 2
    out["xy"] = (along_line - across) * out["ux"] * out["uy"]
    return out


def segments_in(layer: Layer) -> Records:
    """Segments (k,) of a received map, each as if one scan had shown it, and known as well as its owner says."""
    out = segments_of(layer.pieces)
    out["seen"] = layer.likelihood / np.maximum(1.0 - layer.likelihood, 1.0 / SURE)
    return out


@kernel
def moved(segments: Records, pose: Floats) -> Records:
    """Segments (n,) of the frame of a pose (3,), in the frame in which the pose is given."""
    out = to_map_frame(segments, pose)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in range(len(out)):
        e = out[k]
        xx, xy, yy = e.xx, e.xy, e.yy
        e.xx = c * c * xx - 2 * c * s * xy + s * s * yy
        e.yy = s * s * xx + 2 * c * s * xy + c * c * yy
        e.xy = c * s * (xx - yy) + (c * c - s * s) * xy
    return out


@shared_kernel
def samples_along(segments: Records) -> Floats:
    """(k, 4) points every `SAMPLE_M` along segments, at least one each: x, y, and the direction of the segment."""
    count = 0
    for n in range(len(segments)):
        count += max(1, round((segments[n].high - segments[n].low) / SAMPLE_M))
    out, k = np.empty((count, 4)), 0
    for n in range(len(segments)):
        e = segments[n]
        number = max(1, round((e.high - e.low) / SAMPLE_M))
        for j in range(number):
            t = e.low + (j + 0.5) * (e.high - e.low) / number
            out[k, 0], out[k, 1], out[k, 2], out[k, 3] = e.x + t * e.ux, e.y + t * e.uy, e.ux, e.uy
            k += 1
    return out


def every(samples: Floats, step: int) -> Floats:
    """Each step-th of samples (k, 4), all where the step is 0; in one piece, as kernels have one form for that."""
    return np.ascontiguousarray(samples[:: max(1, step)])


def united(parts: Sequence[Records]) -> Records:
    """All segments of several maps in one frame as one map: (n,), longest first."""
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
    for k in range(len(new)):
        p = new[k]
        best, e = MERGE_M, -1
        for f in range(count):
            off = _apart(walls[f], p)
            if off < best:
                best, e = off, f
        if e >= 0:
            _fuse(walls[e], p)
        elif count < len(walls):
            walls[count] = p
            count += 1
    return count


@kernel
def _apart(e: Record, p: Record) -> float:
    """How far p lies beside segment e, at most, metres; inf where they are turned or a gap is between them."""
    if e.ux * p.ux + e.uy * p.uy < MERGE_COSINE:
        return math.inf
    t = along(e, p.x, p.y)
    if t + p.low > e.high + MERGE_GAP_M or t + p.high < e.low - MERGE_GAP_M:
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
