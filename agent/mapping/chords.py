"""Chords: what scans have fitted across a corner, beside both of its walls, is none of the published walls (ours).

Where lines have taken a few hits of each other, the hits between them fit a third line, that crosses both. Real walls
do not cross, and the two that share a corner explain the hits.
"""

from agent.geometry.lines import Record, meet
from agent.kernels import kernel
from agent.mapping.edges import tip_at
from protocol.arrays import Ints, Records


@kernel
def hide_chords(edges: Records, shown: Ints) -> None:
    """Set `shown` (n,), not negative for walls that are published, to -1 for those without corners that are chords."""
    for k in range(len(edges)):
        if shown[k] < 0 or edges[k].link[0] >= 0 or edges[k].link[1] >= 0:
            continue
        for e in range(len(edges)):
            f = edges[e].link[1] if shown[e] >= 0 else -1
            if f >= 0 and shown[f] >= 0 and _cross(edges[k], edges[e]) and _cross(edges[k], edges[f]):
                shown[k] = -1
                break


@kernel
def _cross(e: Record, f: Record) -> bool:
    """Whether two walls cross between their ends, going about the same way."""
    sine, at_e = meet(e, f)
    if sine == 0.0 or e.ux * f.ux + e.uy * f.uy < 0.0:
        return False
    at_f = meet(f, e)[1]
    return bool(tip_at(e, 0) < at_e < tip_at(e, 1) and tip_at(f, 0) < at_f < tip_at(f, 1))
