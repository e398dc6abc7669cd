"""What is left of a scan after perception: wall pieces, open sectors and teammates' discs, in the robot's frame.

Nothing after perception sees a range (paper I: strict adherence to sparsity).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocol.wireframe import Label, Wireframe

Record = Any
"""One element of a record array inside a kernel; numba reads its fields like attributes."""

PIECE = np.dtype(
    [
        ("hits", "f8"),  # beams on the piece
        ("x", "f8"),  # m, centroid of the hits, on the fitted line
        ("y", "f8"),
        ("ux", "f8"),  # unit direction, counter-clockwise: free space on the left
        ("uy", "f8"),
        ("spread", "f8"),  # m2, sum of squared distances of the hits from the centroid along the line
        ("end", "f8", (2,)),  # m along the line from the centroid: tail (< 0) and head (> 0)
        ("slack", "f8", (2,)),  # m by which an occlusion end may lie farther out
        ("label", "i8", (2,)),  # Label of tail and head
        ("link", "i8", (2,)),  # the piece that shares the corner at tail and head, or -1
        ("bearing", "f8", (2,)),  # rad, of the first and the last beam, rising; the last may exceed 2 pi
    ],
    align=True,
)
"""One wall piece of a corner scan. An aligned record, so that numba reads its fields like attributes."""


@dataclass(frozen=True, slots=True)
class CornerScan:
    """A scan as corners and walls."""

    pieces: NDArray[np.void]
    """(k,) of PIECE, by rising bearing of the first beam."""
    open: NDArray[np.float64]
    """(s, 2) rad, from and to (may exceed 2 pi): sectors in which nothing is within range."""
    discs: NDArray[np.float64]
    """(d, 2) m, centres of what looks like teammates."""
    reach: float
    """m, how far open sectors are known to be free."""
    noise: float
    """m, standard deviation of a range."""

    def wireframe(self) -> Wireframe:
        """The scan as a wireframe in the robot's frame; pieces that share a corner share a vertex."""
        points: list[tuple[float, float]] = []
        labels: list[int] = []
        vertex = np.full((len(self.pieces), 2), -1)
        for k, piece in enumerate(self.pieces):
            for side in (0, 1):
                if vertex[k, side] >= 0:
                    continue
                t = piece["end"][side]
                vertex[k, side] = len(points)
                points.append((piece["x"] + t * piece["ux"], piece["y"] + t * piece["uy"]))
                labels.append(int(piece["label"][side]))
                if piece["label"][side] == Label.NOMINAL:
                    vertex[piece["link"][side], 1 - side] = vertex[k, side]
        m = len(vertex)
        return Wireframe(
            np.array(points, np.float64).reshape(-1, 2),
            np.array(labels, np.uint8),
            vertex.astype(np.int32).reshape(-1, 2),
            np.ones(m, np.float32),
            np.ones(m, np.bool_),
        )
