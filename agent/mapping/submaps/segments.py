"""Walls of a submap as straight segments with the moments of their hits.

A segment is less than a wall of the wireframe: it has no labels, links or evidence, and is only matched and merged.
"""

import math

import numpy as np

from agent.corner_scan import to_map_frame
from agent.kernels import kernel, shared_kernel
from agent.mapping.layers import Layer
from protocol.arrays import Floats, Records

SEGMENT_SAMPLE_M = 0.2  # distance of the samples of a piece: points, not beams, so that density does not count
MOST_SCANS = 100.0  # scans that a received wall's likelihood stands for, at most

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
    out["seen"] = layer.likelihood / np.maximum(1.0 - layer.likelihood, 1.0 / MOST_SCANS)
    return out


def tips_of(segments: Records) -> Floats:
    """(n, 2, 2) tail and head of each segment, metres."""
    ends = np.stack((segments["low"], segments["high"]), 1)[:, :, None]
    middle, along = (np.stack((segments[x], segments[y]), 1)[:, None] for x, y in (("x", "y"), ("ux", "uy")))
    return np.asarray(middle + ends * along, np.float64)


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
    """(k, 5) points every `SEGMENT_SAMPLE_M` along segments, at least one each.

    x, y, and the segment's direction and length, metres: as long as that is, its points tell its direction.
    """
    count = 0
    for n in range(len(segments)):
        count += max(1, round((segments[n].high - segments[n].low) / SEGMENT_SAMPLE_M))
    out, k = np.empty((count, 5)), 0
    for n in range(len(segments)):
        e = segments[n]
        number = max(1, round((e.high - e.low) / SEGMENT_SAMPLE_M))
        for j in range(number):
            t = e.low + (j + 0.5) * (e.high - e.low) / number
            out[k, 0], out[k, 1], out[k, 2], out[k, 3] = e.x + t * e.ux, e.y + t * e.uy, e.ux, e.uy
            out[k, 4] = e.high - e.low
            k += 1
    return out


def every(samples: Floats, step: int) -> Floats:
    """Each step-th of samples (k, 5), all where the step is 0; in one piece, as kernels have one form for that."""
    return np.ascontiguousarray(samples[:: max(1, step)])
