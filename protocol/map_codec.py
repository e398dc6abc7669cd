"""Maps as few bits: whole, or as changes to a map that the receiver has (ours; docs/formats.md).

Edges cost nothing, because a chain's vertices follow each other. Labels cost almost nothing, because corners inside
a chain are nominal and most ends are frontiers. A vertex is coded as a step from the last one in exponential-Golomb
numbers; in rectilinear buildings, successive steps are at right angles. A whole map is the changes to an empty one.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from protocol.bits import BitReader, BitWriter, bits_of, folded
from protocol.errors import ProtocolError
from protocol.grid_map import AXIS_STEPS, LEVELS, MAX_CELL_MM, GridMap, check_places, check_size, empty
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

Place = tuple[int, int]


class Orders(NamedTuple):
    """Orders of the exponential-Golomb numbers of a message; the defaults suit a change of some vertices."""

    start: int = 6
    """To the first vertex of a chain."""
    along: int = 6
    """Of a step, along a wall."""
    across: int = 0
    """Of a step, across the wall; and of a moved vertex."""


WIDTHS = Orders(4, 4, 2)
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
    known = empty(grid_map.cell_mm, grid_map.axis) if base is None else base
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
        known = empty(cell_mm, axis)
    orders = Orders(*(reader.bits(width) for width in WIDTHS)) if reader.bits(1) else Orders()
    return _Rebuilt(reader, orders, known, likelihoods).read()


class _Script:
    """The bits and numbers of a message, before the orders of its numbers are chosen."""

    def __init__(self) -> None:
        self.tokens: list[tuple[int, int, int]] = []
        """Value, size, kind. Kind -1: size is a count of bits; -2: size is an order; else: kind is a row of Orders."""

    def bits(self, value: int, count: int) -> None:
        self.tokens.append((int(value), count, -1))

    def number(self, value: int, order: int = 0) -> None:
        self.tokens.append((value, order, -2))

    def signed_of_order(self, value: int, order: int) -> None:
        self.number(folded(value), order)

    def signed(self, value: int, which: int) -> None:
        """A number whose order the message may choose: that of row `which` of Orders."""
        self.tokens.append((folded(value), 0, which))

    def data(self, head: int) -> bytes:
        """The bytes. The message's own orders follow `head` tokens, where they save more than they cost."""
        usual, own, saved = Orders(), [], -sum(WIDTHS)
        for which, width in enumerate(WIDTHS):
            values = [value for value, _, kind in self.tokens if kind == which]
            costs = [sum([bits_of(value, order) for value in values]) for order in range(1 << width)]
            own.append(costs.index(min(costs)) if values else usual[which])
            saved += costs[usual[which]] - min(costs)
        return self._write(head, Orders(*own) if saved > 0 else usual)

    def _write(self, head: int, orders: Orders) -> bytes:
        writer = BitWriter()
        for at, (value, size, kind) in enumerate(self.tokens):
            if at == head:
                writer.bits(orders != Orders(), 1)
                if orders != Orders():
                    for order, width in zip(orders, WIDTHS, strict=True):
                        writer.bits(order, width)
            if kind == -1:
                writer.bits(value, size)
            else:
                writer.number(value, size if kind == -2 else orders[kind])
        return writer.data()


START, ALONG, ACROSS = range(3)
"""Rows of Orders."""


def _write_chain(
    script: _Script, new: GridMap, base: GridMap, chain: int, runs: list[VertexRun], last: Place, likelihoods: bool
) -> Place:
    """Write one chain: whether it is a ring, its runs with their vertices, who saw its edges, their likelihoods.

    Returns the place of its last vertex.
    """
    first, end = new.bounds(chain)
    ring, changes_only = bool(new.rings[chain]), bool(len(base.cells))
    script.bits(ring, 1)
    inside = range(first, end) if ring else range(first + 1, end - 1)
    plain = not new.labels[inside.start : inside.stop].any() if len(inside) else True
    script.bits(plain, 1)
    if changes_only:
        script.number(len(runs) - 1)
    v, due = first, 0
    cells = new.cells[first:end].tolist()
    base_rows: list[int] = []
    for run in runs:
        if changes_only:
            script.bits(*_RUN_BITS[run.origin])
        script.number(run.length - 1, 0 if changes_only else 1)
        if run.origin != VertexOrigin.NEW:
            script.signed_of_order(run.row - due, 2)
            due = run.row + run.length
        for row in run.rows or [-1] * run.length:
            here = (cells[v - first][0], cells[v - first][1])
            base_rows.append(row)
            if run.origin == VertexOrigin.MOVED:
                x, y = base.cells[row].tolist()
                script.signed(here[0] - x, ACROSS)
                script.signed(here[1] - y, ACROSS)
            elif run.origin == VertexOrigin.NEW and v == first:
                script.signed(here[0] - last[0], START)
                script.signed(here[1] - last[1], START)
            elif run.origin == VertexOrigin.NEW:
                _write_step(script, here, last, _across(cells[: v - first]))
            if run.origin != VertexOrigin.COPY:
                _write_label(script, int(new.labels[v]), v in inside, plain)
            last = here
            v += 1
    edges = slice(first, end if ring else end - 1)
    _write_own(script, new.own[edges].tolist())
    if likelihoods:
        _write_levels(script, new.level[edges].tolist(), _expected_levels(base_rows, base, ring))
    return last


_RUN_BITS = {VertexOrigin.COPY: (0, 1), VertexOrigin.NEW: (2, 2), VertexOrigin.MOVED: (3, 2)}
"""Value and number of bits that tell the origin of a run."""


def _write_step(script: _Script, here: Place, last: Place, axis: int) -> None:
    step = here[0] - last[0], here[1] - last[1]
    usual = abs(step[axis]) >= abs(step[1 - axis])
    script.bits(usual, 1)
    main = axis if usual else 1 - axis
    script.signed(step[main], ALONG)
    script.signed(step[1 - main], ACROSS)


def _write_label(script: _Script, label: int, inside: bool, plain: bool) -> None:
    if inside and plain:
        return
    rank = (INSIDE if inside else AT_ENDS).index(Label(label))
    script.bits(*((0, 1), (2, 2), (3, 2))[rank])


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


def _across(before: list[list[int]]) -> int:
    """Axis along which a chain is expected to go on: across its last edge; 0 where there is none."""
    if len(before) < 2:
        return 0
    (ax, ay), (bx, by) = before[-2], before[-1]
    return 1 if abs(bx - ax) >= abs(by - ay) else 0


def _expected_levels(base_rows: list[int], base: GridMap, ring: bool) -> list[int]:
    """Level of each edge of a chain: as in the base where it is an edge there, else SURE."""
    after = base.successors()
    tips = [*base_rows[1:], base_rows[0]] if ring else base_rows[1:]
    pairs = zip(base_rows, tips, strict=False)
    return [int(base.level[a]) if a >= 0 and b >= 0 and after[a] == b else SURE for a, b in pairs]


class _Rebuilt:
    """The map that a message tells, read vertex by vertex."""

    def __init__(self, reader: BitReader, orders: Orders, base: GridMap, likelihoods: bool) -> None:
        self.reader, self.orders, self.base, self.likelihoods = reader, orders, base, likelihoods
        self.places = base.cells.tolist()
        self.used = np.zeros(len(base.cells), np.bool_)
        self.cells: list[list[int]] = []
        self.labels: list[int] = []
        self.own: list[bool] = []
        self.level: list[int] = []
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
        check_places(self.cells, base.cell_mm)
        built = GridMap(
            base.cell_mm,
            base.axis,
            np.array(self.cells, np.int32).reshape(-1, 2),
            np.array(self.labels, np.uint8),
            np.array(self.own, np.bool_),
            np.array(self.level, np.uint8),
            np.array(self.starts, np.int64),
            np.array(self.rings, np.bool_),
        )
        whole = base.of_chains(np.flatnonzero(~dropped).tolist()).joined(built)
        check_size(len(whole.cells))
        return whole

    def _chain(self, last: Place) -> Place:
        reader, base, first = self.reader, self.base, len(self.cells)
        ring, plain = bool(reader.bits(1)), bool(reader.bits(1))
        base_rows: list[int] = []
        due = 0
        for left in reversed(range(reader.number() + 1 if len(base.cells) else 1)):
            kind = VertexOrigin.NEW
            if len(base.cells):
                kind = (
                    VertexOrigin.COPY
                    if not reader.bits(1)
                    else VertexOrigin.MOVED
                    if reader.bits(1)
                    else VertexOrigin.NEW
                )
            count = reader.number(0 if len(base.cells) else 1) + 1
            check_size(len(self.cells) + count)
            row = -1
            if kind != VertexOrigin.NEW:
                row = due + reader.signed(2)
                due = row + count
                if row < 0 or due > len(base.cells) or self.used[row:due].any():
                    raise ProtocolError("changes to a map take a vertex that is not there, or twice")
                self.used[row:due] = True
            for k in range(count):
                at_end = not ring and (len(self.cells) == first or (not left and k == count - 1))
                last = self._vertex(kind, row + k, last, first)
                base_rows.append(row + k if kind != VertexOrigin.NEW else -1)
                copied = int(base.labels[row + k]) if kind == VertexOrigin.COPY else -1
                self.labels.append(copied if kind == VertexOrigin.COPY else self._label(at_end, plain))
        count = len(self.cells) - first
        if ring and count < 2:
            raise ProtocolError("a ring of a map has one vertex")
        edges = count if ring else count - 1
        none_left = [0] * (count - edges)
        self.own += self._own(edges) + [False] * len(none_left)
        self.level += self._levels(base_rows, ring, edges) + none_left
        self.starts.append(len(self.cells))
        self.rings.append(ring)
        return last

    def _vertex(self, kind: int, row: int, last: Place, first: int) -> Place:
        reader = self.reader
        if kind == VertexOrigin.COPY:
            x, y = self.places[row]
        elif kind == VertexOrigin.MOVED:
            x, y = self.places[row]
            x, y = x + self._signed(ACROSS), y + self._signed(ACROSS)
        elif len(self.cells) == first:
            x, y = last[0] + self._signed(START), last[1] + self._signed(START)
        else:
            axis = _across(self.cells[max(first, len(self.cells) - 2) :])
            main = axis if reader.bits(1) else 1 - axis
            along, across = self._signed(ALONG), self._signed(ACROSS)
            x, y = last[0] + (across if main else along), last[1] + (along if main else across)
        self.cells.append([x, y])
        return x, y

    def _signed(self, which: int) -> int:
        return self.reader.signed(self.orders[which])

    def _label(self, at_end: bool, plain: bool) -> int:
        if not at_end and plain:
            return Label.NOMINAL
        rank = 0 if not self.reader.bits(1) else 1 + self.reader.bits(1)
        return (AT_ENDS if at_end else INSIDE)[rank]

    def _own(self, edges: int) -> list[bool]:
        if not edges or self.reader.bits(1):
            return [True] * edges
        return [bool(self.reader.bits(1)) for _ in range(edges)] if self.reader.bits(1) else [False] * edges

    def _levels(self, base_rows: list[int], ring: bool, edges: int) -> list[int]:
        if not self.likelihoods:
            return [SURE] * edges
        expected = _expected_levels(base_rows, self.base, ring)
        if self.reader.bits(1):
            return expected
        return [usual if self.reader.bits(1) else self.reader.bits(3) for usual in expected]
