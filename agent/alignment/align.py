"""Where a peer's map lies in the robot's own, or why that cannot be told (paper III-C; the tests are ours)."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from agent.alignment.agreement import contradict, overlap
from agent.alignment.candidates import Candidates, ranked
from agent.alignment.config import AlignmentConfig
from agent.alignment.prepared import PreparedMap
from agent.alignment.repetition import rival_score
from agent.geometry.transform import DISTINCT_M, DISTINCT_RAD, apart
from protocol.geometry import Pose, pose_of


@dataclass(frozen=True)
class Alignment:
    """What became of an attempt to align; lengths in metres of wall."""

    transform: Pose | None  # the peer's frame in mine, x, y, theta; None where the maps do not tell
    reason: str
    """`aligned`, or `sighted` where sightings of the peer, or what robots say, gave it. Else why there is none: small,
    large, unlike, weak, conflict, ambiguous, inexact, impossible (by an encounter)."""
    candidates: int = 0  # distinct transforms held against all walls
    inliers: int = 0  # corners that match under the best
    residual: float = 0.0  # root mean square distance of these, metres
    margin: float = 0.0  # share by which the best score exceeds the second-best distinct one's; 1 without a second
    agreement: float = 0.0  # wall that both maps have under the best
    conflict: float = 0.0  # wall of either map where the other has free ground
    overlap: float = 0.0  # agreement over the wall of the smaller map
    score: float = 0.0  # agreement less weighted conflict
    best: Pose | None = None  # the best candidate, also where it was not good enough

    def figures(self) -> dict[str, object]:
        """For an event."""
        names = ("candidates", "inliers", "residual", "margin", "agreement", "conflict", "overlap")
        return {name: getattr(self, name) for name in names}


LEAST_CORNERS = 4
"""Corners of both maps that must match where sightings give the transform, and whenever a proposal is accepted. Fewer
than `min_inliers`, as young maps of robots that see each other have few."""
LONG = 3.0
"""Times `min_score_m` from which LEAST_CORNERS suffice for an alignment by maps, too: two that share a long corridor
have few corners in common. Of 6,319 pairs of recorded maps 19 have 4 or 5 corners and 12 m, and all are right; of 27
with 8 to 12 m two are wrong, and 4 of the 3,306 that have corners enough."""

Method = Callable[[PreparedMap, PreparedMap, AlignmentConfig, np.random.Generator], Alignment]
"""Finds and judges the best transform between two maps. Benchmarks compare others with `by_features`."""


def by_features(mine: PreparedMap, theirs: PreparedMap, config: AlignmentConfig, rng: np.random.Generator) -> Alignment:
    """The best transform by pairs of like corners, if it is good enough and no other is nearly as good."""
    found = ranked(mine, theirs, config, rng)
    if not len(found.transforms):
        return Alignment(None, "unlike")
    rival = 0.0
    if config.repetition and found.scores[0] > 0.0:
        rival = rival_score(found.transforms[0], float(found.agreement[0]), mine, theirs, config.drawing, rng)
    said = described(found, mine, theirs, rival)
    corners = LEAST_CORNERS if said.score >= LONG * config.min_score_m else config.min_inliers
    if said.inliers < corners or said.score < config.min_score_m:
        return replace(said, reason="weak")
    if contradict(said.agreement, said.conflict, config):
        return replace(said, reason="conflict")
    return said if said.margin < config.margin else replace(said, transform=said.best, reason="aligned")


def align_prepared(
    mine: PreparedMap | None,
    theirs: PreparedMap | None,
    config: AlignmentConfig,
    rng: np.random.Generator,
    method: Method = by_features,
) -> Alignment:
    """Find the transform of a peer's map into mine from the walls that each owner saw itself.

    rng is used by the methods that draw. Work is bounded by the maps' size and by constants, never by time.
    """
    if mine is None or theirs is None:
        return Alignment(None, "large")
    if min(mine.corners.true.sum(), theirs.corners.true.sum()) < config.min_corners:
        return Alignment(None, "small")
    return method(mine, theirs, config, rng)


def described(found: Candidates, mine: PreparedMap, theirs: PreparedMap, rival: float = 0.0) -> Alignment:
    """The first candidate with its figures. It is not judged yet, so it has no transform, for the reason `ambiguous`.

    rival: score of the best transform that contradicts it and is not among the candidates; 0 without.
    """
    inliers, residual, agreed, conflict, score = (column.tolist()[0] for column in found[1:])
    best, second = found.transforms[0], rival
    for other, its in zip(found.transforms[1:], found.scores[1:].tolist(), strict=True):
        if apart(best, other, theirs.corners.centre, DISTINCT_M, DISTINCT_RAD):
            second = max(second, its)
            break
    margin = 1.0 - second / score if score > 0.0 else 0.0
    share, count = overlap(agreed, mine.walls, theirs.walls), len(found.transforms)
    return Alignment(
        None,
        "ambiguous",
        candidates=count,
        inliers=inliers,
        residual=residual,
        margin=margin,
        agreement=agreed,
        conflict=conflict,
        overlap=share,
        score=score,
        best=pose_of(best),
    )
