"""The open ends of walls, and where to stand to see on (ours).

The paper drives to the closest frontier vertex (IV, Algorithm 1). Ours stands where the hidden continuation of the
wall should come into view, and treats occlusion ends alike.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agent.corner_scan import FRONTIER, NOMINAL
from agent.kernels import kernel
from protocol.arrays import Bools, Floats, Ints, Labels
from protocol.wireframe import Wireframe

EXPECTED_GRAZING_RAD = 0.35
"""Flattest view of a hidden wall that is expected to show it: 20 degrees; 8 are seen in principle."""
CLOSE_GRAZING_RAD = 0.05
"""The same at the mouth of a slot that nothing else shows, 3 degrees: a robot 0.04 m aside of a cabinet's corner and
0.25 m off it has five beams on the first 0.3 m of the cabinet's side. With such views recall in hurtado_apartment is
0.972-0.978 instead of 0.958-0.966, for a fifth more time (five starts)."""
_BEYOND_M = 0.08  # how far beyond its end the hidden part of a wall is looked for; a tenth of a doorway
_TOUCH_M = 0.02  # ... and how far off the wall, so that the line of sight does not end in it


def _offsets(along: tuple[float, ...], off: tuple[float, ...]) -> Floats:
    return np.array([(a, b) for a in along for b in off])


_FRONTIER = _offsets((-0.3, 0.2, 0.7, 1.3), (0.3, 0.6, 1.0, 1.6, 2.3))
_OCCLUSION = _offsets((0.2, 0.5, 1.0, 1.6), (1.2, 0.6, 0.25, 0.0, -0.4))
_EDGE = _offsets((-0.6, 0.0, 0.6), (0.5, 1.0, 1.6))
"""Standing points (n, 2): metres along the wall beyond its end (of `_EDGE` its middle), and off it on the free side."""
_CLOSE_FRONTIER = _offsets((-0.6, -0.4, -0.2, 0.0), (0.14, 0.2))
_CLOSE_OCCLUSION = _offsets((0.04, 0.08, 0.13), (0.15, 0.25, 0.4, 0.6))
"""The same for a view into a slot too narrow to stand in: close beside the wall, hardly beyond its end."""


class Ends(NamedTuple):
    """Open ends of walls, as arrays over g ends, frame of the map."""

    points: Floats  # (g, 2) metres
    along: Floats  # (g, 2) unit: where the wall goes on
    free: Floats  # (g, 2) unit: off the wall, on its free side
    frontier: Bools  # (g,): the wall goes on; else it turns away (occlusion)
    heard: Bools  # (g,): only others saw the wall


class Stands(NamedTuple):
    """Standing points, as arrays over s points."""

    points: Floats  # (s, 2) metres
    in_view: Floats  # (s, 2) metres: what must be in view from there
    goal: Ints  # (s,): which goal it serves


def open_ends(wireframe: Wireframe) -> Ends:
    """The frontier and occlusion ends of the chains of a map; nominal ends ask for nothing."""
    return Ends(*_open_ends(wireframe.points, wireframe.labels, wireframe.edges, wireframe.own))


@kernel
def _open_ends(
    points: Floats, labels: Labels, edges: NDArray[np.int32], own: Bools
) -> tuple[Floats, Floats, Floats, Bools, Bools]:
    """The fields of Ends, heads of chains first, by those of a wireframe."""
    n = len(points)
    into, out_of, told = np.full(n, -1), np.full(n, -1), np.zeros(n, np.bool_)
    for k in range(len(edges)):
        a, b = edges[k]
        out_of[a], into[b] = b, a
        told[a] |= not own[k]
        told[b] |= not own[k]
    rows, beside, count, heads = np.empty(n, np.int64), np.empty(n, np.int64), 0, 0
    for side in range(2):
        heads = count  # of chains; tails follow
        other, none = (into, out_of) if side == 0 else (out_of, into)
        for v in range(n):
            if labels[v] != NOMINAL and other[v] >= 0 and none[v] < 0:
                rows[count], beside[count] = v, other[v]
                count += 1
    at, along, free = np.empty((count, 2)), np.empty((count, 2)), np.empty((count, 2))
    frontier, heard = np.empty(count, np.bool_), np.empty(count, np.bool_)
    for k in range(count):
        v = rows[k]
        dx, dy = points[v, 0] - points[beside[k], 0], points[v, 1] - points[beside[k], 1]
        length, sign = max(math.hypot(dx, dy), 1e-9), 1.0 if k < heads else -1.0
        at[k, 0], at[k, 1], along[k, 0], along[k, 1] = points[v, 0], points[v, 1], dx / length, dy / length
        free[k, 0], free[k, 1] = -sign * along[k, 1], sign * along[k, 0]
        frontier[k], heard[k] = labels[v] == FRONTIER, told[v]
    return at, along, free, frontier, heard


def same_wall(ends: Ends, gap_m: float, off_m: float) -> Ints:
    """Per end (g,) the row of the first end that faces it across a gap in one wall, or its own: these are one goal.

    gap_m: between them along the wall; off_m: across it, at most.
    """
    d = ends.points[None, :] - ends.points[:, None]
    ahead, aside = (d * ends.along[:, None]).sum(2), np.abs((d * ends.free[:, None]).sum(2))
    facing = (ends.free @ ends.free.T > 0.95) & (ends.along @ ends.along.T < -0.95)
    facing &= (ahead > 0) & (ahead < gap_m) & (aside < off_m) & ends.frontier[:, None] & ends.frontier[None, :]
    one = np.arange(len(ends.points))
    for i, j in np.argwhere(facing):
        one[max(i, j)] = min(one[i], one[j], i, j)
    return one


def stands_of(ends: Ends, which: Ints, close: bool = False) -> Stands:
    """Points from which the hidden continuation of the chosen ends should come into view.

    which: (k,) rows of `ends`. close: points at the mouth of a slot behind furniture, for ends that nothing else shows.
    """
    grazing_rad = CLOSE_GRAZING_RAD if close else EXPECTED_GRAZING_RAD
    points, in_view, goal = [], [], []
    for frontier in (True, False):
        chosen = which[ends.frontier[which] == frontier]
        p, u, n = ends.points[chosen], ends.along[chosen], ends.free[chosen]
        if frontier:
            offsets, seen = _CLOSE_FRONTIER if close else _FRONTIER, p + _BEYOND_M * u + _TOUCH_M * n
        elif close:
            offsets, seen = _CLOSE_OCCLUSION, p + _TOUCH_M * u - _BEYOND_M * n
        else:
            offsets, seen = _OCCLUSION, p + _BEYOND_M * u
        stand = p[:, None] + offsets[:, :1] * u[:, None] + offsets[:, 1:] * n[:, None]
        view = stand - seen[:, None]
        # a frontier's wall goes on along u, seen from the side n; an occluded wall leaves the end towards -n
        across = (view * (n if frontier else u)[:, None]).sum(2)
        good = across >= math.sin(grazing_rad) * np.hypot(view[..., 0], view[..., 1])
        points.append(stand[good])
        in_view.append(np.broadcast_to(seen[:, None], stand.shape)[good])
        goal.append(np.broadcast_to(chosen[:, None], good.shape)[good])
    return Stands(np.concatenate(points), np.concatenate(in_view), np.concatenate(goal))


def stands_at_edges(wireframe: Wireframe, which: Ints) -> Stands:
    """Points in front of some edges, on their free side. which: (k,) rows of `wireframe.edges`."""
    a, b = wireframe.points[wireframe.edges[which, 0]], wireframe.points[wireframe.edges[which, 1]]
    u = (b - a) / np.maximum(np.hypot(*(b - a).T), 1e-9)[:, None]
    n = np.stack((-u[:, 1], u[:, 0]), 1)
    middle = 0.5 * (a + b)
    stand = middle[:, None] + _EDGE[:, :1] * u[:, None] + _EDGE[:, 1:] * n[:, None]
    seen = np.broadcast_to((middle + _TOUCH_M * n)[:, None], stand.shape)
    return Stands(stand.reshape(-1, 2), seen.reshape(-1, 2), np.repeat(which, len(_EDGE)))
