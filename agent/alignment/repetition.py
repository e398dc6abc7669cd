"""Rivals of a transform that the two maps cannot show: patterns that repeat in one map (ours).

Where rooms are alike, the best transform may lay a room on its twin while the true one, with less overlap, scores
worse. No second candidate is near then. But if what agrees is found again elsewhere in the same map, it may be found
again beyond that map's end, too: the transform moved on by the pattern is as good as the share of the agreeing wall
that repeats, unless the maps contradict it there.
"""

from __future__ import annotations

import math

import numpy as np

from agent.alignment.agreement import AGREES, LENGTH, Walls, agreement, verdicts
from agent.alignment.config import AlignmentConfig
from agent.alignment.feature import Corners, Floats
from agent.alignment.meeting import Meeting
from agent.alignment.ranked import like_transforms, refine
from agent.alignment.transform import apart, compose, inverse


def patterns(one: Corners, config: AlignmentConfig, rng: np.random.Generator) -> Floats:
    """(k, 3) transforms, other than none, that lay corners of a map on others of the same; most corners first."""
    found = refine(like_transforms(one, one, config, rng), one, one, config).transforms
    still = np.zeros(3)
    moving = [apart(t, still, one.centre, config.distinct_m, math.radians(config.distinct_deg)) for t in found]
    return found[np.array(moving, np.bool_)][: config.max_patterns]


def rival_score(
    best: Floats,
    agreed_m: float,
    mine: tuple[Walls, Floats],
    theirs: tuple[Walls, Floats],
    config: AlignmentConfig,
    meeting: Meeting | None,
) -> float:
    """Score in metres of the best rival of the transform `best` (3,), under which so much wall agrees; 0 without.

    mine and theirs: walls and patterns of each map.
    """
    strongest = 0.0
    for which, (walls, shifts), (others, there) in (
        ("mine", mine, (theirs[0], inverse(best))),
        ("theirs", theirs, (mine[0], best)),
    ):
        shared = walls.samples[verdicts(walls.samples, there, others, config) == AGREES]
        length = float(shared[:, LENGTH].sum())
        if length <= 0.0:
            continue
        for shift in shifts:
            again = verdicts(shared, shift, walls, config) == AGREES
            share = float(shared[again, LENGTH].sum()) / length
            if share * agreed_m <= strongest:
                continue
            rival = compose(shift, best) if which == "mine" else compose(best, inverse(shift))
            if meeting is not None and not meeting.possible(rival)[0]:
                continue
            conflict = agreement(mine[0], theirs[0], rival, config)[1]
            strongest = max(strongest, share * agreed_m - config.conflict_weight * conflict)
    return strongest
