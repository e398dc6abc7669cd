"""How a map comes about from an earlier one: chains that stay, chains that are built, chains that are dropped."""

import math
from collections import Counter
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from protocol.arrays import Floats, Ints
from protocol.grid_map import GridMap, matched

NEAR_CELLS = 64.0
"""A vertex this near to one of the base is told as that one moved; beyond, a new one costs no more bits."""
OTHER_LABEL_CELLS = 0.5
"""Added to the distance of two vertices with different labels, so that of two in one place the like one is taken."""


class VertexOrigin(IntEnum):
    """How a vertex of a built chain comes about from the base."""

    COPY = 0
    NEW = 1
    MOVED = 2


class VertexRun(NamedTuple):
    """Successive vertices of a chain with one origin, whose rows in the base follow each other, too."""

    origin: VertexOrigin
    length: int
    row: int  # the first one's row in the base; -1 for NEW

    @property
    def rows(self) -> range:
        """Rows of the base that the run takes."""
        return range(0) if self.origin == VertexOrigin.NEW else range(self.row, self.row + self.length)


class Changes(NamedTuple):
    """Everything that turns the base into the new map."""

    built: dict[int, list[VertexRun]]
    """Those chains of the new map that are not in the base, in the order in which they cost the fewest bits."""
    dropped: list[int]  # chains of the base that are gone, without those from which a run takes vertices


def changes(new: GridMap, base: GridMap) -> Changes:
    """What turns `base` into `new`; both are on the same grid."""
    new_keys, base_keys = new.keys, base.keys
    built, left = _unmatched(new_keys, base_keys), _unmatched(base_keys, new_keys)
    kept = set(new_keys)
    runs = _runs(new, base, built, [chain for chain in left if base_keys[chain] not in kept])
    touched = {row for chain in built for row in _rows(runs[chain])}
    dropped = [chain for chain in left if touched.isdisjoint(range(*base.bounds(chain)))]
    return Changes({chain: runs[chain] for chain in _arranged(new, built, runs)}, dropped)


def _unmatched(keys: list[bytes], others: list[bytes]) -> list[int]:
    """Chains whose key the other map does not have, or not so often."""
    spare, left = Counter(others), []
    for chain, key in enumerate(keys):
        spare[key] -= 1
        if spare[key] < 0:
            left.append(chain)
    return left


def _runs(new: GridMap, base: GridMap, built: list[int], free: list[int]) -> dict[int, list[VertexRun]]:
    """The runs of each chain that is built; those chains of the base are free to take vertices from.

    A vertex comes from that of the base which is matched with it, moved or not.
    """
    mine, theirs = new.rows(built), base.rows(free)

    def label_differs(rows: Ints, others: Ints) -> Floats:
        return np.where(new.labels[mine[rows]] != base.labels[theirs[others]], OTHER_LABEL_CELLS, 0.0)

    match = matched(new.cells[mine].astype(float), base.cells[theirs], NEAR_CELLS, label_differs)
    refs = np.full(len(new.cells), -1)
    refs[mine[match >= 0]] = theirs[match[match >= 0]]
    same = refs >= 0
    same[same] &= (new.cells[same] == base.cells[refs[same]]).all(1) & (new.labels[same] == base.labels[refs[same]])
    origins = np.where(refs < 0, VertexOrigin.NEW, np.where(same, VertexOrigin.COPY, VertexOrigin.MOVED)).tolist()
    runs: dict[int, list[VertexRun]] = {chain: [] for chain in built}
    for chain, told in runs.items():
        part = slice(*new.bounds(chain))
        for origin, row in zip(origins[part], refs[part].tolist(), strict=True):
            last = told[-1] if told else None
            if last and origin == last.origin and (row < 0 or row == last.row + last.length):
                told[-1] = last._replace(length=last.length + 1)
            else:
                told.append(VertexRun(VertexOrigin(origin), 1, row))
    return runs


def _rows(runs: list[VertexRun]) -> list[int]:
    """Rows of the base that a chain is built of."""
    return [row for run in runs for row in run.rows]


def _arranged(new: GridMap, built: list[int], runs: dict[int, list[VertexRun]]) -> list[int]:
    """Chains in the order of the rows that they take from the base, then new ones, each nearest to the last vertex."""
    order = sorted((chain for chain in built if _rows(runs[chain])), key=lambda chain: _rows(runs[chain])[0])
    fresh = np.array(sorted(set(built) - set(order)), np.int64)
    x, y = new.cells[new.starts[fresh]].T.astype(float)
    for _ in fresh:
        here = new.cells[new.starts[order[-1] + 1] - 1].tolist() if order else (0, 0)
        nearest = int((np.abs(x - here[0]) + np.abs(y - here[1])).argmin())
        order.append(int(fresh[nearest]))
        x[nearest] = math.inf  # it is told
    return order
