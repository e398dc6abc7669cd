"""Maps as few bits: whole, or as what changed since a map that the receiver has (ours; docs/formats.md).

Edges cost nothing, because a chain's vertices follow each other, and labels next to nothing, because corners within
a chain are nominal and most ends are frontiers. Each vertex is a step from the last one, across its direction as
walls go, in exponential-Golomb numbers. A whole map is the changes to an empty one.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from protocol.arrays import Ints
from protocol.bits import BitReader, BitWriter
from protocol.errors import ProtocolError
from protocol.grid_map import AXIS_STEPS, LEVELS, MAX_CELL_MM, GridMap, check_places, check_size, empty
from protocol.wireframe import Label

VERSION = 1
USUAL_CELL_MM = 10
NEAR_CELLS = 64.0
"""A vertex this near to one of the base is told as that one moved; beyond, a new one costs no more bits."""

COPY, NEW, MOVED = 0, 1, 2
INSIDE = (Label.NOMINAL, Label.OCCLUSION, Label.FRONTIER)
AT_ENDS = (Label.FRONTIER, Label.OCCLUSION, Label.NOMINAL)
"""Labels, the usual first."""
SURE = LEVELS - 1
"""Level of an edge of which nothing better is known."""

Place = tuple[int, int]
Run = tuple[int, int, int]
"""COPY, NEW or MOVED; how many vertices; the first one's row in the base, -1 for NEW."""


class Orders(NamedTuple):
    """Orders of the exponential-Golomb numbers of a message; the defaults suit a change of some vertices."""

    start: int = 6
    """To the first vertex of a chain."""
    along: int = 6
    """Along a wall."""
    across: int = 0
    """What is left across it."""


WIDTHS = Orders(4, 4, 2)
"""Bits that tell each order where a message brings its own."""


class Coded(NamedTuple):
    """A message, and the map that its receiver will have: the same chains, in the order of the message."""

    data: bytes
    map: GridMap


def encode_map(grid_map: GridMap, base: GridMap | None = None, *, likelihoods: bool = True) -> Coded:
    """Bytes of a map; where `base` is given, which must be of the same grid, of what is not in it.

    likelihoods: whether edge likelihoods come along, a bit to four each; without, all are told as 1.
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
    kept, built, dropped = _compare(grid_map, known)
    runs = _runs(grid_map, known, kept, built)
    built = _arranged(grid_map, built, runs)
    script.number(len(built))
    last: Place = (0, 0)
    for chain in built:
        last = _write_chain(script, grid_map, known, chain, runs[chain], last, likelihoods)
    touched = {row for chain in built for row in _rows(runs[chain])}
    dropped = [chain for chain in dropped if touched.isdisjoint(range(*known.bounds(chain)))]
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
    changes, likelihoods = reader.bits(1), bool(reader.bits(1))
    if changes:
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


# --- what changed -----------------------------------------------------------------------------------------------


def _compare(new: GridMap, base: GridMap) -> tuple[list[int], list[int], list[int]]:
    """Chains of `new` that are in the base, in the base's order; those that are not; those of the base left over."""
    there = defaultdict(list)
    for chain in range(len(new.rings)):
        there[new.key(chain)].append(chain)
    kept, left = [], []
    for chain in range(len(base.rings)):
        alike = there[base.key(chain)]
        if alike:
            kept.append(alike.pop(0))
        else:
            left.append(chain)
    return kept, sorted(set(range(len(new.rings))) - set(kept)), left


def _runs(new: GridMap, base: GridMap, kept: list[int], built: list[int]) -> dict[int, list[Run]]:
    """How each chain to be built comes about from vertices of the base and new ones."""
    refs = _origins(new, base, kept, built)
    same = refs >= 0
    same[same] &= (new.cells[same] == base.cells[refs[same]]).all(1) & (new.labels[same] == base.labels[refs[same]])
    what = np.where(refs < 0, NEW, np.where(same, COPY, MOVED)).tolist()
    rows = refs.tolist()
    runs: dict[int, list[Run]] = {}
    for chain in built:
        runs[chain] = []
        for v in range(*new.bounds(chain)):
            kind, count, row = runs[chain][-1] if runs[chain] else (-1, 0, -1)
            if what[v] == kind and (kind == NEW or rows[v] == row + count):
                runs[chain][-1] = kind, count + 1, row
            else:
                runs[chain].append((what[v], 1, rows[v]))
    return runs


def _origins(new: GridMap, base: GridMap, kept: list[int], built: list[int]) -> Ints:
    """(n,) row of the base that each vertex is, moved or not, or -1; those of kept chains are not asked for."""
    refs = np.full(len(new.cells), -1)
    free = np.ones(len(base.cells), np.bool_)
    keys = {new.key(chain) for chain in kept}
    for chain in range(len(base.rings)):
        if base.key(chain) in keys:
            free[slice(*base.bounds(chain))] = False
    mine = np.concatenate([np.arange(*new.bounds(chain)) for chain in built]) if built else np.zeros(0, np.int64)
    theirs = np.flatnonzero(free)
    away = np.hypot(*(new.cells[mine, None].astype(float) - base.cells[None, theirs]).transpose(2, 0, 1))
    away += (new.labels[mine, None] != base.labels[None, theirs]) * 0.5  # of two in one place the one alike
    pairs = np.argwhere(away <= NEAR_CELLS)
    taken = np.zeros(len(theirs), np.bool_)
    for k in np.argsort(away[pairs[:, 0], pairs[:, 1]], kind="stable").tolist():
        i, j = pairs[k]
        if refs[mine[i]] < 0 and not taken[j]:
            refs[mine[i]] = theirs[j]
            taken[j] = True
    return refs


def _rows(runs: list[Run]) -> list[int]:
    """Rows of the base that a chain is built of."""
    return [row + k for kind, count, row in runs if kind != NEW for k in range(count)]


def _arranged(new: GridMap, built: list[int], runs: dict[int, list[Run]]) -> list[int]:
    """Chains in the order in which they cost least: as their origins lie in the base, new ones each near the last."""
    changed = sorted((chain for chain in built if _rows(runs[chain])), key=lambda chain: _rows(runs[chain])[0])
    fresh = np.array(sorted(set(built) - set(changed)), np.int64)
    heads = new.cells[new.starts[fresh]].astype(float) if len(fresh) else np.zeros((0, 2))
    here = new.cells[new.starts[changed[-1] + 1] - 1] if changed else np.zeros(2)
    order = list(changed)
    while len(fresh):
        nearest = int(np.abs(heads - here).sum(1).argmin())
        order.append(int(fresh[nearest]))
        here = new.cells[new.starts[fresh[nearest] + 1] - 1]
        fresh, heads = np.delete(fresh, nearest), np.delete(heads, nearest, 0)
    return order


# --- the message ------------------------------------------------------------------------------------------------


class _Script:
    """What a message says, before the orders of its numbers are chosen."""

    def __init__(self) -> None:
        self.tokens: list[tuple[int, int, int]] = []
        """A value, its bits or its order, and which of Orders stands for the order; -1 for bits, -2 for an order."""

    def bits(self, value: int, count: int) -> None:
        self.tokens.append((int(value), count, -1))

    def number(self, value: int, order: int = 0) -> None:
        self.tokens.append((value, order, -2))

    def signed(self, value: int, which: int) -> None:
        self.tokens.append((2 * value if value >= 0 else -2 * value - 1, 0, which))

    def data(self, head: int) -> bytes:
        """The bytes, with orders of its own after the first `head` tokens where these save more than they cost."""
        usual, own, saved = Orders(), [], -sum(WIDTHS)
        for which, width in enumerate(WIDTHS):
            values = [value for value, _, kind in self.tokens if kind == which]
            costs = [_bits_of(values, order) for order in range(1 << width)]
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


def _bits_of(values: list[int], order: int) -> int:
    """Bits that numbers take in exponential-Golomb code of an order."""
    least = 1 << order
    return sum([2 * (value + least).bit_length() - 1 - order for value in values])


START, ALONG, ACROSS = range(3)


def _write_chain(
    script: _Script, new: GridMap, base: GridMap, chain: int, runs: list[Run], last: Place, likelihoods: bool
) -> Place:
    """One chain: ring, runs with their vertices, labels, origins, likelihoods. Returns the last place."""
    first, end = new.bounds(chain)
    ring = bool(new.rings[chain])
    script.bits(ring, 1)
    inside = range(first, end) if ring else range(first + 1, end - 1)
    plain = not new.labels[inside.start : inside.stop].any() if len(inside) else True
    script.bits(plain, 1)
    if len(base.cells):
        script.number(len(runs) - 1)
    v, due = first, 0
    cells = new.cells[first:end].tolist()
    origin: list[int] = []
    for kind, count, row in runs:
        if len(base.cells):
            script.bits(*((0, 1) if kind == COPY else (2, 2) if kind == NEW else (3, 2)))
        script.number(count - 1, 0 if len(base.cells) else 1)
        if kind != NEW:
            script.number(2 * (row - due) if row >= due else 2 * (due - row) - 1, 2)
            due = row + count
        for k in range(count):
            here = (cells[v - first][0], cells[v - first][1])
            origin.append(row + k if kind != NEW else -1)
            if kind == MOVED:
                x, y = base.cells[row + k].tolist()
                script.signed(here[0] - x, ACROSS)
                script.signed(here[1] - y, ACROSS)
            elif kind == NEW and v == first:
                script.signed(here[0] - last[0], START)
                script.signed(here[1] - last[1], START)
            elif kind == NEW:
                _write_step(script, here, last, _across(cells[: v - first]))
            if kind != COPY:
                _write_label(script, int(new.labels[v]), v in inside, plain)
            last = here
            v += 1
    own = new.own[first : end if ring else end - 1].tolist()
    if own:
        script.bits(*((1, 1) if all(own) else (1, 2) if any(own) else (0, 2)))
        if any(own) and not all(own):
            for one in own:
                script.bits(one, 1)
    if likelihoods:
        expected = _expected_levels(origin, base, ring)
        levels = new.level[first : first + len(expected)].tolist()
        script.bits(levels == expected, 1)
        if levels != expected:
            for level, usual in zip(levels, expected, strict=True):
                script.bits(*((1, 1) if level == usual else (level, 4)))
    return last


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


def _across(before: list[list[int]]) -> int:
    """Axis along which a chain is expected to go on: across its last edge; 0 where there is none."""
    if len(before) < 2:
        return 0
    (ax, ay), (bx, by) = before[-2], before[-1]
    return 1 if abs(bx - ax) >= abs(by - ay) else 0


def _expected_levels(origin: list[int], base: GridMap, ring: bool) -> list[int]:
    """Level of each edge of a chain: as in the base where it is an edge there, else SURE."""
    after = base.successors()
    tips = [*origin[1:], origin[0]] if ring else origin[1:]
    pairs = zip(origin, tips, strict=False)
    return [int(base.level[a]) if a >= 0 and b >= 0 and after[a] == b else SURE for a, b in pairs]


class _Rebuilt:
    """Reads a message, vertex by vertex."""

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
        origin: list[int] = []
        due = 0
        for left in reversed(range(reader.number() + 1 if len(base.cells) else 1)):
            kind = NEW
            if len(base.cells):
                kind = COPY if not reader.bits(1) else MOVED if reader.bits(1) else NEW
            count = reader.number(0 if len(base.cells) else 1) + 1
            check_size(len(self.cells) + count)
            row = -1
            if kind != NEW:
                row = due + _unfolded(reader.number(2))
                due = row + count
                if row < 0 or due > len(base.cells) or self.used[row:due].any():
                    raise ProtocolError("changes to a map take a vertex that is not there, or twice")
                self.used[row:due] = True
            for k in range(count):
                at_end = not ring and (len(self.cells) == first or (not left and k == count - 1))
                last = self._vertex(kind, row + k, last, first)
                origin.append(row + k if kind != NEW else -1)
                copied = int(base.labels[row + k]) if kind == COPY else -1
                self.labels.append(copied if kind == COPY else self._label(at_end, plain))
        count = len(self.cells) - first
        if ring and count < 2:
            raise ProtocolError("a ring of a map has one vertex")
        edges = count if ring else count - 1
        none_left = [0] * (count - edges)
        self.own += self._origin(edges) + [False] * len(none_left)
        self.level += self._levels(origin, ring, edges) + none_left
        self.starts.append(len(self.cells))
        self.rings.append(ring)
        return last

    def _vertex(self, kind: int, row: int, last: Place, first: int) -> Place:
        reader = self.reader
        if kind == COPY:
            x, y = self.places[row]
        elif kind == MOVED:
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
        return _unfolded(self.reader.number(self.orders[which]))

    def _label(self, at_end: bool, plain: bool) -> int:
        if not at_end and plain:
            return Label.NOMINAL
        rank = 0 if not self.reader.bits(1) else 1 + self.reader.bits(1)
        return (AT_ENDS if at_end else INSIDE)[rank]

    def _origin(self, edges: int) -> list[bool]:
        if not edges or self.reader.bits(1):
            return [True] * edges
        return [bool(self.reader.bits(1)) for _ in range(edges)] if self.reader.bits(1) else [False] * edges

    def _levels(self, origin: list[int], ring: bool, edges: int) -> list[int]:
        if not self.likelihoods:
            return [SURE] * edges
        expected = _expected_levels(origin, self.base, ring)
        if self.reader.bits(1):
            return expected
        return [usual if self.reader.bits(1) else self.reader.bits(3) for usual in expected]


def _unfolded(value: int) -> int:
    """0, 1, 2, 3, ... as 0, -1, 1, -2, ..."""
    return value >> 1 if value % 2 == 0 else -(value + 1 >> 1)
