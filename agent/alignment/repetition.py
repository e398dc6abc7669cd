"""Rivals of a transform that the two maps cannot show: patterns that repeat in one map (ours).

Where rooms are alike, the best transform may lay a room on its twin, while the true transform, with less overlap,
scores far worse. Then no candidate warns. But corners that match and are found again elsewhere in the same map may
stand once more beyond that map's end. So the transform moved on by the pattern counts as a rival. Its score is the
agreement times the share of the matched corners that repeat, less the conflict between the maps under it. Corners are
counted and not walls, because along a corridor walls repeat at every step.
"""

import math

import numpy as np

from agent.alignment.agreement import agreement
from agent.alignment.candidates import FINE_M, like_transforms, refine
from agent.alignment.feature import Corners, like_walls
from agent.alignment.prepared import PreparedMap
from agent.geometry.transform import DISTINCT_M, DISTINCT_RAD, apart, compose, inverse, move
from agent.kernels import kernel
from protocol.arrays import Bools, Floats

MAX_PATTERNS = 16  # patterns looked at, those with most corners (40 find the same rivals and take twice the time)
RIVAL_CONFLICT_WEIGHT = 3.0
"""As AlignmentConfig.conflict_weight, for rivals. It is less, as a rival stands for others farther on, which the maps
do not reach. Measured on 1,612 pairs: 0.5 to 3 all hold the bars, 20 leaves 30 % of `symmetric` wrong."""


def patterns(one: Corners, drawing: str, rng: np.random.Generator) -> Floats:
    """(k, 3) transforms, other than none, that lay corners of a map on others of the same; most corners first."""
    found = refine(like_transforms(one, one, drawing, rng)[: 2 * MAX_PATTERNS], one, one).transforms
    still = np.zeros(3)
    moving = [apart(t, still, one.centre, DISTINCT_M, DISTINCT_RAD) for t in found]
    return found[np.array(moving, np.bool_)][:MAX_PATTERNS]


def rival_score(
    best: Floats, agreed_m: float, mine: PreparedMap, theirs: PreparedMap, drawing: str, rng: np.random.Generator
) -> float:
    """Score in metres of the best rival of the transform `best` (3,), under which agreed_m of wall agrees; 0 without.

    No rival is ruled out by where the robots met: the true transform of two partial maps may be none of those found.
    """
    strongest = 0.0
    for which, one, other, there in (
        ("mine", mine.corners, theirs.corners, inverse(best)),
        ("theirs", theirs.corners, mine.corners, best),
    ):
        matched = same_corners(one, there, other)
        if not matched.any():
            continue
        shifts = patterns(one, drawing, rng)
        shares = np.array([same_corners(one, shift, one)[matched].mean() for shift in shifts])
        for k in np.argsort(-shares, kind="stable"):
            if shares[k] * agreed_m <= strongest:
                break
            rival = compose(shifts[k], best) if which == "mine" else compose(best, inverse(shifts[k]))
            conflict = agreement(mine.walls, theirs.walls, rival)[1]
            strongest = max(strongest, float(shares[k]) * agreed_m - RIVAL_CONFLICT_WEIGHT * conflict)
    return strongest


@kernel
def same_corners(one: Corners, t: Floats, other: Corners) -> Bools:
    """(n,) which true corners of a map, moved by the transform t (3,), fall on one of another's with like walls."""
    a, b = one.points, other.points
    out = np.zeros(a.shape[0], np.bool_)
    c, s = math.cos(t[2]), math.sin(t[2])
    for i in range(a.shape[0]):
        if not one.true[i]:
            continue
        x, y = move(t, a[i, 0], a[i, 1])
        for j in range(b.shape[0]):
            if not other.true[j] or (b[j, 0] - x) ** 2 + (b[j, 1] - y) ** 2 > FINE_M * FINE_M:
                continue
            if like_walls(one.ways[i], other.ways[j], c, s):
                out[i] = True
                break
    return out
