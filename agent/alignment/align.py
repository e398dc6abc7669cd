"""Where a peer's map lies in the robot's own, or why that cannot be told (paper III-C; the tests are ours)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from agent.alignment.agreement import Walls, index_walls
from agent.alignment.candidates import Candidates, ranked
from agent.alignment.config import AlignmentConfig
from agent.alignment.congruent_sets import congruent_sets
from agent.alignment.feature import Corners, corners
from agent.alignment.icp import icp
from agent.alignment.meeting import Meeting, Place, place_of
from agent.alignment.repetition import rival_score
from agent.geometry.transform import apart
from protocol.arrays import Floats
from protocol.geometry import Pose
from protocol.wireframe import Wireframe


@dataclass(frozen=True)
class Contact:
    """Two robots when one hears the other."""

    mine: Pose
    """The robot that aligns, in its own frame."""
    theirs: Pose
    """The peer, in the peer's frame."""
    range_m: float = math.inf
    """How far the radio carries."""
    radius_m: float = 0.0
    """Of both robots' bodies."""


@dataclass(frozen=True)
class Alignment:
    """What became of an attempt to align; lengths in metres of wall."""

    transform: Pose | None
    """The peer's frame in mine, x, y, theta; None where the maps do not tell."""
    reason: str
    """`aligned`, or why not: small, large, unlike, weak, conflict, ambiguous, impossible (ruled out by the contact)."""
    candidates: int = 0
    """Distinct transforms held against all walls."""
    inliers: int = 0
    """Corners that match under the best."""
    residual: float = 0.0
    """Root mean square distance of these, metres."""
    margin: float = 0.0
    """Share by which the best score exceeds the second-best distinct one's; 1 without a second."""
    agreement: float = 0.0
    """Wall that both maps have under the best."""
    conflict: float = 0.0
    """Wall of one where the other has free ground."""
    overlap: float = 0.0
    """Agreement over the wall of the smaller map."""
    score: float = 0.0
    """Agreement less weighted conflict."""
    best: Pose | None = None
    """The best candidate, also where it was not good enough."""

    def figures(self) -> dict[str, object]:
        """For an event."""
        names = ("candidates", "inliers", "residual", "margin", "agreement", "conflict", "overlap")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class PreparedMap:
    """A map made ready, which pays when it is aligned with several."""

    corners: Corners
    walls: Walls | None
    """None without walls."""
    place: Place
    length_m: float
    """Of all walls that are aligned."""
    true_corners: int
    """Vertices that are no frontier."""


def prepare(wireframe: Wireframe, config: AlignmentConfig) -> PreparedMap | None:
    """A map ready to be aligned; None where it is larger than the configuration allows. Must have passed `check`."""
    if int(wireframe.own.sum()) > config.max_vertices:
        return None
    found = corners(wireframe, config)
    walls = found.walls
    length = float(np.hypot(walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]).sum())
    return PreparedMap(
        found,
        index_walls(walls, found.juts, config) if len(walls) else None,
        place_of(found.points, found.child, walls),
        length,
        int(found.true.sum()),
    )


def align(
    mine: Wireframe,
    theirs: Wireframe,
    config: AlignmentConfig,
    rng: np.random.Generator,
    contact: Contact | None = None,
) -> Alignment:
    """Find the transform of a peer's map into mine from the walls that each owner saw itself.

    Both maps must have passed `Wireframe.check`. rng is used by the methods that draw. Work is bounded by the
    configuration, never by time.
    """
    return align_prepared(prepare(mine, config), prepare(theirs, config), config, rng, contact)


def align_prepared(
    mine: PreparedMap | None,
    theirs: PreparedMap | None,
    config: AlignmentConfig,
    rng: np.random.Generator,
    contact: Contact | None = None,
) -> Alignment:
    """As `align`, for maps made ready."""
    if mine is None or theirs is None:
        return Alignment(None, "large")
    if min(mine.true_corners, theirs.true_corners) < config.min_corners or mine.walls is None or theirs.walls is None:
        return Alignment(None, "small")
    found = candidates(mine, theirs, config, rng)
    if not len(found.transforms):
        return Alignment(None, "unlike")
    judged = _judge(found, mine, theirs, config, rng)
    if judged.transform is None or contact is None:
        return judged
    possible = meeting_of(mine, theirs, config, contact).possible(np.array(judged.transform))[0]
    return judged if possible else replace(judged, transform=None, reason="impossible")


def meeting_of(mine: PreparedMap, theirs: PreparedMap, config: AlignmentConfig, contact: Contact) -> Meeting:
    """What the contact says about any transform."""
    clearance = max(contact.radius_m - config.body_slack_m, 0.0)
    reach = contact.range_m + config.range_slack_m
    return Meeting(contact.mine, contact.theirs, reach, clearance, mine.place, theirs.place)


def candidates(
    mine: PreparedMap,
    theirs: PreparedMap,
    config: AlignmentConfig,
    rng: np.random.Generator,
) -> Candidates:
    """Distinct transforms of the configured method, best first. Both maps must have walls."""
    assert mine.walls is not None and theirs.walls is not None
    method = {"features": ranked, "4pcs": congruent_sets, "icp": icp}[config.method]
    return method(mine.corners, theirs.corners, mine.walls, theirs.walls, config, rng)


def _judge(
    found: Candidates,
    mine: PreparedMap,
    theirs: PreparedMap,
    config: AlignmentConfig,
    rng: np.random.Generator,
) -> Alignment:
    """The best candidate, if it is good enough and no other is nearly as good."""
    centre, turn = theirs.corners.centre, math.radians(config.distinct_deg)
    best = found.transforms[0]
    score = float(found.scores[0])
    second = 0.0
    for other, its in zip(found.transforms[1:], found.scores[1:].tolist(), strict=True):
        if apart(best, other, centre, config.distinct_m, turn):
            second = max(its, 0.0)
            break
    agreed, conflict, inliers = float(found.agreement[0]), float(found.conflict[0]), int(found.inliers[0])
    if config.repetition and config.method == "features" and score > 0.0:
        assert mine.walls is not None and theirs.walls is not None
        one, two = (mine.corners, mine.walls), (theirs.corners, theirs.walls)
        second = max(second, rival_score(best, agreed, one, two, config, rng))
    margin = 1.0 - second / score if score > 0.0 else 0.0
    reason = "aligned"
    if config.method != "features":  # the baselines' own rule
        reason = "aligned" if inliers >= config.baseline_inliers else "weak"
    elif inliers < config.min_inliers or score < config.min_score_m:
        reason = "weak"
    elif conflict > config.max_conflict * agreed:
        reason = "conflict"
    elif margin < config.margin:
        reason = "ambiguous"
    pose = pose_of(best)
    return Alignment(
        pose if reason == "aligned" else None,
        reason,
        len(found.transforms),
        inliers,
        float(found.residuals[0]),
        margin,
        agreed,
        conflict,
        agreed / min(mine.length_m, theirs.length_m),
        score,
        pose,
    )


def pose_of(transform: Floats) -> Pose:
    """A row as a pose."""
    x, y, theta = transform.tolist()
    return x, y, theta
