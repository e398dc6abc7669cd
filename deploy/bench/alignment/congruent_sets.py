"""4-point congruent sets, the paper's baseline (its ref. 24: Aiger, Mitra, Cohen-Or 2008), in the plane and rigid.

Four points whose diagonals cross keep the diagonals' lengths, the angle between them and the shares at which they
cross under any rigid motion. All sets of the other cloud that have the same are found by their crossing points, and
the motion that brings most points onto others wins. Walls, labels and directions play no part.

As in the paper's use of it, the four points lie within a radius. Ours: in the plane all four are coplanar, so bases
are drawn until their diagonals cross; the angle's sign rules out mirrored sets; the best are refined as our own are.
"""

import math
from typing import NamedTuple

import numpy as np

from agent.alignment.candidates import FINE_M
from agent.geometry.cells import by_cell
from agent.geometry.transform import fit
from agent.kernels import kernel
from protocol.arrays import Floats, Ints
from protocol.geometry import wrapped

BASE_RADIUS_M = 5.0
"""The four points lie within this of the first, as the paper has it. Wider sets seldom lie in the overlap whole."""
BASE_SIDE_M = 0.5  # no two of the four points are nearer than this, as a short side turns far with little noise
BASES = 150  # sets of four points that are looked for: the iteration budget
DRAWS_PER_BASE = 50  # four points are drawn at most so often for one base; clouds on a line have none
SAME_M = 0.06  # lengths and crossings that differ by less are the same: 3 sigma of two corners
SAME_RAD = math.radians(5.0)  # the same for the angle of the diagonals
MAX_SETS = 400  # congruent sets looked at for one base


def matched_clouds(source: Floats, target: Floats, rng: np.random.Generator) -> Floats:
    """(k, 3) transforms of the source points (n, 2) onto the targets (m, 2), most matched points first."""
    bases = draw_bases(source, rng)
    if not len(bases) or len(target) < 4:
        return np.zeros((0, 3))
    one, two = np.nonzero(~np.eye(len(target), dtype=np.bool_))
    span = target[two] - target[one]
    length = np.hypot(span[:, 0], span[:, 1])
    near = np.flatnonzero(length <= 2.0 * BASE_RADIUS_M + SAME_M)
    order = near[np.argsort(length[near], kind="stable")]
    found, matched = _congruent(source, target, bases, np.column_stack([one[order], two[order]]), length[order])
    return found[np.argsort(-matched, kind="stable")]


def draw_bases(points: Floats, rng: np.random.Generator) -> Ints:
    """(b, 4) vertices a, b, c, d within a radius, a-b crossing c-d; at most as many as the budget."""
    bases: list[list[int]] = []
    if len(points) < 4:
        return np.zeros((0, 4), np.int64)
    for _ in range(BASES):
        for _ in range(DRAWS_PER_BASE):
            first = int(rng.integers(len(points)))
            away = np.hypot(points[:, 0] - points[first, 0], points[:, 1] - points[first, 1])
            near = np.flatnonzero((away <= BASE_RADIUS_M) & (away > BASE_SIDE_M))
            if len(near) < 3:
                continue
            others = rng.choice(near, 3, replace=False)
            base = _crossed(points, np.array([first, *others]))
            if base[0] >= 0:
                bases.append(base.tolist())
                break
    return np.array(bases, np.int64).reshape(-1, 4)


@kernel
def _crossing(a: Floats, b: Floats, c: Floats, d: Floats) -> tuple[float, float]:
    """Shares of a-b and c-d at which their lines cross; -1 if they are nearly parallel."""
    rx, ry, sx, sy = b[0] - a[0], b[1] - a[1], d[0] - c[0], d[1] - c[1]
    cross = rx * sy - ry * sx
    if abs(cross) < 0.2 * math.hypot(rx, ry) * math.hypot(sx, sy):
        return -1.0, -1.0
    wx, wy = c[0] - a[0], c[1] - a[1]
    return (wx * sy - wy * sx) / cross, (wx * ry - wy * rx) / cross


@kernel
def _crossed(points: Floats, four: Ints) -> Ints:
    """The four vertices paired so that their diagonals cross and no side is short; -1 first where there is none."""
    out = np.full(4, -1)
    for i in range(4):
        for j in range(i):
            dx, dy = points[four[i], 0] - points[four[j], 0], points[four[i], 1] - points[four[j], 1]
            if dx**2 + dy**2 < BASE_SIDE_M**2:
                return out
    for k in range(1, 4):
        c, d = 1 + k % 3, 1 + (k + 1) % 3
        u, v = _crossing(points[four[0]], points[four[k]], points[four[c]], points[four[d]])
        if 0.0 < u < 1.0 and 0.0 < v < 1.0:
            out[0], out[1], out[2], out[3] = four[0], four[k], four[c], four[d]
            return out
    return out


class Cells(NamedTuple):
    """Points by square cells."""

    x: float  # of the lower left corner, metres
    y: float
    columns: int
    rows: int
    size_m: float
    begins: Ints  # (columns * rows + 1,) where the points of a cell, column by column, begin in `members`
    members: Ints


@kernel
def _cells_of(points: Floats, cell: float) -> Cells:
    """Points (n, 2) by cells of at least this size, metres."""
    x0, y0 = points[:, 0].min(), points[:, 1].min()
    x1, y1 = points[:, 0].max(), points[:, 1].max()
    size = max(cell, max(x1 - x0, y1 - y0) / 500.0)
    columns, rows = int((x1 - x0) // size) + 1, int((y1 - y0) // size) + 1
    where = np.empty(points.shape[0], np.int64)
    for k in range(points.shape[0]):
        where[k] = int((points[k, 0] - x0) // size) * rows + int((points[k, 1] - y0) // size)
    begins, members = by_cell(where, columns * rows)
    return Cells(x0, y0, columns, rows, size, begins, members)


@kernel
def _columns(cells: Cells, x: float) -> tuple[int, int]:
    """The columns to search near x: its own and those beside it, from the first to before the second."""
    i = math.floor((x - cells.x) / cells.size_m)
    return max(i - 1, 0), min(i + 2, cells.columns)


@kernel
def _strip(cells: Cells, column: int, y: float) -> Ints:
    """Points of a column in the row of y and those beside it."""
    j, first = math.floor((y - cells.y) / cells.size_m), column * cells.rows
    low, high = min(max(j - 1, 0), cells.rows), max(min(j + 2, cells.rows), 0)
    return cells.members[cells.begins[first + low] : cells.begins[first + high]]


@kernel
def _matched(source: Floats, target: Floats, t: Floats, cells: Cells) -> int:
    """Source points that t brings within the fine gate of a target; cells: those of the targets."""
    c, s = math.cos(t[2]), math.sin(t[2])
    count = 0
    for k in range(source.shape[0]):
        x, y = t[0] + c * source[k, 0] - s * source[k, 1], t[1] + s * source[k, 0] + c * source[k, 1]
        near = False
        for column in range(*_columns(cells, x)):
            for n in _strip(cells, column, y):
                near |= (target[n, 0] - x) ** 2 + (target[n, 1] - y) ** 2 < FINE_M * FINE_M
        count += near
    return count


@kernel
def _congruent(source: Floats, target: Floats, bases: Ints, pairs: Ints, lengths: Floats) -> tuple[Floats, Ints]:
    """Transforms of all congruent sets of all bases, and how many points each matches.

    pairs (p, 2): ordered pairs of targets by length; lengths (p,) theirs.
    """
    cells = _cells_of(target, FINE_M)
    found, matched = np.empty((bases.shape[0] * MAX_SETS, 3)), np.empty(bases.shape[0] * MAX_SETS, np.int64)
    total = 0
    four, there = np.empty((4, 2)), np.empty((4, 2))
    for k in range(bases.shape[0]):
        for n in range(4):
            four[n] = source[bases[k, n]]
        u, v = _crossing(four[0], four[1], four[2], four[3])
        (ax, ay), (cx, cy) = four[1] - four[0], four[3] - four[2]
        one, two = math.hypot(ax, ay), math.hypot(cx, cy)
        angle = math.atan2(ax * cy - ay * cx, ax * cx + ay * cy)
        i0, i1 = np.searchsorted(lengths, one - SAME_M), np.searchsorted(lengths, one + SAME_M)
        j0, j1 = np.searchsorted(lengths, two - SAME_M), np.searchsorted(lengths, two + SAME_M)
        if i1 == i0 or j1 == j0:
            continue
        from_, to = target[pairs[i0:i1, 0]], target[pairs[i0:i1, 1]]
        crossings = from_ + u * (to - from_)
        near = _cells_of(crossings, SAME_M)
        sets = 0
        for j in range(j0, j1):
            p, q = pairs[j]
            dx, dy = target[q, 0] - target[p, 0], target[q, 1] - target[p, 1]
            x, y = target[p, 0] + v * dx, target[p, 1] + v * dy
            for column in range(*_columns(near, x)):
                for i in _strip(near, column, y):
                    away2 = (crossings[i, 0] - x) ** 2 + (crossings[i, 1] - y) ** 2
                    if away2 > SAME_M * SAME_M or sets >= MAX_SETS:
                        continue
                    r, s = pairs[i0 + i]
                    bx, by = target[s, 0] - target[r, 0], target[s, 1] - target[r, 1]
                    found_angle = math.atan2(bx * dy - by * dx, bx * dx + by * dy)
                    if abs(wrapped(found_angle - angle)) > SAME_RAD:
                        continue
                    there[0], there[1], there[2], there[3] = target[r], target[s], target[p], target[q]
                    found[total] = fit(four, there, 4)
                    matched[total] = _matched(source, target, found[total], cells)
                    total += 1
                    sets += 1
    return found[:total], matched[:total]
