"""A received map merged with the robot's own (paper IV; rule ours): as if it were one large scan, moved by T.

The filter itself stays what own scans made of it. Received walls are laid over its best particle anew whenever
either changes: matched walls become one line by their hits, of which a received one has few, open ends are closed by
what the other saw, and what is left is added. So walls that come back are no fresh evidence, a newer map replaces the
older one, and undoing a merge is complete: the layer is left away.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from agent.corner_scan import FRONTIER, NOMINAL, OCCLUSION, PIECE
from agent.geometry.lines import along
from agent.geometry.poles import find_poles
from agent.kernels import kernel
from agent.mapping.association import BEST, Gates, associate
from agent.mapping.edges import (
    FREE,
    MIN_WALL_M,
    PUBLISH_AFTER,
    WALL,
    is_published,
    remove,
    set_end,
    set_tip,
    shared_length,
    tip_at,
)
from agent.mapping.scan_merge import ALWAYS, merge_scan
from agent.mapping.uncut import uncut
from protocol.arrays import Bools, Floats, Records
from protocol.geometry import apply
from protocol.wireframe import Label, Wireframe

LONGER_M = 0.1
"""What a layer adds at the end of an own wall becomes a wall of its own where it is longer. What is shorter is another
view of the same corner."""
SCANS = 20.0  # scans that a received wall's likelihood stands for


class Layer(NamedTuple):
    """A received map as pieces of one scan, in the robot's own frame."""

    pieces: Records  # (k,) of PIECE
    likelihood: Floats  # (k,) of their walls
    poles: Floats  # (p, 3) x, y and width, metres


def layer_of(wireframe: Wireframe, transform: Floats, hidden: Bools, hits_per_m: float) -> Layer:
    """Walls of a received map (sender's frame) but for hidden ones (m,), whole, moved by a transform (3,)."""
    points = apply(np.asarray(transform, np.float64), wireframe.points)
    size = np.hypot(*(points[wireframe.edges[:, 1]] - points[wireframe.edges[:, 0]]).T)
    poles, pole_of = find_poles(replace(wireframe, points=points))
    poles = np.delete(poles, pole_of[hidden & (pole_of >= 0)], axis=0)
    kept = np.flatnonzero(~hidden & (size > MIN_WALL_M) & (pole_of < 0))
    edges, grown = uncut(points, wireframe.labels, wireframe.edges[kept].astype(np.int64), wireframe.own[kept])
    kept = kept[grown]
    a, b = points[edges[:, 0]], points[edges[:, 1]]
    length = np.hypot(*(b - a).T)
    out_of, into = np.full(len(points), -1), np.full(len(points), -1)
    out_of[edges[:, 0]], into[edges[:, 1]] = np.arange(len(kept)), np.arange(len(kept))
    pieces = np.zeros(len(kept), PIECE)
    pieces["hits"] = np.maximum(hits_per_m * length, 2.0)
    pieces["x"], pieces["y"] = (0.5 * (a + b)).T
    pieces["ux"], pieces["uy"] = ((b - a) / np.maximum(length, 1e-9)[:, None]).T
    pieces["spread"] = pieces["hits"] * length**2 / 12.0
    pieces["end"] = np.column_stack([-0.5 * length, 0.5 * length])
    pieces["link"] = np.column_stack([into[edges[:, 0]], out_of[edges[:, 1]]])
    labels = wireframe.labels[edges].astype(np.int64)
    labels[(labels == Label.NOMINAL) & (pieces["link"] < 0)] = Label.OCCLUSION  # its other wall is left away
    pieces["label"] = labels
    pieces["link"][labels != Label.NOMINAL] = -1
    return Layer(pieces, wireframe.likelihood[kept].astype(np.float64), poles)


def merged(own: Records, layers: Sequence[Layer], gates: Gates) -> Records:
    """Walls (n,) of the best particle that are published, with all layers laid over them in order.

    own: (m,) of EDGE. gates: wider than those of a scan, as a transform is known less well than a pose.
    """
    return _with_layers(_bare(own), layers, gates)


class Tellings:
    """The same as each peer is told it, from layers of what their senders saw themselves.

    Walls at second hand are told to nobody, and the peer's own not to it. Else two robots whose walls each has from the
    other hold them for ever. Many peers are told at once: the layers before the one that is left away are laid for all
    of them but once.
    """

    def __init__(self, own: Records, layers: Sequence[Layer], gates: Gates) -> None:
        """own: (m,) of EDGE, what own scans saw, which stays as it is for as long as this is asked."""
        self._own, self._layers, self._gates = own, layers, gates
        self._with_first: list[Records] = []  # walls with none of the layers, the first one, the first two, ...

    def without(self, layer: int | None) -> Records:
        """Walls (n,) with all layers but this one; None: with all. What the layers have added is heard."""
        first = len(self._layers) if layer is None else layer
        if not self._with_first:
            self._with_first.append(_bare(self._own))
        for more in self._layers[len(self._with_first) - 1 : first]:
            self._with_first.append(_with_layers(self._with_first[-1], [more], self._gates))
        edges = _with_layers(self._with_first[first], self._layers[first + 1 :], self._gates)
        count = len(edges)
        edges = _with_room(edges, 3 * len(self._own))
        return edges[: _cut_off_heard(edges, count, self._own)]


def _bare(own: Records) -> Records:
    """A copy of the walls (m,) of EDGE that are published, for layers to be laid over."""
    edges = own.copy()
    edges["relative"] = 0.0  # that is as seen from the robot, and a layer lies in the map
    _keep_published(edges, len(edges))
    return edges


def _with_layers(walls: Records, layers: Sequence[Layer], gates: Gates) -> Records:
    """Walls (n,) of `_bare` with more layers laid over them; those given stay as they are."""
    count = len(walls)
    edges = _with_room(walls, sum(len(layer.pieces) for layer in layers))
    for layer in layers:
        count = _lay(edges, count, layer.pieces, layer.likelihood, gates)
    return edges[:count]


def _with_room(edges: Records, more: int) -> Records:
    """A copy of edges (n,) with free records after them; numpy is slow to join records."""
    out = np.zeros(len(edges) + more, edges.dtype)
    out[: len(edges)] = edges
    return out


@kernel
def _cut_off_heard(edges: Records, count: int, own: Records) -> int:
    """Cut what layers have added to own walls (m,) off them, as walls of their own; returns the new count.

    Own walls that a layer has joined into one, or moved away, stand beside it again.
    """
    for k in range(count):  # a heard wall that an own one was joined into is no own wall
        edges[k].own = int(k < len(own) and is_published(own[k]) and edges[k].own == 1)
    for k in range(len(own)):
        was = own[k]
        if not is_published(was):
            continue
        if edges[k].kind != WALL or edges[k].own == 0 or shared_length(edges[k], was) < MIN_WALL_M:
            edges[k].own = 0
            edges[count] = was
            for side in range(2):
                edges[count].link[side] = -1
                if was.label[side] == NOMINAL:
                    edges[count].label[side] = OCCLUSION
            count += 1
            continue
        for side in range(2):
            e, end = edges[k], along(edges[k], was.tip[side, 0], was.tip[side, 1])
            if (tip_at(e, side) - end) * (1.0 if side == 1 else -1.0) <= LONGER_M:
                continue
            edges[count] = e
            heard, partner = edges[count], e.link[side]
            heard.own, heard.link[1 - side] = 0, -1
            set_end(heard, 1 - side, FRONTIER, 0.0, 0.0)
            set_tip(heard, 1 - side, end)
            if partner >= 0:
                edges[partner].link[1 - side] = count
            e.link[side] = -1
            set_end(e, side, FRONTIER, 0.0, 0.0)
            set_tip(e, side, end)
            count += 1
    return count


@kernel
def _keep_published(edges: Records, count: int) -> None:
    """Remove what own scans have hit too seldom, as layers must not lean on it."""
    for e in range(count):
        if edges[e].kind != FREE and not is_published(edges[e]):
            remove(edges, e)


@kernel
def _lay(edges: Records, count: int, pieces: Records, likelihood: Floats, gates: Gates) -> int:
    """Merge one layer into the walls; returns the new count. Walls that only the layer has get its likelihood."""
    walls = associate(edges, count, pieces, gates, np.full(len(pieces), BEST), False)
    count = merge_scan(edges, count, pieces, walls, np.full(len(pieces), ALWAYS), gates, 1.0, False)
    for k in range(len(pieces)):
        e = walls[k]
        if e >= 0 and edges[e].kind == WALL and edges[e].seen == 0.0:
            edges[e].due = SCANS
            edges[e].seen = max(PUBLISH_AFTER, likelihood[k] * (SCANS + 2.0) - 1.0)
    return count
