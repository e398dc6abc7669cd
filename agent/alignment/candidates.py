"""Candidates from pairs of like corners, counted out on all corners and walls (paper III-C; ranking ours).

One pair of corners gives a transform: the corners give its shift, and the walls that both have give its turn. RANSAC
draws pairs at random. Taking the likeliest pairs in order finds the same transforms sooner and is repeatable.
"""

import math
from typing import NamedTuple

import numpy as np

from agent.alignment.agreement import agreement
from agent.alignment.config import AlignmentConfig
from agent.alignment.feature import Corners, like_walls, likeness
from agent.alignment.prepared import PreparedMap
from agent.geometry.transform import apart, fit_on_points, move
from agent.kernels import kernel
from protocol.arrays import Floats, Ints
from protocol.geometry import wrapped

MAX_PAIRS = 4000  # pairs of corners whose transform is looked at, best first: the iteration budget
MAX_CANDIDATES = 80  # distinct transforms refined on all corners (measured: the right one is among the first 50)
MAX_SCORED = 20  # those with most matched corners, held against all walls (30 find the same on 1,612 pairs)
LIKE_M = 0.3  # two candidates nearer than this at the map's centre are one, as refinement pulls both to the same place
LIKE_RAD = math.radians(6.0)  # the same for their turn
COARSE_M = 0.25  # corners this near are the same in the first round of refinement (measured)
FINE_M = 0.12  # the same in the later rounds (measured)
REFINEMENT_GATES_M = (COARSE_M, FINE_M, FINE_M)


class Candidates(NamedTuple):
    """Distinct transforms, best first."""

    transforms: Floats  # (c, 3) their frame in mine
    inliers: Ints  # (c,) matched corners
    residuals: Floats  # (c,) root mean square distance of matched corners, metres
    agreement: Floats  # (c,) metres of wall
    conflict: Floats  # (c,) metres of wall
    scores: Floats  # (c,) agreement less weighted conflict, metres


def ranked(mine: PreparedMap, theirs: PreparedMap, config: AlignmentConfig, rng: np.random.Generator) -> Candidates:
    """Transforms from pairs of like corners, refined, with walls held against each other. rng: only if drawn."""
    first = like_transforms(mine.corners, theirs.corners, config.drawing, rng)
    refined = refine(first, mine.corners, theirs.corners)
    transforms, inliers, residuals = refined.transforms[:MAX_SCORED], refined.inliers[:MAX_SCORED], refined.residuals
    agreed, conflict = np.array([agreement(mine.walls, theirs.walls, t) for t in transforms]).reshape(-1, 2).T
    scores = agreed - config.conflict_weight * conflict
    order = np.lexsort((-inliers, -scores))
    return Candidates(
        transforms[order], inliers[order], residuals[order], agreed[order], conflict[order], scores[order]
    )


def like_transforms(mine: Corners, theirs: Corners, drawing: str, rng: np.random.Generator) -> Floats:
    """(k, 3) distinct transforms from pairs of like corners, ordered by the likelihoods of their pairs in sum."""
    scores = likeness(mine, theirs)
    found = np.flatnonzero(scores.reshape(-1) > 0.0)  # likelier the same corner than not
    likelihoods = scores.reshape(-1)[found]
    # Gumbel noise draws by likelihood without putting back
    keys = likelihoods + rng.gumbel(size=len(found)) if drawing == "random" else likelihoods
    order = np.argsort(-keys, kind="stable")[:MAX_PAIRS]
    pairs = np.column_stack(np.divmod(found[order], scores.shape[1] or 1)).astype(np.int64)
    transforms, votes = _transforms(mine, theirs, pairs, likelihoods[order], theirs.centre)
    ordered: Floats = transforms[np.argsort(-votes, kind="stable")]
    return ordered


class Refined(NamedTuple):
    """Distinct refined transforms, most matched corners first."""

    transforms: Floats  # (k, 3) their frame in mine
    inliers: Ints  # (k,) matched corners
    residuals: Floats  # (k,) root mean square distance of matched corners, metres


def refine(first: Floats, mine: Corners, theirs: Corners, by_walls: bool = True) -> Refined:
    """Fit the first MAX_CANDIDATES of transforms (k, 3) to the corners that they match.

    by_walls: only corners with like walls match.
    """
    transforms, inliers, residuals = _refine(first[:MAX_CANDIDATES], mine, theirs, by_walls)
    order = np.lexsort((residuals, -inliers))
    order = order[inliers[order] >= 2]
    order = order[_distinct(transforms[order], theirs.centre)]
    return Refined(transforms[order], inliers[order], residuals[order])


def refine_near(transform: Floats, mine: Corners, theirs: Corners, least: int, turn_rad: float) -> Floats | None:
    """One transform (3,) fitted to the corners that it matches, or None.

    None where these are fewer than `least`, or the fit is more than COARSE_M or turn_rad off.
    """
    found = refine(transform[None], mine, theirs)
    if not len(found.transforms) or found.inliers[0] < least:
        return None
    fit: Floats = found.transforms[0]
    return None if apart(fit, transform, theirs.centre, COARSE_M, turn_rad) else fit


@kernel
def _turn(mine: Corners, i: int, theirs: Corners, j: int) -> float:
    """Turn from corner j to corner i by the walls that both have within two generations, weighed by length."""
    a, b = mine.points, theirs.points
    cosine = sine = 0.0
    for way in range(2):
        p, q = i, j
        for _ in range(2):
            p_next, q_next = (mine.parent[p], theirs.parent[q]) if way == 0 else (mine.child[p], theirs.child[q])
            if p_next < 0 or q_next < 0:
                break
            ax, ay = a[p_next, 0] - a[p, 0], a[p_next, 1] - a[p, 1]
            bx, by = b[q_next, 0] - b[q, 0], b[q_next, 1] - b[q, 1]
            long_a, long_b = math.hypot(ax, ay), math.hypot(bx, by)
            weight = min(long_a, long_b) / max(long_a * long_b, 1e-12)
            cosine += weight * (ax * bx + ay * by)
            sine += weight * (bx * ay - by * ax)
            p, q = p_next, q_next
    return math.atan2(sine, cosine)


@kernel
def _transforms(
    mine: Corners, theirs: Corners, pairs: Ints, likelihoods: Floats, centre: Floats
) -> tuple[Floats, Floats]:
    """Distinct transforms (k, 3) of pairs in order, and (k,) the likelihoods of all pairs that give each."""
    a, b = mine.points, theirs.points
    found, votes = np.empty((pairs.shape[0], 3)), np.zeros(pairs.shape[0])
    places, count = np.empty((pairs.shape[0], 3)), 0
    t = np.empty(3)
    for k in range(pairs.shape[0]):
        i, j = pairs[k]
        t[2] = _turn(mine, i, theirs, j)
        c, s = math.cos(t[2]), math.sin(t[2])
        t[0] = a[i, 0] - c * b[j, 0] + s * b[j, 1]
        t[1] = a[i, 1] - s * b[j, 0] - c * b[j, 1]
        place = _place(t, centre)
        same = _first_like(place, places[:count])
        if same == count:
            found[same], places[same] = t, place
            count += 1
        votes[same] += likelihoods[k]
    return found[:count], votes[:count]


@kernel
def _place(t: Floats, centre: Floats) -> tuple[float, float, float]:
    """Where a transform (3,) lays the map's centre (2,), and by how much it turns it: metres and radians."""
    x, y = move(t, centre[0], centre[1])
    return x, y, t[2]


@kernel
def _first_like(place: tuple[float, float, float], places: Floats) -> int:
    """Row of the first of places (n, 3), as `_place` gives them, that one is like; n where it is like none."""
    for n in range(len(places)):
        dx, dy = places[n, 0] - place[0], places[n, 1] - place[1]
        if dx * dx + dy * dy <= LIKE_M**2 and abs(wrapped(places[n, 2] - place[2])) <= LIKE_RAD:
            return n
    return len(places)


@kernel
def _refine(first: Floats, mine: Corners, theirs: Corners, by_walls: bool) -> tuple[Floats, Ints, Floats]:
    """Transforms fitted anew on the corners within each gate in turn; matched corners and their rms in metres."""
    a, b = mine.points, theirs.points
    out, counts, rms = first.copy(), np.zeros(first.shape[0], np.int64), np.zeros(first.shape[0])
    n, m = a.shape[0], b.shape[0]
    nearest, gap = np.empty(n, np.int64), np.empty(n)
    wish = np.empty(m, np.int64)
    source, target = np.empty((m, 2)), np.empty((m, 2))
    by_x = np.argsort(a[:, 0], kind="mergesort")
    across = a[by_x, 0]
    for k in range(first.shape[0]):
        t = out[k]
        for g in range(len(REFINEMENT_GATES_M)):
            gate2 = REFINEMENT_GATES_M[g] * REFINEMENT_GATES_M[g]
            gap[:] = gate2
            nearest[:] = -1
            wish[:] = -1
            c, s = math.cos(t[2]), math.sin(t[2])
            for j in range(m):
                if not theirs.true[j]:
                    continue
                x, y = move(t, b[j, 0], b[j, 1])
                best = gate2
                begin = np.searchsorted(across, x - REFINEMENT_GATES_M[g])
                for i in by_x[begin : np.searchsorted(across, x + REFINEMENT_GATES_M[g])]:
                    d2 = (a[i, 0] - x) ** 2 + (a[i, 1] - y) ** 2
                    if not mine.true[i] or (d2 > best and d2 >= gap[i]):
                        continue
                    if by_walls and not like_walls(theirs.ways[j], mine.ways[i], c, s):
                        continue
                    if d2 < best or (d2 == best and i < wish[j]):
                        best = d2
                        wish[j] = i
                    if d2 < gap[i]:
                        gap[i] = d2
                        nearest[i] = j
            count, error = 0, 0.0
            for j in range(m):
                i = wish[j]
                if i >= 0 and nearest[i] == j:  # each is the other's nearest
                    source[count], target[count] = b[j], a[i]
                    error += gap[i]
                    count += 1
            counts[k], rms[k] = count, math.sqrt(error / max(count, 1))
            if count < 2:
                break
            if g < len(REFINEMENT_GATES_M) - 1:
                t[:] = fit_on_points(source, target, count)
    return out, counts, rms


@kernel
def _distinct(transforms: Floats, centre: Floats) -> Ints:
    """Indices of transforms that are like none before them."""
    kept, places, count = np.empty(transforms.shape[0], np.int64), np.empty(transforms.shape), 0
    for k in range(transforms.shape[0]):
        place = _place(transforms[k], centre)
        if _first_like(place, places[:count]) == count:
            kept[count], places[count] = k, place
            count += 1
    return kept[:count]
