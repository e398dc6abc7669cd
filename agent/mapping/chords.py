"""Chords: a line that scans have fitted across a corner, or along a wall, is none of the published walls (ours).

Where lines have taken a few hits of each other, the hits between them fit a third line, that crosses both. Real walls
do not cross, and the two that share a corner explain the hits. So does one wall that is bent by a few degrees.
"""

from agent.geometry.clearance import crosses
from agent.geometry.lines import Record, above, along
from agent.kernels import kernel
from agent.mapping.blunt_corners import BESIDE_CORNER_M, CROSSED_M
from agent.mapping.edges import tip_at
from protocol.arrays import Ints, Records


@kernel
def hide_chords(edges: Records, shown: Ints) -> None:
    """Set `shown` (n,), not negative for walls that are published, to -1 for those without corners that are chords."""
    for k in range(len(edges)):
        if shown[k] < 0 or edges[k].link[0] >= 0 or edges[k].link[1] >= 0:
            continue
        for e in range(len(edges)):
            if e == k or shown[e] < 0 or not _cross(edges[k], edges[e]):
                continue
            f = edges[e].link[1]
            across_corner = f >= 0 and shown[f] >= 0 and _cross(edges[k], edges[f])
            if across_corner or _is_along(edges[k], edges[e]):
                shown[k] = -1
                break


@kernel
def _is_along(e: Record, f: Record) -> bool:
    """Whether all of wall e lies close beside wall f, but for what may go on past a corner of it."""
    for x, y in e.tip:
        t = along(f, x, y)
        if abs(above(f, x, y)) > BESIDE_CORNER_M or not tip_at(f, 0) - CROSSED_M <= t <= tip_at(f, 1) + CROSSED_M:
            return False
    return True


@kernel
def _cross(e: Record, f: Record) -> bool:
    """Whether two walls cross, going about the same way."""
    if e.ux * f.ux + e.uy * f.uy < 0.0:
        return False
    a, b = e.tip, f.tip
    return crosses(a[0, 0], a[0, 1], a[1, 0], a[1, 1], b[0, 0], b[0, 1], b[1, 0], b[1, 1])
