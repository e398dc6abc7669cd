"""How a map comes about from an earlier one: chains that stay, chains that are built, chains that are dropped."""

from collections import defaultdict
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from protocol.arrays import Ints
from protocol.grid_map import GridMap

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
    row: int
    """The first one's row in the base; -1 for NEW."""

    @property
    def rows(self) -> range:
        """Rows of the base that the run takes."""
        return range(0) if self.origin == VertexOrigin.NEW else range(self.row, self.row + self.length)


class Changes(NamedTuple):
    """Everything that turns the base into the new map."""

    kept: list[int]
    """Chains of the new map that are in the base, in the base's order."""
    built: dict[int, list[VertexRun]]
    """The other chains of the new map, in the order in which they cost the fewest bits."""
    dropped: list[int]
    """Chains of the base that are gone, but those from which a run takes vertices."""


def changes(new: GridMap, base: GridMap) -> Changes:
    """What turns `base` into `new`; both are on the same grid."""
    kept, built, left = _compare(new, base)
    runs = _runs(new, base, kept, built)
    touched = {row for chain in built for row in _rows(runs[chain])}
    dropped = [chain for chain in left if touched.isdisjoint(range(*base.bounds(chain)))]
    return Changes(kept, {chain: runs[chain] for chain in _arranged(new, built, runs)}, dropped)


def _compare(new: GridMap, base: GridMap) -> tuple[list[int], list[int], list[int]]:
    """Chains of `new` that are in the base, in the base's order; those that are not; chains of the base left over."""
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


def _runs(new: GridMap, base: GridMap, kept: list[int], built: list[int]) -> dict[int, list[VertexRun]]:
    """The runs of each chain that is built."""
    refs = _origins(new, base, kept, built)
    same = refs >= 0
    same[same] &= (new.cells[same] == base.cells[refs[same]]).all(1) & (new.labels[same] == base.labels[refs[same]])
    origins = np.where(refs < 0, VertexOrigin.NEW, np.where(same, VertexOrigin.COPY, VertexOrigin.MOVED)).tolist()
    rows = refs.tolist()
    runs: dict[int, list[VertexRun]] = {}
    for chain in built:
        runs[chain] = []
        for v in range(*new.bounds(chain)):
            last = runs[chain][-1] if runs[chain] else None
            if (
                last
                and origins[v] == last.origin
                and (last.origin == VertexOrigin.NEW or rows[v] == last.row + last.length)
            ):
                runs[chain][-1] = last._replace(length=last.length + 1)
            else:
                runs[chain].append(VertexRun(VertexOrigin(origins[v]), 1, rows[v]))
    return runs


def _origins(new: GridMap, base: GridMap, kept: list[int], built: list[int]) -> Ints:
    """(n,) row of the base from which each vertex of the built chains comes, moved or not; -1 for none.

    Pairs are matched greedily, the nearest first; vertices of kept chains take no part.
    """
    refs = np.full(len(new.cells), -1)
    free = np.ones(len(base.cells), np.bool_)
    keys = {new.key(chain) for chain in kept}
    for chain in range(len(base.rings)):
        if base.key(chain) in keys:
            free[slice(*base.bounds(chain))] = False
    mine = np.concatenate([np.arange(*new.bounds(chain)) for chain in built]) if built else np.zeros(0, np.int64)
    theirs = np.flatnonzero(free)
    away = np.hypot(*(new.cells[mine, None].astype(float) - base.cells[None, theirs]).transpose(2, 0, 1))
    away += (new.labels[mine, None] != base.labels[None, theirs]) * OTHER_LABEL_CELLS
    pairs = np.argwhere(away <= NEAR_CELLS)
    taken = np.zeros(len(theirs), np.bool_)
    for k in np.argsort(away[pairs[:, 0], pairs[:, 1]], kind="stable").tolist():
        i, j = pairs[k]
        if refs[mine[i]] < 0 and not taken[j]:
            refs[mine[i]] = theirs[j]
            taken[j] = True
    return refs


def _rows(runs: list[VertexRun]) -> list[int]:
    """Rows of the base that a chain is built of."""
    return [row for run in runs for row in run.rows]


def _arranged(new: GridMap, built: list[int], runs: dict[int, list[VertexRun]]) -> list[int]:
    """Chains in the order of the rows that they take from the base, then new ones, each nearest to the last vertex."""
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
