"""Faces too small to be seen as walls: the tip of a thin wall and a small step, closed from their two sides (ours).

A face of 2 cm never shows enough beams to be a wall. But where two walls end beside each other with solid between them,
something must join their ends. Such a face belongs to the published map only: it is worked out anew from the walls
whenever they change, so no view has to confirm or to contradict it.
"""

import math

import numpy as np

from agent.corner_scan import OCCLUSION
from agent.geometry.lines import Record, above, along
from agent.kernels import kernel
from agent.mapping.edges import WALL, set_tip, tip_at
from agent.mapping.ends import END_MARGIN_M
from protocol.arrays import Ints, Records

SMALL_M = 0.07  # a longer face shows itself, by three beams from 1.3 m away; one of 6 cm may seem to be longer
PARALLEL = math.cos(math.radians(10.0))  # both walls of a small face go the same way or the opposite one, within this
FLAT_M = 0.01  # a plate without thickness has faces in the same line, give or take their errors


@kernel
def close_small_faces(edges: Records, shown: Ints) -> Ints:
    """The wall whose tail is joined to the head of each wall by a small face, or -1: (n,).

    shown: (n,) not negative for walls that are published. Ends that share a face are moved to stand square to it.
    """
    head, tail = np.full(len(edges), -1), np.full(len(edges), -1)  # the best partner of each end
    for e in range(len(edges)):
        head[e] = _nearest(edges, shown, e, 1)
        tail[e] = _nearest(edges, shown, e, 0)
    for e in range(len(edges)):
        if head[e] >= 0 and tail[head[e]] != e:
            head[e] = -1
    for e in range(len(edges)):
        if head[e] >= 0:
            _stand_square(edges[e], edges[head[e]])
    return head


@kernel
def _nearest(edges: Records, shown: Ints, e: int, side: int) -> int:
    """The wall with the end that a small face joins to this end of wall e, the nearest of several; -1: none."""
    best, winner = math.inf, -1
    if not _ends_here(edges, shown, e, side):
        return -1
    for f in range(len(edges)):
        if f == e or not _ends_here(edges, shown, f, 1 - side):
            continue
        first, second = (edges[e], edges[f]) if side == 1 else (edges[f], edges[e])
        if _face_between(first, second):
            apart = math.hypot(first.tip[1, 0] - second.tip[0, 0], first.tip[1, 1] - second.tip[0, 1])
            if apart < best:
                best, winner = apart, f
    return winner


@kernel
def _ends_here(edges: Records, shown: Ints, e: int, side: int) -> bool:
    """Whether a published wall was seen to end here, and what it meets was not."""
    w = edges[e]
    return bool(w.kind == WALL and shown[e] >= 0 and w.link[side] < 0 and w.label[side] == OCCLUSION)


@kernel
def _face_between(e: Record, f: Record) -> bool:
    """Whether the head of e and the tail of f may be the ends of one small face.

    Of two walls back to back, each must lie on the solid side of the other: else they are the sides of a slot.
    """
    way = e.ux * f.ux + e.uy * f.uy
    depth, back = -above(e, f.tip[0, 0], f.tip[0, 1]), -above(f, e.tip[1, 0], e.tip[1, 1])
    if abs(way) < PARALLEL or abs(depth) > SMALL_M or (way < 0.0 and min(depth, back) < -FLAT_M):
        return False
    low, high = _common(e, f)
    return bool(low - high <= END_MARGIN_M)


@kernel
def _common(e: Record, f: Record) -> tuple[float, float]:
    """Where along e both ends may be, metres: the last begin of their intervals and the first end."""
    sign = 1.0 if e.ux * f.ux + e.uy * f.uy > 0.0 else -1.0
    own, other = tip_at(e, 1), along(e, f.tip[0, 0], f.tip[0, 1])
    reach = other - sign * f.slack[0]
    return max(own, min(other, reach)), min(own + e.slack[1], max(other, reach))


@kernel
def _stand_square(e: Record, f: Record) -> None:
    """Move the head of e and the tail of f to the same place along e, in the middle of where both may be."""
    low, high = _common(e, f)
    x, y = e.x + 0.5 * (low + high) * e.ux, e.y + 0.5 * (low + high) * e.uy
    set_tip(e, 1, along(e, x, y))
    set_tip(f, 0, along(f, x, y))
