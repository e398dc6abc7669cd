"""What our alignment is compared with: 4-point congruent sets (the paper's baseline), and iterated closest points.

Both know corners only, and have one test: enough of them must match.
"""

import math
from dataclasses import replace

import numpy as np

from agent.alignment.agreement import agreement
from agent.alignment.align import Alignment, Method, by_features, described
from agent.alignment.candidates import Candidates, refine
from agent.alignment.config import AlignmentConfig
from agent.alignment.prepared import PreparedMap
from agent.geometry.transform import fit_on_points, move
from agent.kernels import kernel
from deploy.bench.alignment.congruent_sets import matched_clouds
from protocol.arrays import Floats

MIN_INLIERS = 12  # corners that must match
STARTS = 24  # evenly spread turns from which closest points begin; they turn by up to 10 degrees by themselves
GATE_M = 1.5  # corners farther apart are no pair, as the maps overlap only in part
ROUNDS = 40  # iterations of closest points at most


def by_congruent_sets(
    mine: PreparedMap, theirs: PreparedMap, config: AlignmentConfig, rng: np.random.Generator
) -> Alignment:
    """4PCS: the transform that brings most of their corners onto mine."""
    return _by_corners(matched_clouds(*_clouds(mine, theirs), rng), mine, theirs)


def by_closest_points(
    mine: PreparedMap, theirs: PreparedMap, config: AlignmentConfig, rng: np.random.Generator
) -> Alignment:
    """ICP: from the centres laid on each other, at evenly spread turns, as nothing says how to begin."""
    return _by_corners(closest_points(*_clouds(mine, theirs)), mine, theirs)


METHODS: dict[str, Method] = {"features": by_features, "4pcs": by_congruent_sets, "icp": by_closest_points}


def _clouds(mine: PreparedMap, theirs: PreparedMap) -> tuple[Floats, Floats]:
    """Their true corners (n, 2), and mine (m, 2)."""
    source, target = theirs.corners, mine.corners
    return source.points[source.true], target.points[target.true]


def _by_corners(first: Floats, mine: PreparedMap, theirs: PreparedMap) -> Alignment:
    """Judge transforms (k, 3), most promising first, by their matched corners. Walls are compared for the record."""
    found = refine(first, mine.corners, theirs.corners, by_walls=False)
    if not len(found.transforms):
        return Alignment(None, "unlike")
    agreed, conflict = np.zeros((2, len(found.transforms)))
    agreed[0], conflict[0] = agreement(mine.walls, theirs.walls, found.transforms[0])
    scores = found.inliers.astype(np.float64)
    said = described(Candidates(*found, agreed, conflict, scores), mine, theirs)
    if said.inliers < MIN_INLIERS:
        return replace(said, reason="weak")
    return replace(said, transform=said.best, reason="aligned")


@kernel
def closest_points(source: Floats, target: Floats) -> Floats:
    """(k, 3) where the source points (n, 2) settle on the targets (m, 2) from each turn; both centres lie together."""
    out = np.empty((STARTS, 3))
    here, there = np.empty(source.shape), np.empty(source.shape)
    for k in range(STARTS):
        t = np.array([0.0, 0.0, k * (2.0 * math.pi / STARTS)])
        x, y = move(t, source[:, 0].mean(), source[:, 1].mean())
        t[0], t[1] = target[:, 0].mean() - x, target[:, 1].mean() - y
        for _ in range(ROUNDS):
            count = 0
            for j in range(len(source)):
                x, y = move(t, source[j, 0], source[j, 1])
                away2 = (target[:, 0] - x) ** 2 + (target[:, 1] - y) ** 2
                nearest = away2.argmin()
                if away2[nearest] < GATE_M * GATE_M:
                    here[count], there[count] = source[j], target[nearest]
                    count += 1
            if count < 2:
                break
            last, t = t, fit_on_points(here, there, count)
            if np.abs(t - last).sum() < 1e-6:
                break
        out[k] = t
    return out
