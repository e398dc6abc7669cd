"""Maps as few bits: whole, or as changes to a map that the receiver has (ours; docs/formats.md).

Edges cost nothing, because a chain's vertices follow each other. Labels cost almost nothing, because corners inside
a chain are nominal and most ends are frontiers. A vertex is coded as a step from the last one in exponential-Golomb
numbers; in rectilinear buildings, successive steps are at right angles. A whole map is the changes to an empty one.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from protocol.bits import BitReader, BitWriter, bits_of, folded
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
    head = len(script.tokens)
    kept, built, dropped = changes(grid_map, known)
    script.number(len(built))
    last: Place = (0, 0)
    for chain, runs in built.items():
        last = _write_chain(script, grid_map, known, chain, runs, last, likelihoods)
    if len(known.rings):
        script.number(len(dropped))
        for before, chain in zip([-1, *dropped], dropped, strict=False):
            script.number(chain - before - 1, 1)
    return Coded(script.data(head), grid_map.of_chains([*kept, *built]))


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
    return _Rebuilt(reader, orders, known, likelihoods).read()


class _Script:
    """The bits and numbers of a message, before the orders of its numbers are chosen."""

    def __init__(self) -> None:
        self.tokens: list[tuple[int, int, bool]] = []
        """A value with its count of bits; or, where the last is True, a number with its row of the orders."""

    def bits(self, value: int, count: int) -> None:
        self.tokens.append((int(value), count, False))

    def three(self, value: int) -> None:
        self.bits(*THREE[value])

    def number(self, value: int, order: int = 0) -> None:
        self.bits(value + (1 << order), bits_of(value, order))

    def offset(self, here: Place, there: Place, *which: int) -> None:
        """From one place to another, as numbers whose orders the message may choose."""
        for a, b, row in zip(here, there, which, strict=True):
            self.tokens.append((folded(b - a), row, True))

    def data(self, head: int) -> bytes:
        """The bytes. The message's own orders follow `head` tokens, where they save more than they cost."""
        own, saved = [], -sum(WIDTHS)
        for which, (width, usual) in enumerate(zip(WIDTHS, USUAL_ORDERS, strict=True)):
            values = [value for value, row, chosen in self.tokens if chosen and row == which]
            costs = [sum([bits_of(value, order) for value in values]) for order in range(1 << width)]
            own.append(costs.index(min(costs)) if values else usual)
            saved += costs[usual] - min(costs)
        orders = tuple(own) if saved > 0 else USUAL_ORDERS
        writer = BitWriter()
        for value, count, _ in self.tokens[:head]:
            writer.bits(value, count)
        writer.bits(orders != USUAL_ORDERS, 1)
        if orders != USUAL_ORDERS:
            for order, width in zip(orders, WIDTHS, strict=True):
                writer.bits(order, width)
        for value, size, chosen in self.tokens[head:]:
            if chosen:
                writer.number(value, orders[size])
            else:
                writer.bits(value, size)
        return writer.data()


def _write_chain(
    script: _Script, new: GridMap, base: GridMap, chain: int, runs: list[VertexRun], last: Place, likelihoods: bool
) -> Place:
    """Write one chain: whether it is a ring, its runs with their vertices, who saw its edges, their likelihoods.

    Returns the place of its last vertex.
    """
    rows, ring, changes_only = slice(*new.bounds(chain)), bool(new.rings[chain]), bool(len(base.cells))
    cells: list[Place] = new.cells[rows].tolist()
    labels, own, levels = new.labels[rows].tolist(), new.own[rows].tolist(), new.level[rows].tolist()
    inside = range(len(cells)) if ring else range(1, len(cells) - 1)
    plain = not any(labels[v] for v in inside)
    script.bits(ring, 1)
    script.bits(plain, 1)
    if changes_only:
        script.number(len(runs) - 1)
    due = 0
    base_rows: list[int] = []
    for run in runs:
        if changes_only:
            script.three(run.origin)
        script.number(run.length - 1, 0 if changes_only else 1)
        if run.origin != VertexOrigin.NEW:
            script.number(folded(run.row - due), 2)
            due = run.row + run.length
        for row in run.rows or [-1] * run.length:
            v = len(base_rows)
            here = cells[v]
            base_rows.append(row)
            if run.origin == VertexOrigin.MOVED:
                script.offset(base.cells[row].tolist(), here, ACROSS, ACROSS)
            elif run.origin == VertexOrigin.NEW and v == 0:
                script.offset(last, here, START, START)
            elif run.origin == VertexOrigin.NEW:
                axis = _across(cells[:v])
                usual = abs(here[axis] - last[axis]) >= abs(here[1 - axis] - last[1 - axis])
                script.bits(usual, 1)
                turn = 1 if (axis if usual else 1 - axis) == 0 else -1
                script.offset(last[::turn], here[::turn], ALONG, ACROSS)
            if run.origin != VertexOrigin.COPY and not (plain and v in inside):
                script.three((INSIDE if v in inside else AT_ENDS).index(Label(labels[v])))
            last = here
    edges = len(cells) if ring else len(cells) - 1
    _write_own(script, own[:edges])
    if likelihoods:
        _write_levels(script, levels[:edges], _expected_levels(base_rows, base, ring))
    return last


def _write_own(script: _Script, own: list[bool]) -> None:
    """Write which edges of a chain the sender saw itself: all, none, or a bit each."""
    if not own:
        return
    script.bits(*((1, 1) if all(own) else (1, 2) if any(own) else (0, 2)))
    if any(own) and not all(own):
        for one in own:
            script.bits(one, 1)


def _write_levels(script: _Script, levels: list[int], expected: list[int]) -> None:
    script.bits(levels == expected, 1)
    if levels != expected:
        for level, usual in zip(levels, expected, strict=True):
            script.bits(*((1, 1) if level == usual else (level, 4)))


def _across(before: list[Place]) -> int:
    """Axis along which a chain is expected to go on: across its last edge; 0 where there is none."""
    if len(before) < 2:
        return 0
    (ax, ay), (bx, by) = before[-2:]
    return int(abs(bx - ax) >= abs(by - ay))


def _expected_levels(base_rows: list[int], base: GridMap, ring: bool) -> list[int]:
    """Level of each edge of a chain: as in the base where it is an edge there, else SURE."""
    after = base.successors()
    tips = [*base_rows[1:], base_rows[0]] if ring else base_rows[1:]
    pairs = zip(base_rows, tips, strict=False)
    return [int(base.level[a]) if a >= 0 and b >= 0 and after[a] == b else SURE for a, b in pairs]


class _Rebuilt:
    """The map that a message tells, read vertex by vertex."""

    def __init__(self, reader: BitReader, orders: Sequence[int], base: GridMap, likelihoods: bool) -> None:
        self.reader, self.orders, self.base, self.likelihoods = reader, orders, base, likelihoods
        self.places = base.cells.tolist()
        self.used = np.zeros(len(base.cells), np.bool_)
        self.vertices: list[tuple[int, ...]] = []
        """Place, label, whether the sender saw the edge that leaves it, and its level."""
        self.starts = [0]
        self.rings: list[bool] = []

    def read(self) -> GridMap:
        """The map; raises ProtocolError."""
        reader, base = self.reader, self.base
        last: Place = (0, 0)
        for _ in range(reader.number()):
            last = self._chain(last)
        dropped = np.array([self.used[slice(*base.bounds(chain))].any() for chain in range(len(base.rings))], np.bool_)
        if len(base.rings):
            chain = -1
            for _ in range(reader.number()):
                chain += reader.number(1) + 1
                if chain >= len(dropped) or dropped[chain]:
                    raise ProtocolError("changes to a map drop a chain that is not there")
                dropped[chain] = True
        reader.finish()
        x, y, labels, own, level = np.array(self.vertices, np.int64).reshape(-1, 5).T
        cells = np.stack([x, y], 1)
        check_places(cells, base.cell_mm)
        built = GridMap(
            base.cell_mm,
            base.axis,
            cells.astype(np.int32),
            labels.astype(np.uint8),
            own.astype(np.bool_),
            level.astype(np.uint8),
            np.array(self.starts),
            np.array(self.rings, np.bool_),
        )
        whole = base.of_chains(np.flatnonzero(~dropped).tolist()).joined(built)
        check_size(len(whole.cells))
        return whole

    def _chain(self, last: Place) -> Place:
        reader, base = self.reader, self.base
        ring, plain, changes_only = bool(reader.bits(1)), bool(reader.bits(1)), bool(len(base.cells))
        cells: list[Place] = []
        labels: list[int] = []
        base_rows: list[int] = []
        due = 0
        for left in reversed(range(reader.number() + 1 if changes_only else 1)):
            origin = self._three() if changes_only else VertexOrigin.NEW
            count = reader.number(0 if changes_only else 1) + 1
            check_size(len(self.vertices) + len(cells) + count)
            rows = [-1] * count
            if origin != VertexOrigin.NEW:
                first = due + reader.signed(2)
                due = first + count
                if first < 0 or due > len(base.cells) or self.used[first:due].any():
                    raise ProtocolError("changes to a map take a vertex that is not there, or twice")
                self.used[first:due] = True
                rows = list(range(first, due))
            base_rows += rows
            for k, row in enumerate(rows):
                at_end = not ring and (not cells or (not left and k == count - 1))
                last = self._place(origin, row, last, cells)
                cells.append(last)
                if origin == VertexOrigin.COPY:
                    labels.append(int(base.labels[row]))
                else:
                    labels.append(Label.NOMINAL if plain and not at_end else (INSIDE, AT_ENDS)[at_end][self._three()])
        if ring and len(cells) < 2:
            raise ProtocolError("a ring of a map has one vertex")
        edges = len(cells) if ring else len(cells) - 1
        none = [0] * (len(cells) - edges)
        own, levels = self._own(edges) + none, self._levels(base_rows, ring, edges) + none
        for (x, y), *rest in zip(cells, labels, own, levels, strict=True):
            self.vertices.append((x, y, *rest))
        self.starts.append(len(self.vertices))
        self.rings.append(ring)
        return last

    def _place(self, origin: int, row: int, last: Place, before: list[Place]) -> Place:
        if origin == VertexOrigin.NEW and before:
            axis = _across(before)
            main = axis if self.reader.bits(1) else 1 - axis
            along, across = self._signed(ALONG), self._signed(ACROSS)
            return last[0] + (across if main else along), last[1] + (along if main else across)
        near = last if origin == VertexOrigin.NEW else self.places[row]
        if origin == VertexOrigin.COPY:
            return near
        which = ACROSS if origin == VertexOrigin.MOVED else START
        return near[0] + self._signed(which), near[1] + self._signed(which)

    def _signed(self, which: int) -> int:
        return self.reader.signed(self.orders[which])

    def _three(self) -> int:
        return 1 + self.reader.bits(1) if self.reader.bits(1) else 0

    def _own(self, edges: int) -> list[int]:
        if not edges or self.reader.bits(1):
            return [1] * edges
        return [self.reader.bits(1) for _ in range(edges)] if self.reader.bits(1) else [0] * edges

    def _levels(self, base_rows: list[int], ring: bool, edges: int) -> list[int]:
        if not self.likelihoods:
            return [SURE] * edges
        expected = _expected_levels(base_rows, self.base, ring)
        if self.reader.bits(1):
            return expected
        return [usual if self.reader.bits(1) else self.reader.bits(3) for usual in expected]
