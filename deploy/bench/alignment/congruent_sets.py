"""4-point congruent sets, the paper's baseline (its ref. 24: Aiger, Mitra, Cohen-Or 2008), in the plane and rigid.

Four points whose diagonals cross keep the diagonals' lengths, the angle between them and the shares at which they
cross under any rigid motion. All sets of the other cloud that have the same are found by their crossing points, and
the motion that brings most points onto others wins. Walls, labels and directions play no part.

As in the paper's use of it, the four points lie within a radius. Ours: in the plane all four are coplanar, so bases
are drawn until their diagonals cross; the angle's sign rules out mirrored sets; the best are refined as our own are.
"""

import math

import numpy as np

from agent.alignment.candidates import FINE_M
from agent.geometry.transform import fit_on_points, move
from agent.kernels import kernel
from protocol.arrays import Floats, Ints
from protocol.geometry import wrapped

BASE_RADIUS_M = 5.0  # the four points are within this of the first (paper); wider sets seldom lie in the overlap whole
BASE_SIDE_M = 0.5  # no two of the four points are nearer than this, as a short side turns far with little noise
BASES = 150  # sets of four points that are looked for: the iteration budget
DRAWS_PER_BASE = 50  # four points are drawn at most so often for one base; clouds on a line have none
SAME_M = 0.06  # lengths and crossings that differ by less are the same: 3 sigma of two corners
SAME_RAD = math.radians(5.0)  # the same for the angle of the diagonals
MAX_SETS = 400  # congruent sets looked at for one base


def matched_clouds(source: Floats, target: Floats, rng: np.random.Generator) -> Floats:
    """(k, 3) transforms of the source points (n, 2) onto the targets (m, 2), most matched points first."""
    if len(target) < 4:
        return np.zeros((0, 3))
    one, two = np.nonzero(~np.eye(len(target), dtype=np.bool_))
    length = np.hypot(*(target[two] - target[one]).T)
    order = np.argsort(length, kind="stable")
    pairs = np.column_stack([one, two])[order]
    found, matched = _congruent(source, target, draw_bases(source, rng), pairs, length[order])
    return found[np.argsort(-matched, kind="stable")]


def draw_bases(points: Floats, rng: np.random.Generator) -> Ints:
    """(b, 4) vertices a, b, c, d within a radius, a-b crossing c-d; at most as many as the budget."""
    bases: list[Ints] = []
    for _ in range(BASES):
        for _ in range(DRAWS_PER_BASE if len(points) else 0):
            first = int(rng.integers(len(points)))
            away = np.hypot(points[:, 0] - points[first, 0], points[:, 1] - points[first, 1])
            near = np.flatnonzero((away <= BASE_RADIUS_M) & (away > BASE_SIDE_M))
            if len(near) < 3:
                continue
            others = rng.choice(near, 3, replace=False)
            base = _crossed(points, np.array([first, *others]))
            if len(base):
                bases.append(base)
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
    """The four vertices paired so that their diagonals cross and no side is short; none where that cannot be."""
    for i in range(4):
        for j in range(i):
            side = points[four[i]] - points[four[j]]
            if side[0] ** 2 + side[1] ** 2 < BASE_SIDE_M**2:
                return four[:0]
    for order in ((0, 1, 2, 3), (0, 2, 3, 1), (0, 3, 1, 2)):
        paired: Ints = four[np.array(order)]
        u, v = _crossing(points[paired[0]], points[paired[1]], points[paired[2]], points[paired[3]])
        if 0.0 < u < 1.0 and 0.0 < v < 1.0:
            return paired
    return four[:0]


@kernel
def _matched(source: Floats, target: Floats, t: Floats) -> int:
    """Source points that t brings within the fine gate of a target."""
    count = 0
    for k in range(len(source)):
        x, y = move(t, source[k, 0], source[k, 1])
        for n in range(len(target)):
            if (target[n, 0] - x) ** 2 + (target[n, 1] - y) ** 2 < FINE_M * FINE_M:
                count += 1
                break
    return count


@kernel
def _congruent(source: Floats, target: Floats, bases: Ints, pairs: Ints, lengths: Floats) -> tuple[Floats, Ints]:
    """Transforms of all congruent sets of all bases, and how many points each matches.

    pairs (p, 2): ordered pairs of targets by length; lengths (p,) theirs.
    """
    found, matched = np.empty((len(bases) * MAX_SETS, 3)), np.empty(len(bases) * MAX_SETS, np.int64)
    total, there = 0, np.empty((4, 2))
    for base in bases:
        four = source[base]
        u, v = _crossing(four[0], four[1], four[2], four[3])
        one, two = four[1] - four[0], four[3] - four[2]
        angle = _turn(one, two)
        i0, i1 = _of_length(lengths, math.hypot(one[0], one[1]))
        j0, j1 = _of_length(lengths, math.hypot(two[0], two[1]))
        from_, to = target[pairs[i0:i1, 0]], target[pairs[i0:i1, 1]]
        crossings = from_ + u * (to - from_)
        most = total + MAX_SETS
        for p, q in pairs[j0:j1]:
            x, y = target[p] + v * (target[q] - target[p])
            for i in range(i1 - i0):
                if (crossings[i, 0] - x) ** 2 + (crossings[i, 1] - y) ** 2 > SAME_M * SAME_M or total == most:
                    continue
                if abs(wrapped(_turn(to[i] - from_[i], target[q] - target[p]) - angle)) <= SAME_RAD:
                    there[0], there[1], there[2], there[3] = from_[i], to[i], target[p], target[q]
                    found[total] = fit_on_points(four, there, 4)
                    matched[total] = _matched(source, target, found[total])
                    total += 1
    return found[:total], matched[:total]


@kernel
def _of_length(lengths: Floats, length: float) -> tuple[int, int]:
    """First and behind the last of the rising lengths that are the same as one."""
    return int(np.searchsorted(lengths, length - SAME_M)), int(np.searchsorted(lengths, length + SAME_M))


@kernel
def _turn(one: Floats, two: Floats) -> float:
    """Angle from a direction to another."""
    return math.atan2(one[0] * two[1] - one[1] * two[0], one[0] * two[0] + one[1] * two[1])
