"""Rivals of a transform that the two maps cannot show: patterns that repeat in one map (ours).

Where rooms are alike, the best transform may lay a room on its twin while the true one, with less overlap, scores
worse. No second candidate is near then. But if what agrees is found again elsewhere in the same map, it may be found
again beyond that map's end, too: the transform moved on by the pattern is as good as the share of the matched corners
that repeats, unless the maps contradict it there. Corners are counted and not walls: along a corridor walls repeat
at every step, and mean nothing.
"""

from __future__ import annotations

import math

import numpy as np

from agent.alignment.agreement import Walls, agreement
from agent.alignment.candidates import like_transforms, refine
from agent.alignment.config import AlignmentConfig
from agent.alignment.feature import Corners, like_ways
from agent.geometry.transform import apart, compose, inverse, move
from agent.kernels import kernel
from protocol.arrays import Bools, Floats


def patterns(one: Corners, config: AlignmentConfig, rng: np.random.Generator) -> Floats:
    """(k, 3) transforms, other than none, that lay corners of a map on others of the same; most corners first."""
    likely = like_transforms(one, one, config, rng)[: 2 * config.max_patterns]
    found = refine(likely, one, one, config).transforms
    still = np.zeros(3)
    moving = [apart(t, still, one.centre, config.distinct_m, math.radians(config.distinct_deg)) for t in found]
    return found[np.array(moving, np.bool_)][: config.max_patterns]


def rival_score(
    best: Floats,
    agreed_m: float,
    mine: tuple[Corners, Walls],
    theirs: tuple[Corners, Walls],
    config: AlignmentConfig,
    rng: np.random.Generator,
) -> float:
    """Score in metres of the best rival of the transform `best` (3,), under which so much wall agrees; 0 without.

    The meeting of the robots rules no rival out: that of two partial maps which is true may be none of those found.
    """
    strongest = 0.0
    for which, one, other, there in (
        ("mine", mine[0], theirs[0], inverse(best)),
        ("theirs", theirs[0], mine[0], best),
    ):
        matched = same_corners(one, there, other, config)
        if not matched.any():
            continue
        shifts = patterns(one, config, rng)
        shares = np.array([same_corners(one, shift, one, config)[matched].mean() for shift in shifts])
        for k in np.argsort(-shares, kind="stable"):
            if shares[k] * agreed_m <= strongest:
                break
            rival = compose(shifts[k], best) if which == "mine" else compose(best, inverse(shifts[k]))
            conflict = agreement(mine[1], theirs[1], rival, config)[1]
            strongest = max(strongest, float(shares[k]) * agreed_m - config.rival_conflict_weight * conflict)
    return strongest


def same_corners(one: Corners, transform: Floats, other: Corners, config: AlignmentConfig) -> Bools:
    """(n,) which true corners of a map fall on one of another's with like walls, moved by a transform (3,)."""
    return _same(
        one.points,
        one.true,
        one.ways,
        np.asarray(transform, np.float64),
        other.points,
        other.true,
        other.ways,
        config.fine_m,
        math.cos(math.radians(config.alike_deg)),
    )


@kernel
def _same(
    a: Floats,
    a_true: Bools,
    a_ways: Floats,
    t: Floats,
    b: Floats,
    b_true: Bools,
    b_ways: Floats,
    gate: float,
    alike: float,
) -> Bools:
    out = np.zeros(a.shape[0], np.bool_)
    c, s = math.cos(t[2]), math.sin(t[2])
    for i in range(a.shape[0]):
        if not a_true[i]:
            continue
        x, y = move(t, a[i, 0], a[i, 1])
        for j in range(b.shape[0]):
            if not b_true[j] or (b[j, 0] - x) ** 2 + (b[j, 1] - y) ** 2 > gate * gate:
                continue
            if like_ways(a_ways[i], b_ways[j], c, s, alike):
                out[i] = True
                break
    return out
