"""Where a peer's frame lies by seeing it: its beacons say where it is in its own frame, discs where in mine (ours).

A disc does not say which robot it is. It may even be a post or a wall's end, which stand still, so only places between
which the peer has moved count. The places of two robots that drive straight at the same speed can be laid on each
other whoever they are, so places on one line are no proof, unless nobody else is there. The method needs no wall, and
tells apart rooms that are alike, which no test on two maps can.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from agent.alignment.agreement import agreement, contradict, overlap
from agent.alignment.align import LEAST_CORNERS, Alignment
from agent.alignment.candidates import COARSE_M, refine
from agent.alignment.config import AlignmentConfig
from agent.alignment.prepared import PreparedMap
from agent.corner_scan import CornerScan
from agent.geometry.transform import DISTINCT_M, DISTINCT_RAD, apart, fit_on_points, move
from agent.kernels import kernel, shared_kernel
from protocol.arrays import Floats, Ints
from protocol.geometry import Pose, pose_of, wrapped
from protocol.walls import main_direction


@dataclass(frozen=True, eq=False)
class Sighting:
    """A scan of the robot at the moment when a peer says where it is."""

    here: Pose  # the robot in its own frame
    theirs: Pose  # the peer in the peer's frame
    discs: Floats  # (d, 2) discs seen, the robot's own frame, metres
    scan: CornerScan
    alone: bool = False  # whether nobody else was heard lately: then no other robot is one of the discs


class Consensus(NamedTuple):
    """The transform that lays most places of the peer on discs."""

    transform: Floats  # (3,) the peer's frame in the robot's own
    explained: int  # sightings that it explains
    rival: int  # those that the best distinct one explains
    middle: Floats  # (2,) of the peer's places
    spread_m: float  # standard deviation of the places that it explains, across the line that fits them best


def apart_places(sightings: Sequence[Sighting], moved_m: float) -> list[Sighting]:
    """Sightings with a disc, each of the peer at a place at least `moved_m` metres from all before it."""
    kept: list[Sighting] = []
    for one in sightings:
        x, y, _ = one.theirs
        if len(one.discs) and all(math.hypot(x - o.theirs[0], y - o.theirs[1]) >= moved_m for o in kept):
            kept.append(one)
    return kept


def consensus(sightings: Sequence[Sighting], gate_m: float, base_m: float) -> Consensus | None:
    """The transform that explains most sightings, of all that pairs of them give; None where no two fit.

    gate_m: a sighting is explained where a disc is so near to the place at which the transform has the peer. base_m:
    how far apart the peer's places of a pair are at least, as they give the turn. Metres.
    """
    if len(sightings) < 2:
        return None
    places = np.array([one.theirs[:2] for one in sightings])
    first = np.cumsum([0, *(len(one.discs) for one in sightings)])
    discs = np.vstack([one.discs for one in sightings])
    middle = places.mean(0)
    best, count = _best_of_pairs(places, first, discs, gate_m, base_m, np.zeros((0, 3)), middle)
    if count < 2:
        return None
    for _ in range(3):
        which = _discs_at(best, places, first, discs, gate_m)
        seen = which >= 0
        if seen.sum() >= 2:
            best = fit_on_points(places[seen], discs[which[seen]], int(seen.sum()))
    seen = _discs_at(best, places, first, discs, gate_m) >= 0
    rival = _best_of_pairs(places, first, discs, gate_m, base_m, best[None], middle)[1]
    across = float(np.linalg.eigvalsh(np.cov(places[seen].T, ddof=0))[0])
    return Consensus(best, int(seen.sum()), rival, middle, math.sqrt(max(across, 0.0)))


def align_by_sight(mine: PreparedMap, theirs: PreparedMap, found: Consensus, config: AlignmentConfig) -> Alignment:
    """The alignment that a consensus gives, refined on the corners of both maps; its reason says if walls agree.

    Reasons: `sighted`, with a transform, or `unlike` (no corners match near it), `weak`, `conflict`.
    """
    none = Alignment(None, "unlike", best=pose_of(found.transform))
    square = squared(found.transform, found.middle, mine.corners.walls, theirs.corners.walls)
    refined = refine(np.stack([found.transform, square]), mine.corners, theirs.corners)
    best = none
    for t, inliers, residual in zip(
        refined.transforms, refined.inliers.tolist(), refined.residuals.tolist(), strict=True
    ):
        if apart(t, found.transform, found.middle, COARSE_M, DISTINCT_RAD):
            continue
        agreed, conflict = agreement(mine.walls, theirs.walls, t)
        score = agreed - config.conflict_weight * conflict
        reason = "sighted"
        if inliers < LEAST_CORNERS or agreed < config.min_score_m:
            reason = "weak"
        elif contradict(agreed, conflict, config):
            reason = "conflict"
        pose = pose_of(t)
        share = overlap(agreed, mine.walls, theirs.walls)
        transform = pose if reason == "sighted" else None
        if best is none or score > best.score:
            best = Alignment(
                transform,
                reason,
                candidates=2,
                inliers=inliers,
                residual=residual,
                margin=1.0,
                agreement=agreed,
                conflict=conflict,
                overlap=share,
                score=score,
                best=pose,
            )
    return best


def squared(transform: Floats, about: Floats, mine: Floats, theirs: Floats) -> Floats:
    """(3,) a transform turned about a point (2,) of their map so that most walls (m, 4) are parallel or square.

    A few sightings within a room give the turn to some degrees only; walls at right angles give it modulo a quarter.
    """
    turn = wrapped(float(main_direction(mine) - main_direction(theirs) - transform[2]), 0.5 * math.pi)
    x, y = move(transform, about[0], about[1])
    theta = float(transform[2]) + turn
    c, s = math.cos(theta), math.sin(theta)
    return np.array([x - c * about[0] + s * about[1], y - s * about[0] - c * about[1], theta])


@shared_kernel
def _discs_at(t: Floats, places: Floats, first: Ints, discs: Floats, gate_m: float) -> Ints:
    """(n,) the disc on which a transform lays the peer in each sighting, or -1."""
    which = np.full(places.shape[0], -1)
    for i in range(places.shape[0]):
        x, y = move(t, places[i, 0], places[i, 1])
        best = gate_m * gate_m
        for k in range(first[i], first[i + 1]):
            d2 = (discs[k, 0] - x) ** 2 + (discs[k, 1] - y) ** 2
            if d2 <= best:
                best, which[i] = d2, k
    return which


@kernel
def _best_of_pairs(
    places: Floats, first: Ints, discs: Floats, gate_m: float, base_m: float, taken: Floats, middle: Floats
) -> tuple[Floats, int]:
    """The transform (3,) that explains most sightings, distinct from the one in taken (0 or 1, 3), and how many.

    places (n, 2) of the peer; discs (d, 2), those of sighting i from row first[i] to first[i + 1].
    """
    n = places.shape[0]
    best, count = np.zeros(3), 0
    for i in range(n):
        for j in range(i + 1, n):
            px, py = places[j, 0] - places[i, 0], places[j, 1] - places[i, 1]
            if math.hypot(px, py) < base_m:
                continue
            for a in range(first[i], first[i + 1]):
                for b in range(first[j], first[j + 1]):
                    qx, qy = discs[b, 0] - discs[a, 0], discs[b, 1] - discs[a, 1]
                    if abs(math.hypot(px, py) - math.hypot(qx, qy)) > gate_m:
                        continue
                    t = fit_on_points(np.stack((places[i], places[j])), np.stack((discs[a], discs[b])), 2)
                    found = (_discs_at(t, places, first, discs, gate_m) >= 0).sum()
                    if found <= count:
                        continue
                    if taken.shape[0] == 0 or apart(taken[0], t, middle, DISTINCT_M, DISTINCT_RAD):
                        best, count = t, found
    return best, count
