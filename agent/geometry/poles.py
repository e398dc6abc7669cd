"""Poles in a wireframe: small squares that stand free, of four walls too short to be seen one by one (ours).

They travel and are drawn as rings of walls, like all that is solid. Who receives a map finds them by their form.
"""

import math

import numpy as np

from protocol.arrays import Bools, Floats, Ints
from protocol.walls import lengths, neighbours
from protocol.wireframe import Label, Wireframe

POLE_M = 0.07
"""Most of a pole's width. Three beams, the least of a piece, meet 8 cm from 1.5 m away and 4 cm from 0.8 m."""
SAME_POLE_M = 0.1
"""Poles nearer to each other than this, or to a wall, are one thing: two robots place a pole 2 cm apart at most."""
CORNERS = 0.5 * np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)])  # clockwise: free space on the left


def find_poles(wireframe: Wireframe) -> tuple[Floats, Ints]:
    """Poles (p, 3) of a map: x, y and width in metres; and (m,) which of them each wall is of, or -1."""
    count = len(wireframe.points)
    _, after = neighbours(wireframe.edges, count)
    after = np.append(after, -1)  # of no vertex, row -1, no vertex comes next
    size = np.full(count + 1, math.inf)  # of the wall that leaves each vertex, metres
    size[wireframe.edges[:, 0]] = lengths(wireframe.segments())
    rings = [np.arange(count)]
    for _ in range(4):
        rings.append(after[rings[-1]])
    closed = (rings[4] == rings[0]) & (rings[2] != rings[0]) & (size[rings[:4]] <= POLE_M).all(0)
    corners = np.stack(rings[:4], 1)[closed & (np.min(rings[1:4], axis=0) > rings[0])]  # (p, 4) of each ring but once
    pole_of = np.full(count, -1)
    pole_of[corners] = np.arange(len(corners))[:, None]
    places = wireframe.points[corners]
    width = np.hypot(*(places - np.roll(places, 1, axis=1)).transpose(2, 0, 1)).mean(1)
    return np.column_stack((places.mean(1), width)), pole_of[wireframe.edges[:, 0]]


def with_poles(wireframe: Wireframe, poles: Floats, likelihood: Floats, own: Bools, axis: float) -> Wireframe:
    """A map with poles (p, 3), x, y and width in metres, as squares that are turned by `axis`, radians.

    likelihood (p,), own (p,): of their walls, as in a wireframe.
    """
    if not len(poles):
        return wireframe
    c, s = math.cos(axis), math.sin(axis)
    corners = poles[:, None, :2] + poles[:, None, 2:] * (CORNERS @ np.array([(c, s), (-s, c)]))
    first = len(wireframe.points) + 4 * np.arange(len(poles), dtype=np.int32)[:, None]
    nth = np.arange(4, dtype=np.int32)
    edges = np.stack((first + nth, first + (nth + 1) % 4), 2).reshape(-1, 2)
    return Wireframe(
        np.vstack((wireframe.points, corners.reshape(-1, 2))),
        np.append(wireframe.labels, np.full(4 * len(poles), Label.NOMINAL, np.uint8)),
        np.vstack((wireframe.edges, edges)).astype(np.int32),
        np.append(wireframe.likelihood, np.repeat(likelihood, 4)).astype(np.float32),
        np.append(wireframe.own, np.repeat(own, 4)),
    )
