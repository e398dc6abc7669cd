"""4-point congruent sets, the paper's baseline (its ref. 24: Aiger, Mitra, Cohen-Or 2008), in the plane and rigid.

Four points whose diagonals cross keep the diagonals' lengths, the angle between them and the shares at which they
cross under any rigid motion. All sets of the other cloud that have the same are found by their crossing points, and
the motion that brings most points onto others wins. Walls, labels and directions play no part.

As in the paper's use of it, the four points lie within a radius. Ours: in the plane all four are coplanar, so bases
are drawn until their diagonals cross; the angle's sign rules out mirrored sets; the best are refined as our own are.
"""

from __future__ import annotations

import math

import numpy as np

from agent.alignment.agreement import Walls
from agent.alignment.candidates import Candidates, by_corners
from agent.alignment.config import AlignmentConfig
from agent.alignment.feature import Corners
from agent.geometry.transform import fit
from agent.kernels import kernel
from protocol.arrays import Floats, Ints
from protocol.geometry import wrapped

DRAWS_PER_BASE = 50
"""Four points are drawn at most so often for one base; clouds on a line have none."""


def congruent_sets(
    mine: Corners,
    theirs: Corners,
    my_walls: Walls,
    their_walls: Walls,
    config: AlignmentConfig,
    rng: np.random.Generator,
) -> Candidates:
    """Transforms that bring most of their corners onto mine; scores are the numbers of corners."""
    transforms = matched_clouds(theirs.points[theirs.true], mine.points[mine.true], config, rng)
    return by_corners(transforms, mine, theirs, my_walls, their_walls, config)


def matched_clouds(source: Floats, target: Floats, config: AlignmentConfig, rng: np.random.Generator) -> Floats:
    """(k, 3) transforms of the source points (n, 2) onto the targets (m, 2), most matched points first."""
    bases = draw_bases(source, config, rng)
    if not len(bases) or len(target) < 4:
        return np.zeros((0, 3))
    one, two = np.nonzero(~np.eye(len(target), dtype=np.bool_))
    span = target[two] - target[one]
    length = np.hypot(span[:, 0], span[:, 1])
    near = np.flatnonzero(length <= 2.0 * config.base_radius_m + config.congruent_m)
    order = near[np.argsort(length[near], kind="stable")]
    found, matched = _congruent(
        source,
        target,
        bases,
        np.column_stack([one[order], two[order]]),
        length[order],
        config.congruent_m,
        math.radians(config.congruent_deg),
        config.fine_m,
        config.max_congruent,
    )
    return found[np.argsort(-matched, kind="stable")]


def draw_bases(points: Floats, config: AlignmentConfig, rng: np.random.Generator) -> Ints:
    """(b, 4) vertices a, b, c, d within a radius, a-b crossing c-d; at most as many as the budget."""
    bases: list[list[int]] = []
    if len(points) < 4:
        return np.zeros((0, 4), np.int64)
    for _ in range(config.bases):
        for _ in range(DRAWS_PER_BASE):
            first = int(rng.integers(len(points)))
            away = np.hypot(points[:, 0] - points[first, 0], points[:, 1] - points[first, 1])
            near = np.flatnonzero((away <= config.base_radius_m) & (away > config.base_side_m))
            if len(near) < 3:
                continue
            others = rng.choice(near, 3, replace=False)
            base = _crossed(points, np.array([first, *others]), config.base_side_m)
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
def _crossed(points: Floats, four: Ints, side: float) -> Ints:
    """The four vertices paired so that their diagonals cross and no side is short; -1 first where there is none."""
    out = np.full(4, -1)
    for i in range(4):
        for j in range(i):
            if (points[four[i], 0] - points[four[j], 0]) ** 2 + (
                points[four[i], 1] - points[four[j], 1]
            ) ** 2 < side**2:
                return out
    for k in range(1, 4):
        c, d = 1 + k % 3, 1 + (k + 1) % 3
        u, v = _crossing(points[four[0]], points[four[k]], points[four[c]], points[four[d]])
        if 0.0 < u < 1.0 and 0.0 < v < 1.0:
            out[0], out[1], out[2], out[3] = four[0], four[k], four[c], four[d]
            return out
    return out


@kernel
def _cloud_cells(points: Floats, cell: float) -> tuple[float, float, int, int, float, Ints, Ints]:
    """Points by square cells: lower left corner, columns, rows, cell size, begins, members."""
    x0, y0, x1, y1 = np.inf, np.inf, -np.inf, -np.inf
    for k in range(points.shape[0]):
        x0, x1 = min(x0, points[k, 0]), max(x1, points[k, 0])
        y0, y1 = min(y0, points[k, 1]), max(y1, points[k, 1])
    size = max(cell, max(x1 - x0, y1 - y0) / 500.0)
    columns, rows = int((x1 - x0) // size) + 1, int((y1 - y0) // size) + 1
    begins = np.zeros(columns * rows + 1, np.int64)
    where = np.empty(points.shape[0], np.int64)
    for k in range(points.shape[0]):
        where[k] = int((points[k, 0] - x0) // size) * rows + int((points[k, 1] - y0) // size)
        begins[where[k] + 1] += 1
    for k in range(columns * rows):
        begins[k + 1] += begins[k]
    at, members = begins.copy(), np.empty(points.shape[0], np.int64)
    for k in range(points.shape[0]):
        members[at[where[k]]] = k
        at[where[k]] += 1
    return x0, y0, columns, rows, size, begins, members


@kernel
def _matched(
    source: Floats,
    target: Floats,
    t: Floats,
    gate: float,
    x0: float,
    y0: float,
    columns: int,
    rows: int,
    size: float,
    begins: Ints,
    members: Ints,
) -> int:
    """Source points that t brings within the gate of a target."""
    c, s = math.cos(t[2]), math.sin(t[2])
    count = 0
    for k in range(source.shape[0]):
        x, y = t[0] + c * source[k, 0] - s * source[k, 1], t[1] + s * source[k, 0] + c * source[k, 1]
        i, j = math.floor((x - x0) / size), math.floor((y - y0) / size)
        near = False
        for p in range(max(i - 1, 0), min(i + 1, columns - 1) + 1):
            for q in range(max(j - 1, 0), min(j + 1, rows - 1) + 1):
                for n in range(begins[p * rows + q], begins[p * rows + q + 1]):
                    dx, dy = target[members[n], 0] - x, target[members[n], 1] - y
                    if dx * dx + dy * dy < gate * gate:
                        near = True
        if near:
            count += 1
    return count


@kernel
def _congruent(
    source: Floats,
    target: Floats,
    bases: Ints,
    pairs: Ints,
    lengths: Floats,
    off: float,
    turn: float,
    gate: float,
    budget: int,
) -> tuple[Floats, Ints]:
    """Transforms of all congruent sets of all bases, and how many points each matches.

    pairs: ordered pairs of targets by length. budget: sets per base.
    """
    x0, y0, columns, rows, size, begins, members = _cloud_cells(target, gate)
    found, matched = np.empty((bases.shape[0] * budget, 3)), np.empty(bases.shape[0] * budget, np.int64)
    total = 0
    four, there = np.empty((4, 2)), np.empty((4, 2))
    for k in range(bases.shape[0]):
        for n in range(4):
            four[n] = source[bases[k, n]]
        u, v = _crossing(four[0], four[1], four[2], four[3])
        ax, ay, cx, cy = (
            four[1, 0] - four[0, 0],
            four[1, 1] - four[0, 1],
            four[3, 0] - four[2, 0],
            four[3, 1] - four[2, 1],
        )
        one, two = math.hypot(ax, ay), math.hypot(cx, cy)
        angle = math.atan2(ax * cy - ay * cx, ax * cx + ay * cy)
        i0, i1 = np.searchsorted(lengths, one - off), np.searchsorted(lengths, one + off)
        j0, j1 = np.searchsorted(lengths, two - off), np.searchsorted(lengths, two + off)
        if i1 == i0 or j1 == j0:
            continue
        crossings = np.empty((i1 - i0, 2))
        for i in range(i0, i1):
            p, q = pairs[i]
            crossings[i - i0, 0] = target[p, 0] + u * (target[q, 0] - target[p, 0])
            crossings[i - i0, 1] = target[p, 1] + u * (target[q, 1] - target[p, 1])
        ex0, ey0, e_columns, e_rows, e_size, e_begins, e_members = _cloud_cells(crossings, off)
        sets = 0
        for j in range(j0, j1):
            p, q = pairs[j]
            dx, dy = target[q, 0] - target[p, 0], target[q, 1] - target[p, 1]
            x, y = target[p, 0] + v * dx, target[p, 1] + v * dy
            m, n = math.floor((x - ex0) / e_size), math.floor((y - ey0) / e_size)
            for g in range(max(m - 1, 0), min(m + 1, e_columns - 1) + 1):
                for h in range(max(n - 1, 0), min(n + 1, e_rows - 1) + 1):
                    for w in range(e_begins[g * e_rows + h], e_begins[g * e_rows + h + 1]):
                        i = e_members[w]
                        if (crossings[i, 0] - x) ** 2 + (crossings[i, 1] - y) ** 2 > off * off or sets >= budget:
                            continue
                        r, s = pairs[i0 + i]
                        bx, by = target[s, 0] - target[r, 0], target[s, 1] - target[r, 1]
                        found_angle = math.atan2(bx * dy - by * dx, bx * dx + by * dy)
                        if abs(wrapped(found_angle - angle)) > turn:
                            continue
                        there[0], there[1], there[2], there[3] = target[r], target[s], target[p], target[q]
                        t = fit(four, there, 4)
                        found[total] = t
                        matched[total] = _matched(source, target, t, gate, x0, y0, columns, rows, size, begins, members)
                        total += 1
                        sets += 1
    return found[:total], matched[:total]
