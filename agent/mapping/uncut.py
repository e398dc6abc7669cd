"""Walls of a received map that its sender has cut: what it saw itself of a wall, and what others told it (ours).

It tells them apart so that walls at second hand go no farther (`agent.cooperation.peer.Laid.first_hand`). They are one
wall all the same. Left as two they would have open ends where the map has none, and robots would drive there to look.
"""

import math

import numpy as np

from agent.kernels import kernel
from protocol.arrays import Bools, Floats, Ints, Labels
from protocol.wireframe import Label

GAP_M = 0.05  # the two parts end this near to each other: three cells of the radio's grid
OFF_M = 0.03  # ... and lie this near to one line; the two faces of a step in a wall are linked by corners
_NOMINAL = int(Label.NOMINAL)


def uncut(points: Floats, labels: Labels, edges: Ints, own: Bools) -> tuple[Ints, Ints]:
    """The walls whole: their vertices (n, 2), and for each (n,) the row of edges (m, 2) that it has grown from.

    points: (v, 2) metres; labels: (v,); own: (m,) whether the sender saw the wall itself.
    """
    edges, left = edges.copy(), np.ones(len(edges), np.bool_)
    _join(points, labels.copy(), edges, own, left)  # labels of a message are read-only, which is another type
    return edges[left], np.flatnonzero(left)


@kernel
def _join(points: Floats, labels: Labels, edges: Ints, own: Bools, left: Bools) -> None:
    """Let own walls grow by the heard ones that go on with them, and by own ones that these lead to."""
    boxes = np.empty((len(edges), 4))
    for k in range(len(edges)):
        _set_box(boxes[k], points, edges[k])
    for j in range(len(edges)):
        if own[j]:
            continue
        grown = -1
        for k in range(len(edges)):
            one = j if grown < 0 else grown
            if not own[k] or not left[k] or k == grown or boxes[k, 0] > boxes[one, 1] or boxes[k, 1] < boxes[one, 0]:
                continue
            if boxes[k, 2] > boxes[one, 3] or boxes[k, 3] < boxes[one, 2]:
                continue
            if _is_one(points, labels, edges[one], edges[k]):
                if grown < 0:
                    grown = k
                    left[j] = False
                    _grow(points, labels, edges, k, j)
                else:
                    left[k] = False
                    _grow(points, labels, edges, grown, k)
                _set_box(boxes[grown], points, edges[grown])


@kernel
def _set_box(box: Floats, points: Floats, e: Ints) -> None:
    """Set from and to in x and in y (4,) of the wall between vertices e (2,), as wide as what it may be one with."""
    a, b, wide = points[e[0]], points[e[1]], GAP_M + OFF_M
    box[0], box[1] = min(a[0], b[0]) - wide, max(a[0], b[0]) + wide
    box[2], box[3] = min(a[1], b[1]) - wide, max(a[1], b[1]) + wide


@kernel
def _is_one(points: Floats, labels: Labels, one: Ints, other: Ints) -> bool:
    """Whether two walls touch or overlap on one line, and neither has a corner where the other goes on."""
    e, f = (one, other) if _length(points, one) >= _length(points, other) else (other, one)
    length, start, end = _length(points, e), _along(points, e, f[0]), _along(points, e, f[1])
    if start >= end or start > length + GAP_M or end < -GAP_M:
        return False
    if max(_off(points, e, f[0]), _off(points, e, f[1])) > OFF_M:
        return False
    if abs(start) > GAP_M and labels[e[0] if start < 0.0 else f[0]] == _NOMINAL:
        return False
    return bool(abs(end - length) <= GAP_M or labels[e[1] if end > length else f[1]] != _NOMINAL)


@kernel
def _grow(points: Floats, labels: Labels, edges: Ints, k: int, j: int) -> None:
    """Let wall k reach as far as wall j, too. Of two ends in one place a corner is the better known."""
    start, end = _along(points, edges[k], edges[j, 0]), _along(points, edges[k], edges[j, 1])
    length = _length(points, edges[k])
    if start < -GAP_M or (start < GAP_M and labels[edges[j, 0]] == _NOMINAL):
        edges[k, 0] = edges[j, 0]
    if end > length + GAP_M or (end > length - GAP_M and labels[edges[j, 1]] == _NOMINAL):
        edges[k, 1] = edges[j, 1]


@kernel
def _length(points: Floats, e: Ints) -> float:
    """Of the wall between vertices e (2,), metres."""
    a, b = points[e[0]], points[e[1]]
    return math.hypot(b[0] - a[0], b[1] - a[1])


@kernel
def _along(points: Floats, e: Ints, vertex: int) -> float:
    """Where a vertex lies along a wall, metres from the wall's start."""
    a, b, p = points[e[0]], points[e[1]], points[vertex]
    return float(((p[0] - a[0]) * (b[0] - a[0]) + (p[1] - a[1]) * (b[1] - a[1])) / max(_length(points, e), 1e-9))


@kernel
def _off(points: Floats, e: Ints, vertex: int) -> float:
    """How far a vertex is from the line of a wall, metres."""
    a, b, p = points[e[0]], points[e[1]], points[vertex]
    across = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
    return math.fabs(across) / max(_length(points, e), 1e-9)
