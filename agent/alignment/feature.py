"""The paper's feature of a corner (III-C): 4 lengths and 3 angles from grandparent to grandchild; how alike two are.

A chain may end early. The rule (ours): an entry beyond the end is unknown and says nothing; a wall that ends in a
frontier is at least as long as it was seen, and so a lower bound; an angle between two known walls is known.
"""

import math
from typing import NamedTuple

import numpy as np

from agent.geometry.lines import ALIKE_COSINE
from agent.geometry.poles import find_poles
from agent.kernels import kernel
from protocol.arrays import Bools, Floats, Ints
from protocol.geometry import wrapped
from protocol.walls import directions, lengths, neighbours
from protocol.wireframe import Label, Wireframe

UNKNOWN, EXACT, AT_LEAST = 0, 1, 2  # what is known of an entry of a feature
LENGTHS, ANGLES = 4, 3
ENTRIES = LENGTHS + ANGLES
INTO, OUT_OF, TURN = 1, 2, 5  # entries of the walls into and out of the corner, and of the turn at it

MIN_FEATURE_WALL_M = 0.03  # shorter walls are left out, as they have no direction: 3 sigma of a corner
CORNER_SD_M = 0.02  # standard deviation of a nominal corner (two bound an exact length): thrice the filter's noise
OCCLUSION_SD_M = 0.04  # the same of an occlusion vertex: half the distance of two beams at 3.5 m more
ANGLE_SD_RAD = math.radians(2.0)  # of the angle between two long walls; short ones add the error of their ends
DISCOUNTS = 0.8 ** np.array([2, 1, 1, 2, 1, 0, 1])
"""(7,) weight of each entry: 0.8 for each step from the corner to the far end of what the entry measures (the discount
is the paper's, III-C; 0.8 measured)."""
LOG_WRONG_ENTRY = math.log(0.05)  # share of entries that differ at one corner: a wrong label, or a wall split in two
LOG_WRONG_BOUND = math.log(0.01)  # share of walls seen longer than they are: less, as noise hardly does that


class Corners(NamedTuple):
    """What is aligned of a wireframe: walls that its owner saw itself, and their ends. Metres, the owner's frame."""

    points: Floats  # (n, 2) ends of the walls
    true: Bools  # (n,) whether an end is a corner, not a frontier
    parent: Ints  # (n,) the vertex before, or -1
    child: Ints  # (n,) the vertex after, or -1
    walls: Floats  # (m, 4) x1, y1, x2, y2, free space on the left
    juts: Bools  # (m, 2) whether a wall's first and last end are corners that stick out into free space
    ways: Floats  # (n, 2, 2) unit directions of the walls into and out of each vertex; zero where there is none
    values: Floats  # (n, 7) features: four lengths in metres, three turns in radians
    kinds: Ints  # (n, 7) UNKNOWN, EXACT or AT_LEAST
    sds: Floats  # (n, 7) standard deviations of the entries

    @property
    def centre(self) -> Floats:
        """(2,) mean of all points on the walls."""
        length, middles = lengths(self.walls), (self.walls[:, 2:] + self.walls[:, :2]) / 2
        return np.asarray((middles * length[:, None]).sum(0) / max(length.sum(), 1e-9), np.float64)


def corners(wireframe: Wireframe) -> Corners:
    """Own walls of a wireframe with the features of its vertices. The wireframe must have passed `check`.

    Poles are left out: all of them have the same features.
    """
    no_pole = find_poles(wireframe)[1] < 0
    edges = wireframe.edges[wireframe.own & no_pole & (lengths(wireframe.segments()) > MIN_FEATURE_WALL_M)]
    used, ends = np.unique(edges, return_inverse=True)
    ends = ends.reshape(-1, 2)
    points = np.ascontiguousarray(wireframe.points[used], np.float64)
    labels = wireframe.labels[used]
    parent, child = neighbours(ends, len(used))
    true = labels != Label.FRONTIER
    sd = np.where(labels == Label.NOMINAL, CORNER_SD_M, OCCLUSION_SD_M)
    values, kinds, sds = _features(points, true, sd, parent, child)
    juts = true & (kinds[:, TURN] == EXACT) & (values[:, TURN] < 0.0)
    itself = np.arange(len(used))
    before, after = (points[np.where(other >= 0, other, itself)] for other in (parent, child))
    ways = np.stack([directions(np.hstack([before, points])), directions(np.hstack([points, after]))], 1)
    return Corners(points, true, parent, child, points[ends].reshape(-1, 4), juts[ends], ways, values, kinds, sds)


@kernel
def _features(points: Floats, true: Bools, sd: Floats, parent: Ints, child: Ints) -> tuple[Floats, Ints, Floats]:
    """Values, kinds and deviations (n, 7) of the features of all vertices."""
    n = points.shape[0]
    values, kinds, sds = np.zeros((n, 7)), np.zeros((n, 7), np.int64), np.ones((n, 7))
    line = np.empty(5, np.int64)
    direction, size = np.zeros(4), np.zeros(4)
    for v in range(n):
        line[1], line[2], line[3] = parent[v], v, child[v]
        line[0] = parent[line[1]] if line[1] >= 0 else -1
        line[4] = child[line[3]] if line[3] >= 0 else -1
        for k in range(4):
            a, b = line[k], line[k + 1]
            size[k] = 0.0
            if a < 0 or b < 0:
                continue
            dx, dy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
            size[k], direction[k] = math.hypot(dx, dy), math.atan2(dy, dx)
            values[v, k] = size[k]
            kinds[v, k] = EXACT if true[a] and true[b] else AT_LEAST
            sds[v, k] = math.hypot(sd[a], sd[b])
        for k in range(3):
            if size[k] > 0.0 and size[k + 1] > 0.0:
                turn = direction[k + 1] - direction[k]
                values[v, LENGTHS + k] = wrapped(turn)
                kinds[v, LENGTHS + k] = EXACT
                middle = sd[line[k + 1]]
                blur = (middle / size[k]) ** 2 + (middle / size[k + 1]) ** 2
                sds[v, LENGTHS + k] = math.sqrt(ANGLE_SD_RAD**2 + blur)
    return values, kinds, sds


@kernel
def like_walls(one: Floats, other: Floats, c: float, s: float) -> bool:
    """Whether two corners share a wall, and all that they share are alike; each (2, 2) as in `Corners.ways`.

    c, s: cosine and sine of the angle by which the first is turned. A wall that only one of them has says nothing.
    """
    shared = False
    for way in range(2):
        ax, ay, bx, by = one[way, 0], one[way, 1], other[way, 0], other[way, 1]
        if (ax == 0.0 and ay == 0.0) or (bx == 0.0 and by == 0.0):
            continue
        shared = True
        if bx * (c * ax - s * ay) + by * (s * ax + c * ay) < ALIKE_COSINE:
            return False
    return shared


def likeness(mine: Corners, theirs: Corners) -> Floats:
    """(n, m) log-likelihood ratio in nats of each pair of vertices: the same corner against a chance one.

    Each entry weighs how like its two values are against how common they are in both maps: a right angle says
    little, an odd length much. Discounted per generation. -inf where a vertex is no corner or no wall is shared.
    """
    pools = [_pool(mine, theirs, column) for column in (OUT_OF, TURN)]
    common = [_log_common(one, *pools) for one in ((mine,) if theirs is mine else (mine, theirs))]
    scores: Floats = _likeness(mine, theirs, common[0], common[-1])
    return scores


def _pool(mine: Corners, theirs: Corners, column: int) -> Floats:
    """Exact values of both maps, sorted; each once, as the column is that of the entry next to the vertex."""
    return np.sort(np.concatenate([one.values[one.kinds[:, column] == EXACT, column] for one in (mine, theirs)]))


FLAT_LENGTH_M = 8.0  # unseen lengths are spread over this range when densities are smoothed: the length of a long wall
FLAT_WEIGHT = 2.0  # how many values that spread counts for
BLUR = 2.0  # width of the kernel that smooths densities, in deviations of an entry
KERNEL_SIGMAS = 4.0  # deviations beyond which the kernel counts as zero: 3e-4 of its height


@kernel
def _log_common(one: Corners, lengths_pool: Floats, turns_pool: Floats) -> Floats:
    """(n, 7) how common each value is among the sorted pools of lengths and of angles, which are circular.

    Of an exact value its log density, by a kernel of twice its deviation; of a bound the log share above it.
    """
    out = np.zeros(one.values.shape)
    for i in range(one.values.shape[0]):
        for k in range(ENTRIES):
            circular = k >= LENGTHS
            pool = turns_pool if circular else lengths_pool
            total = pool.shape[0] + FLAT_WEIGHT
            value = one.values[i, k]
            if one.kinds[i, k] == EXACT:
                sd = BLUR * one.sds[i, k]
                found = FLAT_WEIGHT * (1.0 / (2.0 * math.pi if circular else FLAT_LENGTH_M))
                low, high = 0, pool.shape[0]
                if not circular:
                    low = np.searchsorted(pool, value - KERNEL_SIGMAS * sd)
                    high = np.searchsorted(pool, value + KERNEL_SIGMAS * sd)
                for p in range(low, high):
                    d = pool[p] - value
                    if circular:
                        d = wrapped(d)
                    if abs(d) < KERNEL_SIGMAS * sd:
                        found += math.exp(-0.5 * (d / sd) ** 2) / (sd * 2.5066282746310002)  # sqrt(2 pi)
                out[i, k] = math.log(found / total)
            elif one.kinds[i, k] == AT_LEAST:
                above = pool.shape[0] - np.searchsorted(pool, value)
                out[i, k] = math.log((above + 1.0) / total)
    return out


NEGLIGIBLE = -14.0  # an entry with a lower log-likelihood ratio counts as wrong: 1e-6 is little against a share of 0.05
MOST_NATS = 30.0  # ... with a higher one as this, which keeps its exponential within range
BOUND_SIGMAS = 3.0  # deviations by which a bound may exceed the length that it bounds
FAR_OFF = 81.0  # square of nine deviations: such a difference costs 40 nats, and no value is so rare as to outweigh it


@kernel
def _likeness(mine: Corners, theirs: Corners, my_common: Floats, their_common: Floats) -> Floats:
    """(n, m) sum of all entries' log-likelihood ratios; *_common: `_log_common` of each map."""
    n, m = mine.points.shape[0], theirs.points.shape[0]
    out = np.full((n, m), -np.inf)
    wrong = math.exp(LOG_WRONG_ENTRY)
    a, a_kinds, a_sds = mine.values, mine.kinds, mine.sds
    b, b_kinds, b_sds = theirs.values, theirs.kinds, theirs.sds
    for i in range(n):
        if not mine.true[i]:
            continue
        for j in range(m):
            if not theirs.true[j]:
                continue
            no_into = a_kinds[i, INTO] == UNKNOWN or b_kinds[j, INTO] == UNKNOWN
            if no_into and (a_kinds[i, OUT_OF] == UNKNOWN or b_kinds[j, OUT_OF] == UNKNOWN):
                continue
            total = 0.0
            for k in range(ENTRIES):
                one, two = a_kinds[i, k], b_kinds[j, k]
                if one == UNKNOWN or two == UNKNOWN:
                    continue
                if one == EXACT and two == EXACT:
                    d = a[i, k] - b[j, k]
                    if k >= LENGTHS:
                        d = wrapped(d)
                    var = a_sds[i, k] ** 2 + b_sds[j, k] ** 2
                    gain = LOG_WRONG_ENTRY  # that of nearly all pairs: no logarithm or exponential is needed
                    ratio = NEGLIGIBLE
                    if d * d < FAR_OFF * var:
                        common = 0.5 * (my_common[i, k] + their_common[j, k])
                        ratio = -0.5 * d * d / var - 0.5 * math.log(2.0 * math.pi * var) - common
                    if ratio > NEGLIGIBLE:
                        gain = math.log((1.0 - wrong) * math.exp(min(ratio, MOST_NATS)) + wrong)
                elif one == AT_LEAST and two == AT_LEAST:
                    continue
                else:  # one wall was seen whole, the other is at least so long
                    room = a[i, k] - b[j, k] if one == EXACT else b[j, k] - a[i, k]
                    sd = math.sqrt(a_sds[i, k] ** 2 + b_sds[j, k] ** 2)
                    share = their_common[j, k] if one == EXACT else my_common[i, k]
                    gain = LOG_WRONG_BOUND if room < -BOUND_SIGMAS * sd else -share
                total += DISCOUNTS[k] * gain
            out[i, j] = total
    return out
