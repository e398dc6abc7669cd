"""The wireframe that a particle's walls are published as: what no scan shows is closed, opened or left away (ours)."""

import numpy as np
from numpy.typing import NDArray

from agent.corner_scan import NOMINAL, OCCLUSION
from agent.geometry.chains import chained
from agent.kernels import kernel
from agent.mapping.blunt_corners import close_blunt_corners
from agent.mapping.chords import hide_chords
from agent.mapping.edges import has_slot, is_published, part
from agent.mapping.small_faces import close_small_faces
from agent.mapping.squares import square_short_walls
from protocol.arrays import Bools, Floats, Labels, Records


@kernel
def published(edges: Records, noise: float) -> tuple[Floats, Labels, NDArray[np.int32], NDArray[np.float32], Bools]:
    """The arrays of the wireframe of a particle's walls (n,) of EDGE, in the order of its fields.

    Slots are open in it, short walls square, blunt corners and small faces closed, and chords left away. noise: m,
    standard deviation of a range.
    """
    shown = np.full(len(edges), -1)
    for k in range(len(edges)):
        if is_published(edges[k]):
            shown[k] = 1
    edges = edges.copy()
    for k in range(len(edges)):
        if shown[k] >= 0 and edges[k].link[1] >= 0 and has_slot(edges, k, edges[k].link[1]):
            part(edges, k, 1)
    square_short_walls(edges, shown, noise)
    close_blunt_corners(edges, shown, noise)
    hide_chords(edges, shown)
    joined = close_small_faces(edges, shown)
    place, m = np.full(len(edges), -1), 0
    for k in range(len(edges)):
        if shown[k] >= 0:
            place[k] = m
            m += 1
    total = m + int((joined >= 0).sum())
    tips, labels, following = np.empty((total, 2, 2)), np.empty((total, 2), np.uint8), np.empty(total, np.int64)
    likelihood, own = np.empty(total, np.float32), np.empty(total, np.bool_)
    for k in range(len(edges)):
        w = place[k]
        if w < 0:
            continue
        e = edges[k]
        for side in range(2):
            tips[w, side, 0], tips[w, side, 1] = e.tip[side, 0], e.tip[side, 1]
            lonely = e.link[side] >= 0 and place[e.link[side]] < 0  # its partner is not shown yet
            labels[w, side] = OCCLUSION if lonely else e.label[side]
        following[w] = place[e.link[1]] if e.link[1] >= 0 else -1
        likelihood[w] = min(max((e.seen + 1.0) / (e.due + 2.0), 0.0), 1.0)
        own[w] = e.own == 1
    face = m
    for k in range(len(edges)):
        if joined[k] < 0:
            continue
        before, after = place[k], place[joined[k]]
        tips[face, 0], tips[face, 1] = tips[before, 1], tips[after, 0]
        labels[before, 1], labels[face, 0], labels[face, 1], labels[after, 0] = NOMINAL, NOMINAL, NOMINAL, NOMINAL
        following[before], following[face] = face, after
        likelihood[face] = min(likelihood[before], likelihood[after])
        own[face] = own[before] and own[after]
        face += 1
    points, vertex_labels, wall_vertices = chained(tips, labels, following)
    return points, vertex_labels, wall_vertices, likelihood, own
