"""When the map of a peer is aligned with the robot's own, and how: by the maps, or by seeing the peer."""

import math
from dataclasses import replace

import numpy as np

from agent.alignment.agreement import BENT_M, EXACT_M, agreement, bear_out, beside, contradict, overlap
from agent.alignment.align import LEAST_CORNERS, Alignment, align_prepared
from agent.alignment.by_sight import Consensus, align_by_sight, apart_places, consensus, squared
from agent.alignment.candidates import refine_near
from agent.alignment.config import AlignmentConfig
from agent.alignment.encounter import RANGE_SLACK_M
from agent.alignment.prepared import PreparedMap, prepare
from agent.cooperation.peer import PeerLog, Proposed, transform_sd_m
from agent.cooperation.verification import DISC_GATE_M, DISC_MOVED_M
from agent.cooperation.wall_fit import WallFit, fit_on_walls
from agent.geometry.clearance import distances_to_walls
from agent.geometry.transform import DISTINCT_M, DISTINCT_RAD, apart
from protocol.arrays import Floats
from protocol.geometry import apply, pose_of
from protocol.messages import RobotSpec
from protocol.wireframe import Wireframe

RETRY_GROWTH = 0.2
"""A pair of maps is aligned again once one has gained this share of its walls since the last attempt."""
RETRY_WALLS = 4
"""... and at least so many walls."""
GROWTH_ON_TRIAL = 0.15
"""The same share while a proposal is on trial, as alignments of later maps are evidence."""
OFF_MAP = 2.3
"""A peer is not believed that is farther from all walls of its own map than so many times what its lidar reaches."""

SIGHTINGS = 4
"""Places of a peer at which one transform must explain a disc, to be proposed by sight. Measured with the two below: of
1,636 such fits in 14 runs none was wrong; of 103 fits that fail one of the three conditions 65 were wrong."""
SIGHTINGS_AHEAD = 2
"""... and by so many more than the best distinct transform explains."""
SIGHTING_SPREAD_M = 0.2
"""Least standard deviation of these places across the line through them; 63 of the wrong fits have less than 0.17.

It is not asked of a peer that was met alone, as two that pass each other in a corridor: of 310 fits with less in 62
runs none was wrong, and 10 of 449 where others were heard, too."""
SIGHTING_BASE_M = 0.6
"""Two places of a peer this far apart give a turn, to 5 degrees by discs of 5 cm."""
BESIDE_NATS = 50.0
"""What it would weigh against a proposal if all walls that both maps have lay beside themselves: a twentieth of them
beyond `max_beside` weighs as much as a sighting. Half turns of halls that are nearly the same after one have 0.13 to
0.25, and need one to three more. Of 27 right ones in three such halls, where odometry errs, 7 have 0.10 to 0.15."""
KNOWN_SD_M = 0.01
"""Standard error of a fit on walls that needs no corners, where the peer was met alone. Half a metre of wall across a
corridor gives it. Of 711 such fits near sightings in 62 runs none was wrong, and the worst was 10 mm off."""


class Aligner:
    """Aligns the robot's own map with those of its peers."""

    def __init__(self, config: AlignmentConfig, spec: RobotSpec, rng: np.random.Generator) -> None:
        """rng: for alignment methods that draw."""
        self.config, self.spec, self.rng = config, spec, rng
        self.range_m = math.inf if spec.radio_range_m is None else spec.radio_range_m
        self.reach_m = self.range_m + RANGE_SLACK_M
        """How far off a peer may be when its message comes: both move while the message is under way."""
        self._on_m = BENT_M if spec.odometry.noisy else EXACT_M
        """How far from each other a wall of one map and the same of another may be where a transform is proposed."""
        self._own: tuple[Wireframe, PreparedMap | None] | None = None

    def prepared(self, own: Wireframe) -> PreparedMap | None:
        """The own map made ready; kept, as it is aligned with several peers."""
        if self._own is None or self._own[0] is not own:
            self._own = own, prepare(own, self.config)
        return self._own[1]

    def has_grown(self, log: PeerLog, own: Wireframe, growth: float) -> bool:
        """Whether one of two maps has gained this share of its walls since both were aligned, and both have enough."""
        counts = _own_walls(log, own)
        grown = any(
            now >= before + max(RETRY_WALLS, growth * before)
            for now, before in zip(counts, log.aligned_walls, strict=True)
        )
        return grown and min(counts) >= self.config.min_corners // 2

    def take_growth(self, log: PeerLog, own: Wireframe) -> None:
        """Note that both maps are aligned as they are now."""
        log.aligned_walls, log.growth = _own_walls(log, own), RETRY_GROWTH
        log.map_is_news = log.begins = False

    def both(self, log: PeerLog, own: Wireframe) -> tuple[PreparedMap, PreparedMap] | None:
        """The own map and the peer's newest, made ready; None where one is too large."""
        assert log.map is not None
        mine, theirs = self.prepared(own), prepare(log.map.wireframe, self.config)
        return None if mine is None or theirs is None else (mine, theirs)

    def align(self, log: PeerLog, own: Wireframe) -> Alignment:
        """Align by the maps. A transform that puts a message out of the radio's range, or a body into a wall, is
        impossible. That never helps another one to win, as the true one need not be among the candidates.
        """
        assert log.map is not None and log.first_encounter is not None
        mine, theirs = self.prepared(own), prepare(log.map.wireframe, self.config)
        said = align_prepared(mine, theirs, self.config, self.rng)
        if said.transform is None or mine is None or theirs is None:
            return said
        spaces = mine.free_space, theirs.free_space
        if not log.first_encounter.allows(np.array([said.transform]), *spaces, self.range_m, self.spec.radius_m)[0]:
            return replace(said, transform=None, reason="impossible")
        exact = fit_on_walls(own, log.map.wireframe, np.array(said.transform)).transform
        if beside(mine.walls, theirs.walls, exact, self._on_m) > self.config.max_beside:
            return replace(said, transform=None, reason="inexact")
        return self._in_reach(log, replace(said, transform=pose_of(exact), best=pose_of(exact)))

    def _in_reach(self, log: PeerLog, said: Alignment) -> Alignment:
        """The alignment, without its transform where that puts a message out of the radio's range."""
        if said.transform is None:
            return said
        there = apply(said.transform, np.array([one.theirs[:2] for one in log.encounters]))
        here = np.array([one.here[:2] for one in log.encounters])
        in_reach = (np.hypot(*(there - here).T) <= self.reach_m).all()
        return said if in_reach else replace(said, transform=None, reason="impossible")

    def compare(self, peer: Proposed, own: Wireframe, said: Alignment) -> None:
        """Weigh an alignment of later maps of a peer on trial, and take its refined transform and the later map."""
        assert peer.log.map is not None
        centre = peer.log.map.wireframe.points.mean(0)
        same = said.best is not None and not apart(
            np.array(said.best), peer.transform, centre, DISTINCT_M, DISTINCT_RAD
        )
        against = said.reason in ("conflict", "impossible", "inexact")
        if said.transform is not None or (against and same):
            peer.trial.align_again(same and not against)
        if same and said.transform is not None:
            peer.trial.transform, peer.transform_sd_m = np.array(said.transform), transform_sd_m(said)
        if same and not against:
            peer.map = peer.log.map
            peer.trial.walls.lay(peer.map.wireframe, peer.trial.transform, own)

    def align_by_sight(self, log: PeerLog, own: Wireframe) -> tuple[Consensus, Alignment] | None:
        """The transform by new sightings, and the alignment near it; None where either cannot be told."""
        if not log.sighting_is_news:
            return None
        log.sighting_is_news = False
        places = apart_places(log.sightings, DISC_MOVED_M)
        found = consensus(places, DISC_GATE_M, SIGHTING_BASE_M)
        if found is None or found.explained < SIGHTINGS:
            return None
        if found.spread_m < SIGHTING_SPREAD_M and not log.met_alone:
            return None
        if found.explained - found.rival < SIGHTINGS_AHEAD or found.explained <= log.explained_by_proposal:
            return None
        maps = self.both(log, own)
        return None if maps is None else (found, self._align_on(log, own, maps, found))

    def align_as_told(self, log: PeerLog, own: Wireframe) -> Alignment | None:
        """The alignment near what the peer says itself; None where it has said nothing, or a map is too large.

        The newest maps must agree there, and all messages must have come from within the radio's range. What does not
        pass waits for the peer's next word, as maps grow.
        """
        claim, log.claim = log.claim, None
        said = None if claim is None or log.map is None else self.align_near(log, own, claim)
        if said is not None and said.transform is not None:
            log.tried_claim = claim
        return said

    def align_near(self, log: PeerLog, own: Wireframe, transform: Floats) -> Alignment | None:
        """The alignment near a transform (3,) that others say; None where a map is too large."""
        maps = self.both(log, own)
        if maps is None:
            return None
        near = Consensus(transform, 0, 0, maps[1].corners.centre, 0.0)
        return self._in_reach(log, self._align_on(log, own, maps, near))

    def _align_on(
        self, log: PeerLog, own: Wireframe, maps: tuple[PreparedMap, PreparedMap], near: Consensus
    ) -> Alignment:
        """The alignment near a consensus on corners, or on walls alone where there are too few and it was met alone."""
        said = align_by_sight(*maps, near, self.config)
        if said.transform is not None or not log.met_alone:
            return said
        assert log.map is not None
        mine, theirs = maps
        start = squared(near.transform, near.middle, mine.corners.walls, theirs.corners.walls)
        fit = fit_on_walls(own, log.map.wireframe, start)
        agreed, conflict = agreement(mine.walls, theirs.walls, fit.transform)
        if not is_known(fit) or not bear_out(agreed, conflict, self.config):
            return said
        share = overlap(agreed, mine.walls, theirs.walls)
        pose = pose_of(fit.transform)
        return Alignment(pose, "sighted", 1, margin=1.0, agreement=agreed, conflict=conflict, overlap=share, best=pose)

    def walls_agree(
        self, log: PeerLog, own: Wireframe, transform: Floats, must_overlap: bool, spare_nats: float = 0.0
    ) -> bool:
        """Whether the newest maps agree under a transform (3,) of the peer's frame into the own.

        This is no evidence for it, but it must not fail.
        must_overlap: whether they must have corners in common; else it suffices that they do not contradict each other.
        spare_nats: by how much other evidence exceeds what decides. Where odometry errs, maps are bent, and what lies
        beside itself weighs against that.
        """
        maps = self.both(log, own)
        if maps is None:
            return False
        mine, theirs = maps
        if not must_overlap:
            return not contradict(*agreement(mine.walls, theirs.walls, transform), self.config)
        assert log.map is not None
        fit = fit_on_walls(own, log.map.wireframe, transform)
        if not corners_agree(mine, theirs, transform) and not (log.met_alone and is_known(fit)):
            return False
        most = self.config.max_beside + (spare_nats / BESIDE_NATS if self.spec.odometry.noisy else 0.0)
        if beside(mine.walls, theirs.walls, fit.transform, EXACT_M) > most:
            return False
        return bear_out(*agreement(mine.walls, theirs.walls, fit.transform), self.config)


def _own_walls(log: PeerLog, own: Wireframe) -> tuple[int, int]:
    """Walls that the owners saw themselves, of the own map and of the peer's newest."""
    assert log.map is not None
    return int(own.own.sum()), int(log.map.wireframe.own.sum())


def is_known(fit: WallFit) -> bool:
    """Whether walls alone say to a centimetre where a peer's map lies."""
    return fit.sd_at(fit.centre) <= KNOWN_SD_M


def corners_agree(mine: PreparedMap, theirs: PreparedMap, transform: Floats) -> bool:
    """Whether enough corners of both maps match near a transform (3,)."""
    return refine_near(transform, mine.corners, theirs.corners, LEAST_CORNERS, DISTINCT_RAD) is not None


def off_its_map(log: PeerLog, reach_m: float) -> bool:
    """Whether a peer says that it is far from all walls that it says it has seen. reach_m: of its lidar."""
    assert log.map is not None
    away = distances_to_walls(np.array([log.pose[:2]]), log.map.wireframe.segments())
    return bool(away[0] > OFF_MAP * reach_m)
