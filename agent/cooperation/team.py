"""Trust, but verify: proposals Z and transforms T of Algorithm 1, from the first message to the merged map.

Per peer: heard, then proposed (an alignment that is on trial while the robot drives to where the peer was), then
merged, or back to heard. Alignment is tried only when a map has grown, one pair a tick; the rest waits its turn.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from agent.alignment import Alignment, AlignmentConfig, PreparedMap, align_prepared, prepare
from agent.alignment import Contact as Meeting
from agent.alignment.agreement import agreement
from agent.alignment.by_sight import Sighting, align_by_sight, apart_places, consensus
from agent.alignment.candidates import refine
from agent.communication.contacts import NOTHING_SEEN, Contact, Contacts, Seen
from agent.cooperation.config import CooperationConfig
from agent.cooperation.ground import Ground, pieces_of
from agent.cooperation.verification import Verification
from agent.corner_scan import CornerScan
from agent.errand import ErrandEnd
from agent.geometry.clearance import distances_to_walls
from agent.geometry.transform import apart, compose
from agent.mapping.contradiction import ViewRules
from agent.mapping.layers import Layer, layer_of
from protocol.arrays import Bools, Floats
from protocol.geometry import Pose, apply
from protocol.messages import Event, RobotSpec, TeammatePose
from protocol.wireframe import Wireframe

LOOK_TICKS = 3
"""Received maps are held against every third scan: the robot drives 0.13 m in between."""
LATE_TICKS = 2
"""A message older than this says no longer where the peer is: it drives 0.1 m in the time."""
IN_FRONT_M = 0.8
"""How far before a wall the robot stands to see it."""


@dataclass
class Peer:
    """All that a robot knows of another one."""

    name: str
    status: Literal["heard", "proposed", "merged"] = "heard"
    wireframe: Wireframe | None = None
    """The newest map that it sent, in its own frame."""
    map_tick: int = -1
    news: bool = False
    """Whether this map has not been looked at yet."""
    taken: Wireframe | None = None
    """The map that is on trial or merged: a later one must first agree with it."""
    taken_tick: int = -1
    pose: Pose = (0.0, 0.0, 0.0)
    """Where it was last heard to be, in its own frame."""
    seen: Seen = NOTHING_SEEN
    pose_tick: int = -1
    contact: tuple[Pose, Pose] | None = None
    """Where both were when contact was made: the robot in its own frame, the peer in the peer's."""
    places: list[tuple[Pose, Pose]] = field(default_factory=list)
    """The same for messages since."""
    sightings: deque[Sighting] = field(default_factory=deque)
    """What was seen at messages, each after one of the two had moved; the newest ones."""
    seen_anew: bool = False
    """Whether the newest was not looked at yet."""
    seen_at: int = 0
    """Sightings that were explained at the last attempt by them."""
    seen_proposed: int = 0
    """The same at the last proposal by them: another one needs more."""
    corners: tuple[int, int] = (0, 0)
    """True corners of both maps at the last attempt."""
    growth: float = 0.0
    """Share of them that one map must gain before the next."""
    transform: Floats | None = None
    """(3,) its frame in the robot's own: T, once merged."""
    alignment: Alignment | None = None
    trial: Verification | None = None
    ground: Ground = field(default_factory=Ground)
    layer: Layer | None = None
    merged_since: int = -1
    """Tick at which it was merged."""
    hidden: Bools = field(default_factory=lambda: np.zeros(0, np.bool_))
    """(m,) walls that it does not show."""
    merged_tick: int = -1
    """When the merged map was so."""
    agreed_m: float = 0.0
    """Wall that the merged map and the own one have in common."""
    refused: int = 0
    """Messages in a row that contradict what was merged."""
    updated: int = -1
    """Tick at which its map was last taken."""


class Cooperation:
    """One robot's dealings with all others."""

    def __init__(
        self,
        config: CooperationConfig,
        alignment: AlignmentConfig,
        spec: RobotSpec,
        rules: ViewRules,
        rng: np.random.Generator,
    ) -> None:
        """rules: how scans are held against received walls. rng: for alignment methods that draw."""
        self.config = config
        self.alignment = alignment
        self.spec = spec
        self.rules = rules
        self.rng = rng
        self.peers: dict[str, Peer] = {}
        self.queue: list[str] = []
        """Z: peers with a proposal, in order of arrival."""
        self.changed = False
        """Whether a layer of the map has changed in this tick."""
        self.viewpoints = np.zeros((0, 2))
        """(k, 2) places in the robot's own frame from where merged peers saw what is in their merged maps."""
        self._told_views = False
        self._events: list[Event] = []
        self._mine: tuple[int, PreparedMap | None] = (-1, None)
        self._set_out = -1
        self._goal: Floats | None = None
        self._detours = 0
        self._reach_m = math.inf if spec.radio_range_m is None else spec.radio_range_m + alignment.range_slack_m

    # what others see of it

    @property
    def layers(self) -> list[Layer]:
        """Merged maps, by name of the peer."""
        return [peer.layer for _, peer in sorted(self.peers.items()) if peer.layer is not None]

    @property
    def errand(self) -> Floats | None:
        """(2,) where the robot has to go to verify a proposal, its own frame; None without."""
        return self._goal

    @property
    def merged_ticks(self) -> dict[str, int]:
        """Peers whose maps are part of the robot's, and when those maps were so."""
        return {name: peer.merged_tick for name, peer in sorted(self.peers.items()) if peer.layer is not None}

    @property
    def shares_work_with(self) -> list[str]:
        """Merged peers whose viewpoints are of use."""
        return [name for name, peer in self.peers.items() if self.config.division and peer.layer is not None]

    def teammates(self, tick: int) -> list[TeammatePose]:
        """Where peers with a transform were last heard to be, in the robot's own frame."""
        known = []
        for name, peer in sorted(self.peers.items()):
            if peer.transform is None or peer.pose_tick < 0:
                continue
            x, y, theta = compose(peer.transform, np.array(peer.pose)).tolist()
            spread, turn = self._uncertainty(peer, tick)
            known.append(
                TeammatePose(
                    robot=name,
                    tick=peer.pose_tick,
                    pose=(x, y, theta),
                    covariance=(spread**2, 0.0, 0.0, 0.0, spread**2, 0.0, 0.0, 0.0, turn**2),
                    status="merged" if peer.status == "merged" else "proposed",
                )
            )
        return known

    def _uncertainty(self, peer: Peer, tick: int) -> tuple[float, float]:
        """Standard deviations in metres and radians: of the transform, and what the peer drove since."""
        fit = peer.alignment
        error = max(fit.residual, 0.01) / math.sqrt(max(fit.inliers, 1)) if fit is not None else 0.1
        drive = self.spec.max_speed_mps * (tick - peer.pose_tick) / self.spec.lidar.rate_hz
        return math.hypot(0.01 + error, drive / 3.0), min(math.pi, 0.01 + drive / 0.5)

    def strangers(self, tick: int, contacts: Contacts) -> bool:
        """Whether a peer is heard whose frame is not known, or not for long."""
        lately = tick - self.config.verification.return_s * self.spec.lidar.rate_hz
        heard = (self.peers[name] for name in contacts.present if name in self.peers)
        return self.config.sharing and any(peer.layer is None or peer.merged_since >= lately for peer in heard)

    def rivals(self, tick: int) -> Floats:
        """(k, 3) teammates for the division of frontiers: place, and metres that each may have gone since."""
        if not self.config.division:
            return np.zeros((0, 3))
        found = []
        for name in sorted(self.peers):
            peer = self.peers[name]
            silent_s = (tick - peer.pose_tick) / self.spec.lidar.rate_hz
            if peer.layer is None or peer.transform is None or silent_s > self.config.known_s:
                continue
            x, y = apply(peer.transform, np.array([peer.pose[:2]]))[0].tolist()
            found.append((x, y, self.config.nearer_m + 0.5 * self.spec.max_speed_mps * silent_s))
        return np.array(found, np.float64).reshape(-1, 3)

    # one tick

    def step(
        self, tick: int, contacts: Contacts, own: Wireframe, pose: Pose, scan: CornerScan, errand: ErrandEnd | None
    ) -> list[Event]:
        """Take what was heard and seen; own: the map of own scans alone, pose: both in the robot's own frame.

        errand: how the last tick's errand ended; None while it is under way or there was none.
        """
        self._events, self.changed, self._told_views = [], False, False
        if not self.config.sharing:
            return []
        discs = apply(pose, scan.discs)
        for contact in contacts.present.values():
            self._hear(tick, contact, pose, scan, discs)
        for peer in self.peers.values():
            if peer.transform is not None and tick % LOOK_TICKS == 0:
                self._look(tick, peer, pose, scan)
        self._pursue(tick, own, pose, errand)
        for peer in self.peers.values():
            if self._align_if_grown(tick, peer, own, pose):
                break
        if self.changed or self._told_views:
            self._gather_views()
        return self._events

    def _hear(self, tick: int, contact: Contact, here: Pose, scan: CornerScan, discs: Floats) -> None:
        peer = self.peers.setdefault(contact.peer, Peer(contact.peer))
        pose_tick, map_tick = min(contact.pose_tick, tick), min(contact.map_tick, tick)  # nobody is ahead of time
        if contact.pose is not None and pose_tick > peer.pose_tick:
            if peer.contact is None or contact.since >= peer.pose_tick:
                peer.contact = here, contact.pose
                peer.places = []
            self._see(tick, peer, pose_tick, Sighting(here, contact.pose, discs, scan))
            peer.pose, peer.pose_tick = contact.pose, pose_tick
            if len(peer.places) < self.config.places_kept:
                peer.places.append((here, peer.pose))
            trial = peer.trial
            if trial is not None and tick - peer.pose_tick <= LATE_TICKS:
                self._weigh_meeting(trial, Sighting(here, peer.pose, discs, scan))
        if contact.wireframe is not None and contact.wireframe is not peer.wireframe:
            peer.wireframe, peer.map_tick, peer.news = contact.wireframe, map_tick, True
        if contact.seen is not peer.seen:
            peer.seen, self._told_views = contact.seen, True

    def _see(self, tick: int, peer: Peer, pose_tick: int, sighting: Sighting) -> None:
        """Keep what is seen while the peer says where it is."""
        may_have_driven = self.spec.max_speed_mps * (pose_tick - peer.pose_tick) / self.spec.lidar.rate_hz
        if (
            math.dist(sighting.theirs[:2], peer.pose[:2])
            > 1.5 * may_have_driven + self.config.verification.disc_moved_m
        ):
            peer.sightings.clear()  # it began anew, in another frame
            peer.seen_at = peer.seen_proposed = 0
        moved_m = self.config.verification.disc_moved_m
        last = peer.sightings[-1] if peer.sightings else None
        moved = last is None or any(
            math.dist(one[:2], two[:2]) >= moved_m
            for one, two in ((sighting.here, last.here), (sighting.theirs, last.theirs))
        )
        if moved and tick - pose_tick <= LATE_TICKS:
            peer.sightings.append(sighting)
            peer.seen_anew = True
            if len(peer.sightings) > self.config.places_kept:
                peer.sightings.popleft()

    def _weigh_meeting(self, trial: Verification, sighting: Sighting) -> None:
        """What a message and the scan of its moment say of the proposal."""
        here, theirs = sighting.here, sighting.theirs
        trial.hear(here, theirs, self._reach_m)
        trial.look_for_disc(here, theirs, sighting.scan, sighting.discs, self.spec.radius_m, self.rules)

    def _look(self, tick: int, peer: Peer, pose: Pose, scan: CornerScan) -> None:
        """Hold a received map against a scan, and draw the consequences."""
        assert peer.transform is not None
        peer.ground.look(peer.transform, pose, scan, self.rules)
        if peer.trial is not None:
            peer.trial.walk()
            return
        confirmed, against = peer.ground.said(self.config.hidden_after)
        share = against / max(confirmed + against, 1e-9)
        if against >= self.config.unmerge_m and share >= self.config.unmerge_share:
            figures = {"ground_confirmed_m": round(confirmed, 2), "ground_against_m": round(against, 2)}
            self._unmerge(peer, "own scans contradict it", figures)
        elif (self._hidden(peer) & ~peer.hidden).any():
            self._lay(peer)

    # proposals

    def _align_if_grown(self, tick: int, peer: Peer, own: Wireframe, pose: Pose) -> bool:
        """Align where a map has grown since the last time; true if that took the tick's time for it."""
        if peer.wireframe is None:
            return False
        if peer.status == "merged":
            due = tick - peer.updated >= self.config.refine_s * self.spec.lidar.rate_hz
            if not peer.news or not due:
                return False
            self._update(tick, peer, own)
            return True
        counts = int(own.own.sum()), int(peer.wireframe.own.sum())
        share = self.config.verification.growth if peer.status == "proposed" else peer.growth
        grown = any(
            now >= before + max(self.config.retry_corners, share * before)
            for now, before in zip(counts, peer.corners, strict=True)
        )
        if not grown or min(counts) < self.alignment.min_corners // 2:
            return peer.status == "heard" and self._align_by_sight(tick, peer, own)
        peer.corners, peer.growth, peer.news = counts, self.config.retry_growth, False
        if peer.contact is None:
            return False
        mine, theirs = self._prepared(tick, own), prepare(peer.wireframe, self.alignment)
        if not self._plausible(peer):
            self._event("attempt", peer, None, "its place is off its own map", {})
            return True
        meeting = Meeting(*peer.contact, self._reach_m - self.alignment.range_slack_m, self.spec.radius_m)
        said = align_prepared(mine, theirs, self.alignment, self.rng, meeting)
        if said.transform is not None and not self._heard_from_there(peer, np.array(said.transform)):
            said = Alignment(
                None, "impossible", said.candidates, said.inliers, said.residual, said.margin, best=said.best
            )
        if peer.status == "proposed":
            self._align_again(peer, said)
        elif said.transform is None:
            self._event("attempt", peer, said.best, said.reason, said.figures())
        else:
            peer.alignment = said
            self.propose(tick, peer.name, said.transform, own, said.figures())
        return True

    def _align_by_sight(self, tick: int, peer: Peer, own: Wireframe) -> bool:
        """Propose the frame that the sightings of a peer give, if the walls agree; true if walls were compared."""
        rule = self.config.verification
        assert peer.wireframe is not None
        if not (rule.discs and peer.seen_anew):
            return False
        peer.seen_anew = False
        seen = apart_places(peer.sightings, rule.disc_moved_m)
        turn = math.radians(self.alignment.distinct_deg)
        found = consensus(seen, rule.disc_gate_m, rule.sighting_base_m, self.alignment.distinct_m, turn)
        if found is None or found.explained < rule.sightings or found.spread_m < rule.sighting_spread_m:
            return False
        if found.explained - found.rival < rule.sightings_ahead or found.explained <= peer.seen_proposed:
            return False
        mine, theirs = self._prepared(tick, own), prepare(peer.wireframe, self.alignment)
        if mine is None or theirs is None:
            return False
        said = align_by_sight(mine, theirs, found, self.alignment, rule.least_corners)
        figures = {**said.figures(), "sightings": found.explained, "rival_sightings": found.rival}
        if said.transform is None:
            if found.explained > peer.seen_at:  # else that was said
                self._event("attempt", peer, said.best, f"sighted, {said.reason}", figures)
            peer.seen_at = found.explained
            return True
        peer.alignment, peer.seen_proposed = said, found.explained
        self.propose(tick, peer.name, said.transform, own, figures, by_sight=True)
        return True

    def _prepared(self, tick: int, own: Wireframe) -> PreparedMap | None:
        if self._mine[0] != tick:
            self._mine = tick, prepare(own, self.alignment)
        return self._mine[1]

    def _plausible(self, peer: Peer) -> bool:
        """Whether the peer is anywhere near the walls that it says it has seen."""
        assert peer.wireframe is not None
        away = distances_to_walls(np.array([peer.pose[:2]]), peer.wireframe.segments())
        return bool(away[0] <= self.config.off_map_m)

    def _heard_from_there(self, peer: Peer, transform: Floats) -> bool:
        """Whether all messages came from within the radio's range."""
        theirs = apply(transform, np.array([place[1][:2] for place in peer.places]))
        mine = np.array([place[0][:2] for place in peer.places])
        return bool((np.hypot(*(theirs - mine).T) <= self._reach_m).all())

    def propose(
        self,
        tick: int,
        name: str,
        transform: Pose,
        own: Wireframe,
        figures: Mapping[str, object],
        by_sight: bool = False,
    ) -> None:
        """Put a transform of a peer that has been heard on trial: Z = Z + proposal.

        Earlier meetings count, as the maps did not use them; by_sight: but for the two that give the transform.
        """
        peer = self.peers[name]
        assert peer.wireframe is not None
        peer.transform, peer.status = np.array(transform), "proposed"
        peer.ground = Ground()
        self._take(peer, self._fresh(peer.wireframe, peer.transform, own))
        used = 2 if by_sight else 0
        peer.trial = Verification(self.config.verification, peer.transform, peer.ground, tick, used)
        for sighting in peer.sightings:
            self._weigh_meeting(peer.trial, sighting)
        self.queue.append(name)
        self._event("proposed", peer, transform, "sighted" if by_sight else "aligned", figures)

    def _take(self, peer: Peer, fresh: Bools | None = None) -> None:
        """Hold own scans against the peer's newest map from now on."""
        assert peer.wireframe is not None
        peer.taken, peer.taken_tick = peer.wireframe, peer.map_tick
        peer.ground.lay(peer.taken, fresh)

    def _fresh(self, theirs: Wireframe, transform: Floats, own: Wireframe) -> Bools:
        """(k,) pieces of a received map that lie on no own wall, so that no alignment has used them."""
        pieces, _ = pieces_of(theirs)
        mine, _ = pieces_of(own)
        places = apply(transform, pieces[:, :2])
        c, s = math.cos(transform[2]), math.sin(transform[2])
        ways = pieces[:, 2:] @ np.array([[c, s], [-s, c]])
        fresh = np.ones(len(pieces), np.bool_)
        for low in range(0, len(pieces), 500):
            part = slice(low, low + 500)
            gap = np.abs(places[part, None] - mine[None, :, :2]).max(2)
            alike = ways[part] @ mine[:, 2:].T > 0.9
            fresh[part] = ~((gap < 2.0 * self.rules.margin) & alike).any(1)
        return fresh

    def _align_again(self, peer: Peer, said: Alignment) -> None:
        """A proposal's pair was aligned anew with later maps."""
        assert peer.trial is not None and peer.transform is not None and peer.wireframe is not None
        centre = peer.wireframe.points.mean(0)
        limits = self.alignment.distinct_m, math.radians(self.alignment.distinct_deg)
        best = None if said.best is None else np.array(said.best)
        same = best is not None and not apart(best, peer.transform, centre, *limits)
        if said.transform is not None:
            peer.trial.align_again(same)
            if same:
                peer.transform = peer.trial.transform = np.array(said.transform)
                peer.alignment = said
        elif said.reason in ("conflict", "impossible") and same:
            peer.trial.align_again(False)
        if same and said.reason not in ("conflict", "impossible"):
            self._take(peer)

    # the drive

    def _pursue(self, tick: int, own: Wireframe, pose: Pose, errand: ErrandEnd | None) -> None:
        """Go on with the first proposal of the queue, and decide those whose evidence suffices."""
        for name in list(self.queue):
            peer = self.peers[name]
            assert peer.trial is not None
            if peer.trial.verdict is not None:
                if peer.trial.verdict and not self._walls_fit(tick, peer, own):
                    self._decide(tick, peer, False, "its walls do not fit")
                else:
                    self._decide(tick, peer, peer.trial.verdict, "the evidence decides")
        if not self.queue:
            self._goal = None
            return
        peer = self.peers[self.queue[0]]
        assert peer.trial is not None and peer.contact is not None
        if self._goal is None:
            self._goal = apply(peer.trial.transform, np.array([peer.contact[1][:2]]))[0]
            self._set_out, self._detours = tick, 0
            return
        if tick - self._set_out > self.config.verification.time_out_s * self.spec.lidar.rate_hz:
            self._decide(tick, peer, False, "it took too long")
        elif errand is ErrandEnd.FAILED and not self._detours:
            self._decide(tick, peer, False, "unreachable")
        elif errand:
            place = self._elsewhere(tick, peer, pose)
            if place is None or self._detours >= self.config.verification.detours:
                self._decide(tick, peer, False, "undecided")
            else:
                self._goal, self._detours = place, self._detours + 1

    def _walls_fit(self, tick: int, peer: Peer, own: Wireframe) -> bool:
        """Whether the newest maps still agree under a transform: no evidence for it, but it must not fail."""
        assert peer.trial is not None and peer.wireframe is not None
        mine, theirs = self._prepared(tick, own), prepare(peer.wireframe, self.alignment)
        if mine is None or theirs is None or mine.walls is None or theirs.walls is None:
            return False
        t = peer.trial.transform
        fit = refine(t[None], mine.corners, theirs.corners, self.alignment)
        limits = self.alignment.coarse_m, math.radians(self.alignment.distinct_deg)
        if not len(fit.transforms) or fit.inliers[0] < self.config.verification.least_corners:
            return False
        if apart(fit.transforms[0], t, theirs.corners.centre, *limits):
            return False
        agreed, conflict = agreement(mine.walls, theirs.walls, t, self.alignment)
        return agreed >= self.alignment.min_score_m and conflict <= self.alignment.max_conflict * agreed

    def _elsewhere(self, tick: int, peer: Peer, pose: Pose) -> Floats | None:
        """(2,) where to look next: in turns at the peer itself, if it is still heard, and at what only it has seen."""
        assert peer.trial is not None
        unseen = peer.ground.unseen()
        heard = tick - peer.pose_tick <= self.config.verification.still_heard_s * self.spec.lidar.rate_hz
        if heard and (self._detours % 2 == 0 or not len(unseen)):
            there: Floats = apply(peer.trial.transform, np.array([peer.pose[:2]]))[0]
            return there
        if not len(unseen):
            return None
        stands = unseen[:, :2] + IN_FRONT_M * np.column_stack([-unseen[:, 3], unseen[:, 2]])
        stands = apply(peer.trial.transform, stands)
        away = np.hypot(stands[:, 0] - pose[0], stands[:, 1] - pose[1])
        away[away < self.config.verification.near_m] = np.inf
        nearest: Floats = stands[int(away.argmin())]
        return nearest if np.isfinite(away.min()) else None

    def _decide(self, tick: int, peer: Peer, accepted: bool, reason: str) -> None:
        """Take a proposal out of the queue: Z = Z - proposal, and T = T + transform if it is accepted."""
        assert peer.trial is not None
        if self.queue[0] == peer.name:
            self._goal = None
        self.queue.remove(peer.name)
        figures, transform = peer.trial.figures(), _pose(peer.trial.transform)
        peer.trial = None
        if accepted:
            self._event("accepted", peer, transform, reason, figures)
            self.merge(tick, peer)
        else:
            self._forget(peer)
            self._event("rejected", peer, transform, reason, figures)

    # the merged map

    def merge(self, tick: int, peer: Peer) -> None:
        """Make a peer's map part of the robot's under its transform."""
        peer.status, peer.news, peer.updated = "merged", True, tick
        peer.refused, peer.agreed_m, peer.merged_since = 0, 0.0, tick
        self._lay(peer)

    def _lay(self, peer: Peer) -> None:
        assert peer.taken is not None and peer.transform is not None
        peer.hidden = self._hidden(peer)
        peer.layer = layer_of(peer.taken, peer.transform, peer.hidden, self.config.merge_hits_per_m)
        peer.merged_tick = peer.taken_tick
        self.changed = True

    def _gather_views(self) -> None:
        """Viewpoints of merged peers, but those whose map is not merged yet: it may hold what was seen from there."""
        found = [self.viewpoints[:0]]
        for _, peer in sorted(self.peers.items()):
            if peer.layer is not None and peer.transform is not None and self.config.division:
                found.append(apply(peer.transform, peer.seen.points[peer.seen.need <= peer.merged_tick]))
        self.viewpoints = np.vstack(found)

    def _hidden(self, peer: Peer) -> Bools:
        """(m,) walls of its merged map that own scans have seen through."""
        assert peer.taken is not None
        return peer.ground.hidden(self.config.hidden_after, len(peer.taken.edges))

    def _update(self, tick: int, peer: Peer, own: Wireframe) -> None:
        """Take a later map of a merged peer, and refine its transform; refuse one that contradicts."""
        assert peer.wireframe is not None and peer.transform is not None
        peer.news, peer.updated = False, tick
        mine, theirs = self._prepared(tick, own), prepare(peer.wireframe, self.alignment)
        if mine is None or theirs is None or mine.walls is None or theirs.walls is None:
            return
        found = refine(peer.transform[None], mine.corners, theirs.corners, self.alignment)
        new = peer.transform
        if len(found.transforms) and found.inliers[0] >= self.alignment.min_inliers:
            new = found.transforms[0]
            if apart(new, peer.transform, theirs.corners.centre, self.alignment.coarse_m, math.radians(5.0)):
                new = peer.transform
        agreed, conflict = agreement(mine.walls, theirs.walls, new, self.alignment)
        if conflict > self.alignment.max_conflict * agreed or agreed < 0.6 * peer.agreed_m:
            peer.refused += 1
            if peer.refused >= self.config.refused_maps:
                figures: Mapping[str, object] = {"agreement": round(agreed, 2), "conflict": round(conflict, 2)}
                self._unmerge(peer, "its later maps contradict it", figures)
            return
        peer.refused, peer.transform, peer.agreed_m = 0, new, agreed
        self._take(peer)
        self._lay(peer)

    def _unmerge(self, peer: Peer, reason: str, figures: Mapping[str, object]) -> None:
        """Take a peer's map out again, and forget its transform."""
        assert peer.transform is not None
        transform = _pose(peer.transform)
        self._forget(peer)
        peer.layer, peer.merged_tick = None, -1
        self.changed = True
        self._event("unmerged", peer, transform, reason, figures)

    def _forget(self, peer: Peer) -> None:
        peer.status, peer.transform, peer.growth = "heard", None, self.config.rejected_growth
        peer.ground, peer.trial, peer.alignment = Ground(), None, None

    def _event(
        self, event: str, peer: Peer, transform: Pose | None, reason: str, figures: Mapping[str, object]
    ) -> None:
        data: dict[str, object] = {"peer": peer.name, "reason": reason, **_rounded(figures)}
        if transform is not None:
            data["transform"] = [round(value, 5) for value in transform]
        self._events.append(Event(event=event, data=data))


def _pose(transform: Floats) -> Pose:
    x, y, theta = transform.tolist()
    return x, y, theta


def _rounded(figures: Mapping[str, object]) -> dict[str, object]:
    return {key: round(value, 4) if isinstance(value, float) else value for key, value in figures.items()}
