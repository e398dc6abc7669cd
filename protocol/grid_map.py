"""A wireframe on a grid along its own walls: the form that the radio carries, equal on both sides to the bit.

Walls of a building are mostly rectilinear, so the grid is turned to the map's main axis. Along a wall one of the two
coordinates hardly changes then, and small numbers take few bits (protocol.map_codec).
"""

import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Bools, Floats, Ints, Labels
from protocol.errors import ProtocolError
from protocol.walls import main_direction, neighbours, repeated
from protocol.wireframe import Wireframe

AXIS_STEPS = 4096
"""Steps of a right angle, 0.02 degrees each: over 10 m, a wall leaves its row of cells by less than half a cell."""
MAX_CELL_MM = 1000
"""Largest cell; a coarser grid shows no building (ours)."""
MAX_TOLD = 3000  # vertices of a map on the radio (ours): 8 kB of a cluttered building. Reading it takes 32 ms
MAX_REACH_M = 4000.0
"""Farthest vertex of a map on the radio from where its owner began (ours): four times what a world file may hold.
Two such vertices are at most 8 km apart, so a map that is turned and laid over another one stays within the bounds of a
wireframe."""
LEVELS = 8
"""Steps of an edge's likelihood: 3 bits."""


PairCost = Callable[[Ints, Ints], Floats]

VERTEX_ARRAYS = ("cells", "labels", "own", "level")
"""Fields of GridMap with a row for each vertex."""


@dataclass(frozen=True, eq=False)
class GridMap:
    """Chains of vertices, one after the other; an edge leads from each vertex to the next of its chain.

    Vertex arrays have n rows, chain arrays c. `own` and `level` belong to the edge that leaves a vertex and are
    False and 0 where none does. Without arrays, it is an empty map.
    """

    cell_mm: int
    axis: int
    """Direction of the grid in the owner's frame, steps of 1 / AXIS_STEPS of a right angle."""
    cells: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 2), np.int32))
    """(n, 2) places, cells along the axis and across."""
    labels: Labels = field(default_factory=lambda: np.zeros(0, np.uint8))
    """(n,) of Label."""
    own: Bools = field(default_factory=lambda: np.zeros(0, np.bool_))
    """(n,) whether the owner saw the edge itself."""
    level: Labels = field(default_factory=lambda: np.zeros(0, np.uint8))
    """(n,) the edge's likelihood, 0 to LEVELS - 1."""
    starts: Ints = field(default_factory=lambda: np.zeros(1, np.int64))
    """(c + 1,) first vertex of each chain, and n."""
    rings: Bools = field(default_factory=lambda: np.zeros(0, np.bool_))
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

    def rows(self, chains: Sequence[int]) -> Ints:
        """The vertices of these chains, in this order."""
        return np.concatenate([np.zeros(0, np.int64), *(np.arange(*self.bounds(chain)) for chain in chains)])

    def of_chains(self, chains: Sequence[int]) -> "GridMap":
        """The map of these chains, in this order."""
        rows, which = self.rows(chains), np.array(chains, np.int64)
        starts = np.concatenate([[0], np.cumsum(np.diff(self.starts)[which])])
        vertices: dict[str, Any] = {name: getattr(self, name)[rows] for name in VERTEX_ARRAYS}
        return replace(self, **vertices, starts=starts, rings=self.rings[which])

    def joined(self, other: "GridMap") -> "GridMap":
        """The chains of both, of one grid, this map's first."""
        pairs = {name: (getattr(self, name), getattr(other, name)) for name in (*VERTEX_ARRAYS, "rings")}
        both: dict[str, Any] = {name: np.concatenate(pair) for name, pair in pairs.items()}
        return replace(self, **both, starts=np.concatenate([self.starts, other.starts[1:] + self.starts[-1]]))

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
        for name in (*VERTEX_ARRAYS, "starts", "rings"):
            total = zlib.crc32(getattr(self, name).astype("<i4").tobytes(), total)
        return total & 0xFFFF

    @cached_property
    def keys(self) -> list[bytes]:
        """Of each chain everything that makes it, to find an equal one in another map of the same grid."""
        vertices = np.column_stack([getattr(self, name) for name in VERTEX_ARRAYS]).astype("<i4")
        parts = [vertices[slice(*self.bounds(chain))].tobytes() for chain in range(len(self.rings))]
        return [part + ring.tobytes() for part, ring in zip(parts, self.rings, strict=True)]

    def alike(self, other: "GridMap") -> bool:
        """Whether both hold the same chains on the same grid, in whatever order."""
        mine, theirs = sorted(self.keys), sorted(other.keys)
        return (self.cell_mm, self.axis, mine) == (other.cell_mm, other.axis, theirs)


def main_axis(wireframe: Wireframe) -> int:
    """The main direction of a map's walls in steps of GridMap.axis; 0 without walls."""
    return round(4 * main_direction(wireframe.segments()) / (2 * math.pi) * AXIS_STEPS) % AXIS_STEPS


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
    n, (tails, tips) = len(cells), wireframe.edges.T
    match = np.full(n, -1)
    if base is not None and slack > 0:
        match = matched(places, base.cells, slack)
        cells[match >= 0] = base.cells[match[match >= 0]]
    _, after = neighbours(wireframe.edges, n)
    own, level = np.zeros(n, np.bool_), np.zeros(n, np.uint8)
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


def matched(mine: Floats, theirs: NDArray[Any], most: float, more: PairCost | None = None) -> Ints:
    """(n,) the row of `theirs` (m, 2) that each of `mine` (n, 2) is matched with, greedily, the nearest first.

    Two are at most `most` apart. more: what counts beside their distance, for (k,) rows of both. -1: without one.
    """
    order = np.argsort(theirs[:, 0], kind="stable")
    across = theirs[order, 0]
    low, high = (np.searchsorted(across, mine[:, 0] + reach) for reach in (-most - 1e-6, most + 1e-6))
    rows, nth = repeated(high - low)  # only pairs that are near along one axis, as maps of peers may be large
    columns = order[low[rows] + nth]
    beside = np.abs(mine[rows, 1] - theirs[columns, 1]) <= most
    rows, columns = rows[beside], columns[beside]
    away = np.hypot(*(mine[rows] - theirs[columns]).T)
    if more is not None:
        away += more(rows, columns)
    near = away <= most
    rows, columns, away = rows[near], columns[near], away[near]
    order = np.lexsort((columns, rows, away))
    rows, columns = rows[order], columns[order]
    match, taken = np.full(len(mine), -1), np.zeros(len(theirs), np.bool_)
    first_of_row, first_of_column = np.empty(len(mine), np.int64), np.empty(len(theirs), np.int64)
    while len(rows):  # what is each other's nearest of those left is what one pair after the other would come to
        pairs = np.arange(len(rows))
        first_of_row[rows[::-1]] = first_of_column[columns[::-1]] = pairs[::-1]
        mutual = (first_of_row[rows] == pairs) & (first_of_column[columns] == pairs)
        match[rows[mutual]] = columns[mutual]
        taken[columns[mutual]] = True
        left = (match[rows] < 0) & ~taken[columns]
        rows, columns = rows[left], columns[left]
    return match


def _in_chains(cells: NDArray[np.int32], after: Ints) -> tuple[Ints, Ints, Bools]:
    """Vertices chain by chain, (n,) rows; where chains begin, (c + 1,); which are rings, (c,).

    A ring begins at its least vertex, so that a ring is the same however its owner stored it.
    """
    followers = after.tolist()
    heads = np.setdiff1d(np.arange(len(after)), after).tolist()  # of open chains
    order: dict[int, None] = {}
    starts, rings = [0], []
    for v in [*heads, *np.lexsort((cells[:, 1], cells[:, 0])).tolist()]:
        if v in order:
            continue
        while v >= 0 and v not in order:
            order[v] = None
            v = followers[v]
        starts.append(len(order))
        rings.append(v >= 0)
    return np.array([*order], np.int64), np.array(starts, np.int64), np.array(rings, np.bool_)


def check_size(n: int) -> None:
    """Raise ProtocolError for more vertices than a map on the radio may have."""
    if n > MAX_TOLD:
        raise ProtocolError(f"a map of more than {MAX_TOLD} vertices")


def check_places(cells: NDArray[np.signedinteger[Any]], cell_mm: int) -> None:
    """Raise ProtocolError for places, (n, 2) cells, farther out than MAX_REACH_M, whatever the grid's axis."""
    if np.hypot(*cells.T.astype(np.float64)).max(initial=0) * cell_mm > 1000 * MAX_REACH_M:
        raise ProtocolError("a vertex of a map is out of bounds")
