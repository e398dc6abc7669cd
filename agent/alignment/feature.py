"""The paper's feature of a corner (III-C): 4 lengths and 3 angles from grandparent to grandchild; how alike two are.

A chain may end early. The rule (ours): an entry beyond the end is unknown and says nothing; a wall that ends in a
frontier is at least as long as it was seen, and so a lower bound; an angle between two known walls is known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from agent.alignment.config import AlignmentConfig
from agent.kernels import kernel
from protocol.arrays import Bools, Floats, Ints
from protocol.geometry import wrapped
from protocol.wireframe import Label, Wireframe

UNKNOWN, EXACT, AT_LEAST = 0, 1, 2
LENGTHS, ANGLES = 4, 3
ENTRIES = LENGTHS + ANGLES
GENERATIONS = np.array([2, 1, 1, 2, 1, 0, 1])
"""Steps from the corner to the far end of what an entry measures: l1 to l4, a1 to a3."""

OUT_OF, TURN = 2, 5
"""Entries of the wall out of the corner, and of the turn at it."""


@dataclass(frozen=True)
class Corners:
    """What of a wireframe is aligned: walls its owner saw itself, and their ends. Metres, the owner's frame."""

    points: Floats
    """(n, 2) ends of the walls."""
    true: Bools
    """(n,) whether an end is a corner, not a frontier."""
    parent: Ints
    """(n,) the vertex before, or -1."""
    child: Ints
    """(n,) the vertex after, or -1."""
    walls: Floats
    """(m, 4) x1, y1, x2, y2, free space on the left."""
    juts: Bools
    """(m, 2) whether a wall's first and last end are corners that stick out into free space."""
    ways: Floats
    """(n, 2, 2) unit directions of the walls into and out of each vertex; zero where there is none."""
    values: Floats
    """(n, 7) features: four lengths in metres, three turns in radians."""
    kinds: Ints
    """(n, 7) UNKNOWN, EXACT or AT_LEAST."""
    sds: Floats
    """(n, 7) standard deviations of the entries."""

    @property
    def centre(self) -> Floats:
        """(2,) middle of the map, by length of wall."""
        along = self.walls[:, 2:] - self.walls[:, :2]
        length = np.hypot(along[:, 0], along[:, 1])
        middle: Floats = ((self.walls[:, 2:] + self.walls[:, :2]) / 2 * length[:, None]).sum(0) / length.sum()
        return middle


def corners(wireframe: Wireframe, config: AlignmentConfig) -> Corners:
    """Own walls of a wireframe with the features of its vertices. The wireframe must have passed `check`."""
    segments = wireframe.segments()
    length = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    edges = wireframe.edges[wireframe.own & (length > config.min_wall_m)]
    used, ends = np.unique(edges, return_inverse=True)
    ends = ends.reshape(-1, 2)
    points = np.ascontiguousarray(wireframe.points[used], np.float64)
    labels = wireframe.labels[used]
    parent, child = np.full(len(used), -1), np.full(len(used), -1)
    child[ends[:, 0]], parent[ends[:, 1]] = ends[:, 1], ends[:, 0]
    true = labels != Label.FRONTIER
    sd = np.where(labels == Label.NOMINAL, config.corner_sd_m, config.occlusion_sd_m)
    values, kinds, sds = _features(points, true, sd, parent, child, math.radians(config.angle_sd_deg))
    juts = true & (kinds[:, TURN] == EXACT) & (values[:, TURN] < 0.0)
    walls, ways = points[ends].reshape(-1, 4), _directions(points, parent, child)
    return Corners(points, true, parent, child, walls, juts[ends], ways, values, kinds, sds)


def _directions(points: Floats, parent: Ints, child: Ints) -> Floats:
    out = np.zeros((len(points), 2, 2))
    into, out_of = np.flatnonzero(parent >= 0), np.flatnonzero(child >= 0)
    out[into, 0] = points[into] - points[parent[into]]
    out[out_of, 1] = points[child[out_of]] - points[out_of]
    unit: Floats = out / np.maximum(np.linalg.norm(out, axis=2, keepdims=True), 1e-12)
    return unit


@kernel
def _features(
    points: Floats, true: Bools, sd: Floats, parent: Ints, child: Ints, angle_sd: float
) -> tuple[Floats, Ints, Floats]:
    """Values, kinds and deviations (n, 7) of the features of all vertices."""
    n = points.shape[0]
    values, kinds, sds = np.zeros((n, 7)), np.zeros((n, 7), np.int64), np.ones((n, 7))
    line = np.empty(5, np.int64)
    direction, size = np.zeros(4), np.zeros(4)
    for v in range(n):
        line[2] = v
        line[1] = parent[v]
        line[0] = parent[line[1]] if line[1] >= 0 else -1
        line[3] = child[v]
        line[4] = child[line[3]] if line[3] >= 0 else -1
        for k in range(4):
            a, b = line[k], line[k + 1]
            size[k] = 0.0
            if a < 0 or b < 0:
                continue
            dx, dy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
            size[k], direction[k] = math.hypot(dx, dy), math.atan2(dy, dx)
            values[v, k] = size[k]
            kinds[v, k] = 1 if true[a] and true[b] else 2
            sds[v, k] = math.hypot(sd[a], sd[b])
        for k in range(3):
            if size[k] > 0.0 and size[k + 1] > 0.0:
                turn = direction[k + 1] - direction[k]
                values[v, 4 + k] = wrapped(turn)
                kinds[v, 4 + k] = 1
                middle = sd[line[k + 1]]
                blur = (middle / size[k]) ** 2 + (middle / size[k + 1]) ** 2
                sds[v, 4 + k] = math.sqrt(angle_sd**2 + blur)
    return values, kinds, sds


@kernel
def like_ways(one: Floats, other: Floats, c: float, s: float, alike: float) -> bool:
    """Whether a corner's walls (2, 2), turned by the angle of cosine c and sine s, go the ways of another's.

    alike: least cosine between them. Walls that only one of them has say nothing, but one must be shared.
    """
    shared = False
    for way in range(2):
        ax, ay, bx, by = one[way, 0], one[way, 1], other[way, 0], other[way, 1]
        if (ax == 0.0 and ay == 0.0) or (bx == 0.0 and by == 0.0):
            continue
        shared = True
        if bx * (c * ax - s * ay) + by * (s * ax + c * ay) < alike:
            return False
    return shared


def likeness(mine: Corners, theirs: Corners, config: AlignmentConfig) -> Floats:
    """(n, m) log-likelihood ratio in nats of each pair of vertices: the same corner against a chance one.

    Each entry weighs how like its two values are against how common they are in both maps: a right angle says
    little, an odd length much. Discounted per generation. -inf where a vertex is no corner or no wall is shared.
    """
    lengths = _pool(mine, theirs, slice(0, LENGTHS))
    angles = _pool(mine, theirs, slice(LENGTHS, ENTRIES))
    weights = config.discount**GENERATIONS
    common = []
    for one in (mine,) if theirs is mine else (mine, theirs):
        log_common = np.zeros(one.values.shape)
        log_common[:, :LENGTHS] = _log_common(one, lengths, slice(0, LENGTHS), False)
        log_common[:, LENGTHS:] = _log_common(one, angles, slice(LENGTHS, ENTRIES), True)
        common.append(log_common)
    scores: Floats = _likeness(
        mine.values,
        mine.kinds,
        mine.sds,
        mine.true,
        common[0],
        theirs.values,
        theirs.kinds,
        theirs.sds,
        theirs.true,
        common[-1],
        weights,
        math.log(config.wrong_entry),
        math.log(config.wrong_bound),
    )
    return scores


def _pool(mine: Corners, theirs: Corners, part: slice) -> Floats:
    """Exact values of both maps, once each: those next to the vertex that they belong to."""
    column = OUT_OF if part.start == 0 else TURN
    return np.sort(
        np.concatenate([one.values[one.kinds[:, column] == EXACT, column] for one in (mine, theirs)] + [np.zeros(0)])
    )


def _log_common(one: Corners, pool: Floats, part: slice, circular: bool) -> Floats:
    """(n, k) how common a value is: log density of an exact one, log share of the pool above a bound."""
    values, kinds, sds = one.values[:, part], one.kinds[:, part], one.sds[:, part]
    shape = values.shape
    out: Floats = _log_density(
        values.reshape(-1), kinds.reshape(-1), sds.reshape(-1), pool, 2.0 * math.pi if circular else 0.0
    )
    return out.reshape(shape)


FLAT_LENGTH_M = 8.0
"""Range over which unseen lengths are spread when densities are smoothed; a long wall's length, ours."""
FLAT_WEIGHT = 2.0
"""Number of values that this spread counts for."""


@kernel
def _log_density(values: Floats, kinds: Ints, sds: Floats, pool: Floats, turn: float) -> Floats:
    """Kernel density at exact values (blurred by twice their deviation), share above at bounds; logs."""
    out = np.zeros(values.shape[0])
    flat = 1.0 / (turn if turn > 0.0 else 8.0)
    total = pool.shape[0] + 2.0
    for i in range(values.shape[0]):
        if kinds[i] == 1:
            sd = 2.0 * sds[i]
            found = 2.0 * flat
            low, high = 0, pool.shape[0]
            if turn == 0.0:
                low = np.searchsorted(pool, values[i] - 4.0 * sd)
                high = np.searchsorted(pool, values[i] + 4.0 * sd)
            for k in range(low, high):
                d = pool[k] - values[i]
                if turn > 0.0:
                    d = wrapped(d, turn)
                if abs(d) < 4.0 * sd:
                    found += math.exp(-0.5 * (d / sd) ** 2) / (sd * 2.5066282746310002)
            out[i] = math.log(found / total)
        elif kinds[i] == 2:
            above = pool.shape[0] - np.searchsorted(pool, values[i])
            out[i] = math.log((above + 1.0) / total)
    return out


NEGLIGIBLE = -14.0
"""Log-likelihood ratio below which an entry is as good as wrong: 1e-6 against a share of 0.05."""
FAR_OFF = 81.0
"""Square of nine deviations: -40 nats, which no rare value makes up for; values are rarer than in one of 1e6 never."""


@kernel
def _likeness(
    a: Floats,
    a_kinds: Ints,
    a_sds: Floats,
    a_true: Bools,
    a_common: Floats,
    b: Floats,
    b_kinds: Ints,
    b_sds: Floats,
    b_true: Bools,
    b_common: Floats,
    weights: Floats,
    log_wrong: float,
    log_bound: float,
) -> Floats:
    n, m = a.shape[0], b.shape[0]
    out = np.full((n, m), -np.inf)
    wrong = math.exp(log_wrong)
    for i in range(n):
        if not a_true[i]:
            continue
        for j in range(m):
            if not b_true[j]:
                continue
            if (a_kinds[i, 1] == 0 or b_kinds[j, 1] == 0) and (a_kinds[i, 2] == 0 or b_kinds[j, 2] == 0):
                continue
            total = 0.0
            for k in range(7):
                one, two = a_kinds[i, k], b_kinds[j, k]
                if one == 0 or two == 0:
                    continue
                if one == 1 and two == 1:
                    d = a[i, k] - b[j, k]
                    if k >= 4:
                        d = wrapped(d)
                    var = a_sds[i, k] ** 2 + b_sds[j, k] ** 2
                    gain = log_wrong  # what nearly all pairs are, without logarithm and exponential
                    fits = NEGLIGIBLE
                    if d * d < FAR_OFF * var:
                        common = 0.5 * (a_common[i, k] + b_common[j, k])
                        fits = -0.5 * d * d / var - 0.5 * math.log(2.0 * math.pi * var) - common
                    if fits > NEGLIGIBLE:
                        gain = math.log((1.0 - wrong) * math.exp(min(fits, 30.0)) + wrong)
                elif one == 2 and two == 2:
                    continue
                else:  # one wall was seen whole, the other is at least so long
                    room = a[i, k] - b[j, k] if one == 1 else b[j, k] - a[i, k]
                    sd = math.sqrt(a_sds[i, k] ** 2 + b_sds[j, k] ** 2)
                    share = b_common[j, k] if one == 1 else a_common[i, k]
                    gain = log_bound if room < -3.0 * sd else -share
                total += weights[k] * gain
            out[i, j] = total
    return out
