"""Candidates from pairs of like corners, counted out on all corners and walls (paper III-C; ranking ours).

One pair of corners gives a transform: the corner its place, the walls that both have their turn. RANSAC draws pairs;
looking at the likeliest ones in order finds the same transforms sooner and is repeatable. Both are here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agent.alignment.agreement import Walls, agreement
from agent.alignment.config import AlignmentConfig
from agent.alignment.feature import Corners, like_ways, likeness
from agent.geometry.transform import apart, fit, move
from agent.kernels import kernel
from protocol.arrays import Bools, Floats, Ints


class Candidates(NamedTuple):
    """Distinct transforms, best first."""

    transforms: Floats
    """(c, 3) their frame in mine."""
    inliers: Ints
    """(c,) matched corners."""
    residuals: Floats
    """(c,) root mean square distance of matched corners, metres."""
    agreement: Floats
    """(c,) metres of wall."""
    conflict: Floats
    """(c,) metres of wall."""
    scores: Floats
    """(c,) agreement less weighted conflict, metres."""


def ranked(
    mine: Corners,
    theirs: Corners,
    my_walls: Walls,
    their_walls: Walls,
    config: AlignmentConfig,
    rng: np.random.Generator,
) -> Candidates:
    """Transforms from pairs of like corners, refined, with walls held against each other. rng: only if drawn."""
    first = like_transforms(mine, theirs, config, rng)
    refined = refine(first, mine, theirs, config)
    keep = slice(0, config.max_scored)
    walls = np.array([agreement(my_walls, their_walls, t, config) for t in refined.transforms[keep]]).reshape(-1, 2)
    scores = walls[:, 0] - config.conflict_weight * walls[:, 1]
    order = np.lexsort((-refined.inliers[keep], -scores))
    return Candidates(
        refined.transforms[order],
        refined.inliers[order],
        refined.residuals[order],
        walls[order, 0],
        walls[order, 1],
        scores[order],
    )


def like_transforms(mine: Corners, theirs: Corners, config: AlignmentConfig, rng: np.random.Generator) -> Floats:
    """(k, 3) distinct transforms from pairs of like corners; first those that most likely pairs give."""
    pairs, likelihoods = like_pairs(mine, theirs, config, rng)
    transforms, votes = _transforms(
        mine.points,
        mine.parent,
        mine.child,
        theirs.points,
        theirs.parent,
        theirs.child,
        pairs,
        likelihoods,
        theirs.centre,
        config.like_m,
        math.radians(config.like_deg),
    )
    ordered: Floats = transforms[np.argsort(-votes, kind="stable")]
    return ordered


def like_pairs(
    mine: Corners, theirs: Corners, config: AlignmentConfig, rng: np.random.Generator
) -> tuple[Ints, Floats]:
    """(k, 2) pairs of vertices (mine, theirs) that are likelier the same corner than not, and (k,) nats."""
    scores = likeness(mine, theirs, config)
    found = np.flatnonzero(scores.reshape(-1) > 0.0)
    likelihoods = scores.reshape(-1)[found]
    keys = likelihoods
    if config.drawing == "random":  # Gumbel noise: drawn without putting back, by likelihood
        keys = likelihoods + rng.gumbel(size=len(found))
    order = np.argsort(-keys, kind="stable")[: config.max_pairs]
    return np.column_stack(np.divmod(found[order], scores.shape[1] or 1)).astype(np.int64), likelihoods[order]


def by_corners(
    first: Floats,
    mine: Corners,
    theirs: Corners,
    my_walls: Walls,
    their_walls: Walls,
    config: AlignmentConfig,
) -> Candidates:
    """The candidates of a method that knows corners only, from transforms (k, 3), most promising first.

    Scores are the numbers of matched corners. Walls are held against each other for the record alone.
    """
    refined = refine(first, mine, theirs, config, by_walls=False)
    walls = np.array([agreement(my_walls, their_walls, t, config) for t in refined.transforms[:1]]).reshape(-1, 2)
    agreed = np.zeros((len(refined.transforms), 2))
    agreed[:1] = walls
    return Candidates(
        refined.transforms,
        refined.inliers,
        refined.residuals,
        agreed[:, 0],
        agreed[:, 1],
        refined.inliers.astype(np.float64),
    )


class Refined(NamedTuple):
    """Distinct refined transforms, most matched corners first."""

    transforms: Floats
    inliers: Ints
    residuals: Floats


def refine(
    first: Floats,
    mine: Corners,
    theirs: Corners,
    config: AlignmentConfig,
    by_walls: bool = True,
) -> Refined:
    """Fit transforms (k, 3), first come first, to the corners that they match; by_walls: of like walls only."""
    transforms, inliers, residuals = _refine(
        first[: config.max_candidates],
        mine.points,
        mine.true,
        mine.ways,
        theirs.points,
        theirs.true,
        theirs.ways,
        np.array([config.coarse_m, config.fine_m, config.fine_m]),
        math.cos(math.radians(config.alike_deg)),
        by_walls,
    )
    order = np.lexsort((residuals, -inliers))
    order = order[inliers[order] >= 2]
    order = order[_distinct(transforms[order], theirs.centre, config.like_m, math.radians(config.like_deg))]
    return Refined(transforms[order], inliers[order], residuals[order])


@kernel
def _turn(a: Floats, a_parent: Ints, a_child: Ints, i: int, b: Floats, b_parent: Ints, b_child: Ints, j: int) -> float:
    """Turn from b to a by the walls that both corners have within two generations, weighed by length."""
    cosine = sine = 0.0
    for way in range(2):
        p, q = i, j
        for _ in range(2):
            p_next, q_next = (a_parent[p], b_parent[q]) if way == 0 else (a_child[p], b_child[q])
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
    a: Floats,
    a_parent: Ints,
    a_child: Ints,
    b: Floats,
    b_parent: Ints,
    b_child: Ints,
    pairs: Ints,
    likelihoods: Floats,
    centre: Floats,
    like_m: float,
    like_rad: float,
) -> tuple[Floats, Floats]:
    """Distinct transforms (k, 3) of pairs in order, and (k,) the likelihoods of all pairs that give each."""
    found, votes = np.empty((pairs.shape[0], 3)), np.zeros(pairs.shape[0])
    count = 0
    t = np.empty(3)
    for k in range(pairs.shape[0]):
        i, j = pairs[k]
        t[2] = _turn(a, a_parent, a_child, i, b, b_parent, b_child, j)
        c, s = math.cos(t[2]), math.sin(t[2])
        t[0] = a[i, 0] - c * b[j, 0] + s * b[j, 1]
        t[1] = a[i, 1] - s * b[j, 0] - c * b[j, 1]
        same = -1
        for n in range(count):
            if not apart(found[n], t, centre, like_m, like_rad):
                same = n
                break
        if same < 0:
            same = count
            found[same] = t
            count += 1
        votes[same] += likelihoods[k]
    return found[:count], votes[:count]


@kernel
def _refine(
    first: Floats,
    a: Floats,
    a_true: Bools,
    a_ways: Floats,
    b: Floats,
    b_true: Bools,
    b_ways: Floats,
    gates: Floats,
    alike: float,
    by_walls: bool,
) -> tuple[Floats, Ints, Floats]:
    """Transforms fitted anew on the corners within each gate in turn; matched corners and their rms in metres."""
    out, counts, rms = first.copy(), np.zeros(first.shape[0], np.int64), np.zeros(first.shape[0])
    n, m = a.shape[0], b.shape[0]
    nearest, gap = np.empty(n, np.int64), np.empty(n)
    wish = np.empty(m, np.int64)
    source, target = np.empty((m, 2)), np.empty((m, 2))
    for k in range(first.shape[0]):
        t = out[k]
        for g in range(gates.shape[0]):
            gate2 = gates[g] ** 2
            gap[:] = gate2
            nearest[:] = -1
            wish[:] = -1
            c, s = math.cos(t[2]), math.sin(t[2])
            for j in range(m):
                if not b_true[j]:
                    continue
                x, y = move(t, b[j, 0], b[j, 1])
                best = gate2
                for i in range(n):
                    dx = a[i, 0] - x
                    if dx * dx > gate2 or not a_true[i]:
                        continue
                    d2 = dx * dx + (a[i, 1] - y) ** 2
                    if d2 >= best and d2 >= gap[i]:
                        continue
                    if by_walls and not like_ways(b_ways[j], a_ways[i], c, s, alike):
                        continue
                    if d2 < best:
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
            if g < gates.shape[0] - 1:
                t[:] = fit(source, target, count)
    return out, counts, rms


@kernel
def _distinct(transforms: Floats, centre: Floats, like_m: float, like_rad: float) -> Ints:
    """Indices of transforms that are like none before them."""
    kept = np.empty(transforms.shape[0], np.int64)
    count = 0
    for k in range(transforms.shape[0]):
        new = True
        for n in range(count):
            if not apart(transforms[kept[n]], transforms[k], centre, like_m, like_rad):
                new = False
                break
        if new:
            kept[count] = k
            count += 1
    return kept[:count]
