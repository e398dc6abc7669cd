"""Maps as few bits: whole, or as changes to a map that the receiver has (ours; docs/protocol.md).

Edges cost nothing, because a chain's vertices follow each other. Labels cost almost nothing, because corners inside
a chain are nominal and most ends are frontiers. A vertex is coded as a step from the last one in exponential-Golomb
numbers; in rectilinear buildings, successive steps are at right angles. A whole map is the changes to an empty one.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from protocol.bits import BitReader, bits_of, bits_of_each, folded, packed
from protocol.errors import ProtocolError
from protocol.grid_map import AXIS_STEPS, LEVELS, MAX_CELL_MM, GridMap, check_places, check_size
from protocol.map_changes import VertexOrigin, VertexRun, changes
from protocol.wireframe import Label

VERSION = 1
USUAL_CELL_MM = 10
"""Cells of other sizes cost 10 bits more."""

INSIDE = (Label.NOMINAL, Label.OCCLUSION, Label.FRONTIER)
AT_ENDS = (Label.FRONTIER, Label.OCCLUSION, Label.NOMINAL)
"""Labels inside and at the ends of a chain, the most frequent first."""
SURE = LEVELS - 1
"""Likelihood level of an edge unless told otherwise."""
THREE = ((0, 1), (2, 2), (3, 2))
"""Value and number of bits that tell one of three, the most frequent first."""

Place = Sequence[int]
"""Cells along and across."""

START, ALONG, ACROSS = range(3)
"""Numbers of like size: to the first vertex of a chain; of a step along a wall; of a step across it, or of a moved
vertex."""
USUAL_ORDERS = (6, 6, 0)
"""Orders of their exponential-Golomb codes, which suit a change of some vertices."""
WIDTHS = (4, 4, 2)
"""Bits of each order in a message that brings its own orders."""
CHOSEN = len(WIDTHS)


class Coded(NamedTuple):
    """A message, and the map that its receiver will have: the same chains, in the order of the message."""

    data: bytes
    map: GridMap


def encode_map(grid_map: GridMap, base: GridMap | None = None, *, likelihoods: bool = True) -> Coded:
    """Bytes of a map, or of the changes to `base`, a map on the same grid.

    likelihoods: whether edge likelihoods come along, one to four bits each; without, all are told as 1.
    Raises ProtocolError for a map that is too large or of another grid than its base.
    """
    check_size(len(grid_map.cells))
    check_places(grid_map.cells, grid_map.cell_mm)
    known = base or GridMap(grid_map.cell_mm, grid_map.axis)
    if (grid_map.cell_mm, grid_map.axis) != (known.cell_mm, known.axis):
        raise ProtocolError("a map can be told as changes only on the grid of its base")
    if not likelihoods:
        grid_map = replace(grid_map, level=np.where(grid_map.successors() >= 0, SURE, 0).astype(np.uint8))
    script = _Script()
    script.bits(VERSION, 4)
    script.bits(base is not None, 1)
    script.bits(likelihoods, 1)
    if base is not None:
        script.bits(base.digest(), 16)
    else:
        script.bits(grid_map.axis, AXIS_STEPS.bit_length() - 1)
        script.bits(grid_map.cell_mm != USUAL_CELL_MM, 1)
        if grid_map.cell_mm != USUAL_CELL_MM:
            script.bits(grid_map.cell_mm, MAX_CELL_MM.bit_length())
    head = len(script.values)
    built, dropped = changes(grid_map, known)
    told = [_told(grid_map, chain, runs) for chain, runs in built.items()]
    there = _Walk(script, known, likelihoods).map(told, dropped)
    return Coded(script.data(head), there)


def decode_map(data: bytes, base: GridMap | None = None) -> GridMap:
    """Map of the bytes that `encode_map` made with the same base.

    Raises ProtocolError for anything else, and for changes to another map than `base`.
    """
    reader = BitReader(data)
    version = reader.bits(4)
    if version != VERSION:
        raise ProtocolError(f"a map of version {version}; this program reads version {VERSION}")
    of_base, likelihoods = reader.bits(1), bool(reader.bits(1))
    if of_base:
        if base is None or reader.bits(16) != base.digest():
            raise ProtocolError("changes to a map that is not here")
        known = base
    else:
        axis = reader.bits(AXIS_STEPS.bit_length() - 1)
        cell_mm = reader.bits(MAX_CELL_MM.bit_length()) if reader.bits(1) else USUAL_CELL_MM
        if not 1 <= cell_mm <= MAX_CELL_MM:
            raise ProtocolError(f"cells of a map are 1 to {MAX_CELL_MM} mm, not {cell_mm}")
        known = GridMap(cell_mm, axis)
    orders = tuple(reader.bits(width) for width in WIDTHS) if reader.bits(1) else USUAL_ORDERS
    found = _Walk(_Reader(reader, orders), known, likelihoods).map()
    reader.finish()
    return found


def _told(new: GridMap, chain: int, runs: list[VertexRun]) -> "_Told":
    first, end = new.bounds(chain)
    vertices, edges = slice(first, end), slice(first, end if new.rings[chain] else end - 1)
    cells, labels = new.cells[vertices].tolist(), new.labels[vertices].tolist()
    return _Told(bool(new.rings[chain]), runs, cells, labels, new.own[edges].tolist(), new.level[edges].tolist())


class _Script:
    """The bits and numbers of a message, before the orders of its numbers are chosen. Returns what it is told."""

    def __init__(self) -> None:
        self.values: list[int] = []
        self.sizes: list[int] = []
        """Of each value its count of bits; or, where an order is to be chosen, its row of them less `CHOSEN`."""

    def bits(self, value: int, count: int) -> int:
        self.values.append(value)
        self.sizes.append(count)
        return value

    def three(self, value: int) -> int:
        self.bits(*THREE[value])
        return value

    def number(self, value: int, order: int = 0) -> int:
        self.bits(value + (1 << order), bits_of(value, order))
        return value

    def signed(self, value: int, order: int) -> int:
        self.number(folded(value), order)
        return value

    def chosen(self, value: int, which: int) -> int:
        """A number of any sign whose order the message may choose: that of row `which` of the orders."""
        self.bits(folded(value), which - CHOSEN)
        return value

    def data(self, head: int) -> bytes:
        """The bytes. The message's own orders follow `head` values, where they save more than they cost."""
        values, sizes = np.array(self.values, np.int64), np.array(self.sizes, np.int64)
        numbers = [sizes == which - CHOSEN for which in range(CHOSEN)]
        own, saved = [], -sum(WIDTHS)
        for width, usual, these in zip(WIDTHS, USUAL_ORDERS, numbers, strict=True):
            costs = bits_of_each(values[these][:, None], np.arange(1 << width)).sum(0).tolist()
            own.append(costs.index(min(costs)) if these.any() else usual)
            saved += costs[usual] - min(costs)
        orders = tuple(own) if saved > 0 else USUAL_ORDERS
        for order, these in zip(orders, numbers, strict=True):
            sizes[these] = bits_of_each(values[these], order)
            values[these] += 1 << order
        told, widths = ([0], [1]) if orders == USUAL_ORDERS else ([1, *orders], [1, *WIDTHS])
        return packed(np.insert(values, head, told), np.insert(sizes, head, widths))


class _Reader:
    """The counterpart of _Script: returns what a message says, whatever value it is told."""

    def __init__(self, reader: BitReader, orders: Sequence[int]) -> None:
        self._reader, self._orders = reader, orders

    def bits(self, value: int, count: int) -> int:
        return self._reader.bits(count)

    def three(self, value: int) -> int:
        return 1 + self._reader.bits(1) if self._reader.bits(1) else 0

    def number(self, value: int, order: int = 0) -> int:
        return self._reader.number(order)

    def signed(self, value: int, order: int) -> int:
        return self._reader.signed(order)

    def chosen(self, value: int, which: int) -> int:
        return self._reader.signed(self._orders[which])


class _Told(NamedTuple):
    """One chain that is to be written; a blank one where it is read."""

    ring: bool = False
    runs: Sequence[VertexRun] = ()
    cells: Sequence[Place] = ()
    labels: Sequence[int] = ()
    own: Sequence[int] = ()
    levels: Sequence[int] = ()
    """Of its edges, as `own`."""


class _Walk:
    """One walk through a message, which writes a map, or reads one; so there is one description of the format.

    What is read may be hostile: every number is checked before it is used.
    """

    def __init__(self, coder: _Script | _Reader, base: GridMap, likelihoods: bool) -> None:
        self.coder, self.base, self.likelihoods = coder, base, likelihoods
        self.after = base.successors()
        self.changes_only = bool(len(base.cells))
        self.used = np.zeros(len(base.cells), np.bool_)
        self.vertices: list[tuple[int, ...]] = []
        """Place, label, whether the sender saw the edge that leaves it, and its level."""
        self.starts = [0]
        self.rings: list[bool] = []

    def map(self, told: Sequence[_Told] = (), gone: Sequence[int] = ()) -> GridMap:
        """The map that the receiver has, from the chains that are built and those of the base that are dropped.

        Raises ProtocolError.
        """
        coder, base = self.coder, self.base
        last: Place = (0, 0)
        for k in range(coder.number(len(told))):
            last = self._chain(told[k] if told else _Told(), last)
        dropped = np.zeros(0, np.bool_)  # chains from which a vertex is taken, too
        if len(base.rings):
            dropped = np.logical_or.reduceat(self.used, base.starts[:-1])
            chain = -1
            for k in range(coder.number(len(gone))):
                chain += coder.number(gone[k] - chain - 1 if gone else 0, 1) + 1
                if chain >= len(dropped) or dropped[chain]:
                    raise ProtocolError("changes to a map drop a chain that is not there")
                dropped[chain] = True
        x, y, labels, own, level = np.array(self.vertices, np.int64).reshape(-1, 5).T
        cells = np.stack([x, y], 1)
        check_places(cells, base.cell_mm)
        vertices = cells.astype(np.int32), labels.astype(np.uint8), own.astype(np.bool_), level.astype(np.uint8)
        chains = np.array(self.starts), np.array(self.rings, np.bool_)
        built = GridMap(base.cell_mm, base.axis, *vertices, *chains)
        whole = base.of_chains(np.flatnonzero(~dropped).tolist()).joined(built)
        check_size(len(whole.cells))
        return whole

    def _chain(self, told: _Told, last: Place) -> Place:
        """A chain: whether it is a ring, its runs with their vertices, who saw its edges, their likelihoods.

        last: place of the vertex before it. Returns the place of its last vertex.
        """
        coder, base = self.coder, self.base
        ring = bool(coder.bits(told.ring, 1))
        plain = coder.bits(not any(told.labels if ring else told.labels[1:-1]), 1)
        cells: list[Place] = []
        labels: list[int] = []
        base_rows: list[int] = []
        due = 0
        for left in reversed(range(coder.number(len(told.runs) - 1) + 1 if self.changes_only else 1)):
            run = told.runs[-1 - left] if told.runs else VertexRun(VertexOrigin.NEW, 1, 0)
            origin = coder.three(run.origin) if self.changes_only else VertexOrigin.NEW
            count = coder.number(run.length - 1, 0 if self.changes_only else 1) + 1
            check_size(len(self.vertices) + len(cells) + count)
            rows, were = [-1] * count, [last] * count
            if origin != VertexOrigin.NEW:
                first = due + coder.signed(run.row - due, 2)
                due = first + count
                if first < 0 or due > len(base.cells) or self.used[first:due].any():
                    raise ProtocolError("changes to a map take a vertex that is not there, or twice")
                self.used[first:due] = True
                rows, were = list(range(first, due)), base.cells[first:due].tolist()
            base_rows += rows
            for k, (row, was) in enumerate(zip(rows, were, strict=True)):
                at_end = not ring and (not cells or (not left and k == count - 1))
                here, label = (told.cells[len(cells)], told.labels[len(cells)]) if told.cells else (last, 0)
                last = self._place(origin, was, last, cells, here)
                cells.append(last)
                if origin == VertexOrigin.COPY:
                    labels.append(int(base.labels[row]))
                elif plain and not at_end:
                    labels.append(Label.NOMINAL)
                else:
                    ranks = AT_ENDS if at_end else INSIDE
                    labels.append(ranks[coder.three(ranks.index(Label(label)))])
        if ring and len(cells) < 2:
            raise ProtocolError("a ring of a map has one vertex")
        edges = len(cells) if ring else len(cells) - 1
        none = [0] * (len(cells) - edges)
        own, levels = self._own(told.own, edges), self._levels(told.levels, base_rows, edges)
        for (x, y), *rest in zip(cells, labels, own + none, levels + none, strict=True):
            self.vertices.append((x, y, *rest))
        self.starts.append(len(self.vertices))
        self.rings.append(ring)
        return last

    def _place(self, origin: int, was: Place, last: Place, before: list[Place], here: Place) -> Place:
        """Place of a vertex: where it was in the base, or a step from there or from the last vertex.

        before: the chain's vertices so far. here: the place that is told.
        """
        coder = self.coder
        if origin == VertexOrigin.COPY:
            return was
        if origin == VertexOrigin.NEW and before:
            step, axis = (here[0] - last[0], here[1] - last[1]), _across(before)
            main = axis if coder.bits(abs(step[axis]) >= abs(step[1 - axis]), 1) else 1 - axis
            along, across = coder.chosen(step[main], ALONG), coder.chosen(step[1 - main], ACROSS)
            return last[0] + (across if main else along), last[1] + (along if main else across)
        near, which = (last, START) if origin == VertexOrigin.NEW else (was, ACROSS)
        return near[0] + coder.chosen(here[0] - near[0], which), near[1] + coder.chosen(here[1] - near[1], which)

    def _own(self, told: Sequence[int], edges: int) -> list[int]:
        """Which edges of a chain the sender saw itself: all, none, or a bit each."""
        if not edges or self.coder.bits(all(told), 1):
            return [1] * edges
        some = self.coder.bits(any(told), 1)
        return [self.coder.bits(one, 1) for one in told or [0] * edges] if some else [0] * edges

    def _levels(self, told: Sequence[int], base_rows: list[int], edges: int) -> list[int]:
        """Levels of the edges of a chain. Expected is that of the base where it has the edge, else SURE."""
        if not self.likelihoods:
            return [SURE] * edges
        pairs = list(pairwise([*base_rows, base_rows[0]]))[:edges]
        in_base = [a >= 0 and b >= 0 and self.after[a] == b for a, b in pairs]
        usual = [int(self.base.level[a]) if same else SURE for (a, _), same in zip(pairs, in_base, strict=True)]
        bits = self.coder.bits
        if bits(told == usual, 1):
            return usual
        return [
            level if bits(new == level, 1) else bits(new, 3) for new, level in zip(told or usual, usual, strict=True)
        ]


def _across(before: list[Place]) -> int:
    """Axis along which a chain is expected to go on: across its last edge; 0 where there is none."""
    if len(before) < 2:
        return 0
    (ax, ay), (bx, by) = before[-2:]
    return int(abs(bx - ax) >= abs(by - ay))
