"""A wireframe on a grid along its own walls: the form that the radio carries, equal on both sides to the bit.

Walls of a building are mostly rectilinear, so the grid is turned to the map's main axis. Along a wall one of the two
coordinates hardly changes then, and small numbers take few bits (protocol.map_codec).
"""

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Bools, Floats, Ints, Labels
from protocol.errors import ProtocolError
from protocol.wireframe import MAX_COORDINATE_M, MAX_VERTICES, Wireframe

AXIS_STEPS = 4096
"""Steps of a right angle, 0.02 degrees each: over 10 m, a wall leaves its row of cells by less than half a cell."""

MAX_CELL_MM = 1000
"""Largest cell; a coarser grid shows no building (ours)."""

LEVELS = 8
"""Steps of an edge's likelihood: 3 bits."""


@dataclass(frozen=True, eq=False)
class GridMap:
    """Chains of vertices, one after the other; an edge leads from each vertex to the next of its chain.

    Vertex arrays have n rows, chain arrays c. `own` and `level` belong to the edge that leaves a vertex and are
    False and 0 where none does.
    """

    cell_mm: int
    axis: int
    """Direction of the grid in the owner's frame, steps of 1 / AXIS_STEPS of a right angle."""
    cells: NDArray[np.int32]
    """(n, 2) places, cells along the axis and across."""
    labels: Labels
    """(n,) of Label."""
    own: Bools
    """(n,) whether the owner saw the edge itself."""
    level: Labels
    """(n,) the edge's likelihood, 0 to LEVELS - 1."""
    starts: Ints
    """(c + 1,) first vertex of each chain, and n."""
    rings: Bools
    """(c,) whether a further edge leads from the last vertex of the chain to its first."""

    def __eq__(self, other: object) -> bool:
        """Equal bit by bit, in the same order."""
        return isinstance(other, GridMap) and all(
            np.array_equal(getattr(self, field.name), getattr(other, field.name)) for field in fields(GridMap)
        )

    __hash__ = None  # type: ignore[assignment]

    def bounds(self, chain: int) -> tuple[int, int]:
        """First vertex of a chain, and the one after its last."""
        return int(self.starts[chain]), int(self.starts[chain + 1])

    def of_chains(self, chains: Sequence[int]) -> "GridMap":
        """The map of these chains, in this order."""
        parts = [np.arange(*self.bounds(chain)) for chain in chains]
        rows = np.concatenate(parts) if parts else np.zeros(0, np.int64)
        return GridMap(
            self.cell_mm,
            self.axis,
            self.cells[rows],
            self.labels[rows],
            self.own[rows],
            self.level[rows],
            np.cumsum([0, *map(len, parts)]),
            self.rings[np.array(chains, np.int64)],
        )

    def joined(self, other: "GridMap") -> "GridMap":
        """The chains of both, of one grid, this map's first."""
        return GridMap(
            self.cell_mm,
            self.axis,
            np.concatenate([self.cells, other.cells]),
            np.concatenate([self.labels, other.labels]),
            np.concatenate([self.own, other.own]),
            np.concatenate([self.level, other.level]),
            np.concatenate([self.starts, other.starts[1:] + self.starts[-1]]),
            np.concatenate([self.rings, other.rings]),
        )

    def successors(self) -> Ints:
        """(n,) the vertex that each one's edge leads to, -1 for none."""
        after = np.arange(1, len(self.cells) + 1)
        last = self.starts[1:] - 1
        after[last] = np.where(self.rings, self.starts[:-1], -1)
        return after

    def wireframe(self) -> Wireframe:
        """The same in metres, in the owner's frame; vertices keep their order."""
        after = self.successors()
        tails = np.flatnonzero(after >= 0)
        return Wireframe(
            self.cells @ _turn(self.axis).T * (self.cell_mm / 1000),
            self.labels,
            np.stack([tails, after[tails]], 1).astype(np.int32),
            (self.level[tails] / (LEVELS - 1)).astype(np.float32),
            self.own[tails],
        )

    def digest(self) -> int:
        """16 bits by which two robots know that they hold the same map."""
        total = zlib.crc32(f"{self.cell_mm} {self.axis}".encode())
        for array in (self.cells, self.labels, self.own, self.level, self.starts, self.rings):
            total = zlib.crc32(array.astype("<i4").tobytes(), total)
        return total & 0xFFFF

    def key(self, chain: int) -> bytes:
        """Everything that makes a chain, to find an equal one in another map of the same grid."""
        part = slice(self.starts[chain], self.starts[chain + 1])
        arrays = (self.cells[part], self.labels[part], self.own[part], self.level[part], self.rings[chain])
        return b"".join(np.asarray(array, "<i4").tobytes() for array in arrays)

    def alike(self, other: "GridMap") -> bool:
        """Whether both hold the same chains on the same grid, in whatever order."""
        if (self.cell_mm, self.axis, len(self.rings)) != (other.cell_mm, other.axis, len(other.rings)):
            return False
        count = range(len(self.rings))
        return sorted(map(self.key, count)) == sorted(map(other.key, count))


def empty(cell_mm: int, axis: int) -> GridMap:
    """A map without vertices."""
    n = np.zeros(0, np.int64)
    none = np.zeros(0, np.bool_)
    return GridMap(
        cell_mm, axis, np.zeros((0, 2), np.int32), n.astype(np.uint8), none, n.astype(np.uint8), np.zeros(1, int), none
    )


def main_axis(wireframe: Wireframe) -> int:
    """Direction that most wall length keeps to, modulo a right angle, in steps of GridMap.axis; 0 without walls."""
    along = wireframe.points[wireframe.edges[:, 1]] - wireframe.points[wireframe.edges[:, 0]]
    length = np.hypot(along[:, 0], along[:, 1])
    turned = length @ np.exp(4j * np.arctan2(along[:, 1], along[:, 0])) if len(along) else 0j
    return round(float(np.angle(turned)) / (2 * math.pi) * AXIS_STEPS) % AXIS_STEPS


def quantise(
    wireframe: Wireframe, cell_mm: int, axis: int, base: GridMap | None = None, slack: float = 0.0, level_slack: int = 0
) -> GridMap:
    """The wireframe on a grid of cells of cell_mm, turned by axis (see GridMap).

    base: the map of the same grid that was sent before. A corner within `slack` cells of one of its corners stays
    where it was, and an edge between two such corners keeps its likelihood within `level_slack` levels, so that noise
    is not sent as a change. Raises ProtocolError for an invalid wireframe.
    """
    wireframe.check()
    places = wireframe.points @ _turn(axis) / (cell_mm / 1000)
    cells = np.rint(places).astype(np.int32)
    match = _matches(places, base.cells, slack) if base is not None and slack > 0 else np.full(len(places), -1)
    if base is not None:
        cells[match >= 0] = base.cells[match[match >= 0]]
    n = len(cells)
    after = np.full(n, -1)
    own, level = np.zeros(n, np.bool_), np.zeros(n, np.uint8)
    tails, tips = wireframe.edges.T
    after[tails] = tips
    own[tails] = wireframe.own
    level[tails] = np.rint(wireframe.likelihood * (LEVELS - 1))
    if base is not None and len(tails):
        said = match[tails]
        kept = (said >= 0) & (match[tips] >= 0) & (base.successors()[said] == match[tips])
        kept &= np.abs(base.level[said].astype(int) - level[tails]) <= level_slack
        level[tails[kept]] = base.level[said[kept]]
    order, starts, rings = _in_chains(cells, after)
    return GridMap(cell_mm, axis, cells[order], wireframe.labels[order], own[order], level[order], starts, rings)


def _turn(axis: int) -> Floats:
    """(2, 2) whose columns are the grid's axes in the owner's frame."""
    angle = axis / AXIS_STEPS * (math.pi / 2)
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def _matches(places: Floats, cells: NDArray[np.int32], slack: float) -> Ints:
    """(n,) row of `cells` within `slack` of each place, or -1. Pairs are matched greedily, the nearest first."""
    match = np.full(len(places), -1)
    away = np.hypot(*(places[:, None] - cells[None]).transpose(2, 0, 1))
    mine, theirs = np.nonzero(away <= slack)
    taken = np.zeros(len(cells), np.bool_)
    for k in np.argsort(away[mine, theirs], kind="stable").tolist():
        if match[mine[k]] < 0 and not taken[theirs[k]]:
            match[mine[k]] = theirs[k]
            taken[theirs[k]] = True
    return match


def _in_chains(cells: NDArray[np.int32], after: Ints) -> tuple[Ints, Ints, Bools]:
    """Vertices chain by chain, (n,) rows; where chains begin, (c + 1,); which are rings, (c,).

    A ring begins at its least vertex, so that a ring is the same however its owner stored it.
    """
    followers = after.tolist()
    has_before = np.zeros(len(after), np.bool_)
    has_before[after[after >= 0]] = True
    rank = np.empty(len(after), np.int64)
    rank[np.lexsort((cells[:, 1], cells[:, 0]))] = np.arange(len(after))
    heads = [*np.flatnonzero(~has_before).tolist(), *np.argsort(rank).tolist()]  # open chains, then what is left
    seen = [False] * len(followers)
    order: list[int] = []
    starts, rings = [0], []
    for head in heads:
        if seen[head]:
            continue
        v = head
        while v >= 0 and not seen[v]:
            seen[v] = True
            order.append(v)
            v = followers[v]
        starts.append(len(order))
        rings.append(v >= 0)
    return np.array(order, np.int64), np.array(starts, np.int64), np.array(rings, np.bool_)


def check_size(n: int) -> None:
    """Raise ProtocolError for more vertices than any map has."""
    if n > MAX_VERTICES:
        raise ProtocolError(f"a map of more than {MAX_VERTICES} vertices")


def check_places(cells: NDArray[np.int32] | Sequence[Sequence[int]], cell_mm: int) -> None:
    """Raise ProtocolError for places, (n, 2) cells, farther out than any robot drives."""
    if len(cells) and np.abs(np.asarray(cells, np.int64)).max() * cell_mm > 1000 * MAX_COORDINATE_M:
        raise ProtocolError("a vertex of a map is out of bounds")
