"""What our alignment is compared with: 4-point congruent sets (the paper's baseline), and iterated closest points.

Both know corners only, and have one test: enough of them must match.
"""

from dataclasses import replace

import numpy as np

from agent.alignment import Alignment, AlignmentConfig, PreparedMap
from agent.alignment.agreement import agreement
from agent.alignment.align import Method, by_features, described
from agent.alignment.candidates import Candidates, refine
from deploy.bench.alignment.congruent_sets import matched_clouds
from deploy.bench.alignment.icp import closest_points
from protocol.arrays import Floats

MIN_INLIERS = 12
"""Corners that must match."""


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
