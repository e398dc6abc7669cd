"""Walls that share corners as arrays of vertices and edges (paper III-A)."""

import numpy as np
from numpy.typing import NDArray

from agent.kernels import shared_kernel
from protocol.arrays import Floats, Ints, Labels


def chains_of(before: Ints, after: Ints) -> list[list[int]]:
    """Vertices of each chain in order, of a ring the first again at the end; before, after: (n,) of each, or -1."""
    left, chains = set(range(len(after))), []
    for start in (*np.flatnonzero(before < 0).tolist(), *range(len(after))):
        chain, v = [], start
        while v in left:
            left.discard(v)
            chain.append(v)
            v = int(after[v])
        if chain:
            chains.append([*chain, v] if v == chain[0] else chain)
    return chains


@shared_kernel
def chained(tips: Floats, labels: Labels, following: Ints) -> tuple[Floats, Labels, NDArray[np.int32]]:
    """Vertices (n, 2), their labels (n,) and edges (m, 2) of m walls.

    tips (m, 2, 2): tail and head of each wall, metres; labels (m, 2) theirs; following (m,): the wall whose tail is
    this one's head, or -1. A shared corner is the head.
    """
    m = len(tips)
    shared = np.zeros(m, np.bool_)
    for k in range(m):
        if following[k] >= 0:
            shared[following[k]] = True
    points, vertex_labels = np.empty((2 * m, 2)), np.empty(2 * m, np.uint8)
    edges, n = np.empty((m, 2), np.int32), 0
    for k in range(m):
        for side in range(2):
            if side == 0 and shared[k]:
                continue
            points[n], vertex_labels[n], edges[k, side] = tips[k, side], labels[k, side], n
            n += 1
    for k in range(m):
        if following[k] >= 0:
            edges[following[k], 0] = edges[k, 1]
    return points[:n].copy(), vertex_labels[:n].copy(), edges
