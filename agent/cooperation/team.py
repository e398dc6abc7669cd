"""Trust, but verify: the proposals Z and the transforms T of Algorithm 1, from the first message to the merged map.

A peer is heard, then proposed (an alignment is on trial while the robot drives to where the peer was), then merged, or
given up. One pair of maps is aligned in a tick, and only where one of them has grown; the others wait their turn.
"""

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from agent.alignment.align import Alignment
from agent.alignment.by_sight import Sighting
from agent.alignment.config import AlignmentConfig
from agent.communication.exchange import NOBODY, News
from agent.cooperation import thirds
from agent.cooperation.config import CooperationConfig
from agent.cooperation.evidence import WALL_MARGIN_M, WallEvidence
from agent.cooperation.merging import (
    REFUSED_MAPS,
    REJECTED_GROWTH,
    contradiction,
    doubted,
    hide_seen_through,
    merge,
    moved,
    refit,
    update,
)
from agent.cooperation.peer import KNOWN_S, Figures, Merged, Peer, PeerLog, Peers, Proposed, Unaligned, transform_sd_m
from agent.cooperation.peer_places import PeerPlaces
from agent.cooperation.proposal_queue import ProposalQueue
from agent.cooperation.proposing import GROWTH_ON_TRIAL, Aligner, off_its_map
from agent.cooperation.team_views import TeamViews
from agent.cooperation.verification import Trial, nats_of_thirds
from agent.cooperation.weight import weigh
from agent.corner_scan import CornerScan
from agent.errand import Errand
from agent.mapping.submaps.settled import Settled
from agent.mapping.views import View, view_of
from agent.period import Period, in_ticks
from protocol.arrays import Floats
from protocol.geometry import Pose, apply, pose_of
from protocol.messages import Event, RobotSpec
from protocol.talk import Beacon
from protocol.wireframe import Wireframe

LOOK_S = 0.6
"""Interval at which received maps are held against a scan: the robot drives 0.13 m in the time."""
CIRCLES_S = 3.0
"""Interval at which circles of three are closed: what others say of frames comes with their beacons."""
LATE_S = 0.4
"""A place in a message is held against a scan at most so much later or earlier: the peer drives 0.1 m in the time."""
RECALL_S = 3.0
"""Scans are kept for so long, for messages that come late: a mesh of radios or a satellite takes a second or two."""
REFINE_S = 4.0
"""Least interval between two fits of a merged peer's transform."""
ALONE_S = 20.0
"""Who was not heard for so long is not in view, as who is in view sends a beacon every 5 s."""
REST_S, RESTS = 30.0, (0, 0, 0, 0, 1, 3, 7, 15)
"""Where one, two, ... proposals of a peer were rejected since it was last merged, a restart or a jump brings no new one
for so many times so long: a hostile peer that began anew again and again kept a robot driving."""
EMPTY_LOOKS = 4
"""Looks in a row at free floor where a merged teammate must be before the merge is undone: one in ten misses it."""


class PastScan(NamedTuple):
    """A scan, and from where."""

    tick: int
    here: Pose
    """The robot in its own frame."""
    discs: Floats
    """(d, 2) metres, the robot's own frame."""
    scan: CornerScan


class Team:
    """What one robot knows of all others, and makes of their maps."""

    def __init__(
        self, config: CooperationConfig, alignment: AlignmentConfig, spec: RobotSpec, rng: np.random.Generator
    ) -> None:
        """rng: for alignment methods that draw."""
        self.config, self.spec = config, spec
        self.aligner = Aligner(alignment, spec, rng)
        self.peers = Peers()
        self._aligned = ""  # the peer whose map was aligned last
        self.places = PeerPlaces(self.peers, spec, config)
        self.queue = ProposalQueue(config.verification.time_out_s, spec.lidar.rate_hz)
        """Z."""
        self.changed = False
        """Whether a layer of the map has changed in this tick."""
        self.views = TeamViews()
        """From where merged peers saw what is in their merged maps."""
        self._views_changed = False
        self._lately = deque[PastScan](maxlen=self._ticks(RECALL_S))
        """Of the last ticks, the newest last."""
        self._heard: dict[str, int] = {}
        """The last two names heard, and when: two within ALONE_S mean that nobody was met alone."""
        self._looks, self._circles = Period(self._ticks(LOOK_S)), Period(self._ticks(CIRCLES_S))
        self.events: list[Event] = []
        """What happened in this tick."""

    @property
    def merged(self) -> list[Merged]:
        """Peers whose maps are part of the robot's, by name."""
        return self.peers.merged

    @property
    def errand(self) -> Errand | None:
        """The drive to verify the first proposal of the queue; None without proposal."""
        return self.queue.errand

    @property
    def proposed(self) -> list[Proposed]:
        """Peers with a transform on trial: those of the queue, and those that wait to be seen."""
        return [peer for peer in self.peers.values() if isinstance(peer, Proposed)]

    @property
    def merged_ticks(self) -> dict[str, int]:
        """Peers whose maps are part of the robot's, and when those maps were so."""
        return self.peers.merged_ticks

    @property
    def frames(self) -> Mapping[str, Pose]:
        """Where the frames of merged peers lie in the robot's own, as far as they are told to others."""
        return self.peers.frames if self.config.division else NOBODY

    @property
    def asks_for_views(self) -> bool:
        """Whether viewpoints of peers are of use."""
        return self.config.sharing and self.config.division

    def _ticks(self, seconds: float) -> int:
        return in_ticks(seconds, self.spec.lidar.rate_hz)

    def hear(
        self, tick: int, told: Sequence[News], here: Pose, scan: CornerScan, own: Wireframe, senders: Iterable[str]
    ) -> None:
        """Note what peers told, and hold proposals and merged maps against it and a scan made at `here`, own frame.

        Maps that are far larger than the own one wait.
        senders: all that were heard in this tick; of some nothing may be read, as they speak another version.
        """
        self.events, self.changed, self._views_changed = [], False, False
        self._lately.append(PastScan(tick, here, apply(here, scan.discs), scan))
        alone = self._hears_one(tick, senders)
        for news in told:
            log = self.peers.setdefault(news.peer, Unaligned(PeerLog(news.peer))).log
            log.take_contact(tick, news.since, self._ticks(KNOWN_S))
            if news.anew is not None:
                self._begin_anew(tick, log, news.anew)
            if (beacon := news.beacon) is not None:
                self._take_beacon(tick, log, news.since, beacon, alone)
            self._take_word(tick, log, news)
        self._take_maps(own)
        if self._looks.take_due(tick):
            for proposed in self.proposed:
                self._ask_thirds(proposed)
            if self.config.verification.ground:
                view = view_of(scan, here, WALL_MARGIN_M)
                for peer in self.peers.values():
                    self._look(peer, view, own)

    def mend(self, settled: Settled) -> None:
        """The robot's map was torn and is merged anew: peers' frames move as it did where each was last heard.

        To be called before `hear`.
        """
        self._lately.clear()
        first = self.queue.proposals[0] if self.queue.proposals else None
        for name, peer in list(self.peers.items()):
            by, met = settled.at(peer.log.pose_tick), peer.log.first_encounter
            peer.log.move(settled.at(peer.log.met))
            if isinstance(peer, Merged):
                self.peers[name] = moved(peer, by)
            elif isinstance(peer, Proposed):
                peer.trial.move(by)
                if peer.waits_since is met:  # a contact that moves along is no other one
                    peer.waits_since = peer.log.first_encounter
                if peer is first and self.errand is not None:
                    self.errand.place = apply(by, self.errand.place[None])[0]
        self.views.mend()
        self.views.gather(self.merged if self.config.division else [])

    def _begin_anew(self, tick: int, log: PeerLog, since: int) -> None:
        """A peer was started anew: what is on trial ends, and its next map decides on a merge. since: as of the log.

        A jump of its place alone may come of a loop that it has closed.
        """
        log.begin_anew(since)
        log.align_anew()
        log.began_anew = True
        peer = self.peers[log.name]
        if isinstance(peer, Proposed):
            self._reject(tick, peer, "it was started anew")
        elif isinstance(peer, Merged):
            self._replace(peer, doubted(peer, tick))

    def _take_beacon(self, tick: int, log: PeerLog, since: int, beacon: Beacon, alone: bool) -> None:
        """Keep where a peer says that it was, if that is new; it is a sighting where a scan of then is known."""
        pose_tick = min(beacon.tick, tick)  # nobody is ahead of time
        if pose_tick <= log.pose_tick:
            return
        past = self._scan_of(beacon.tick)
        _, here, discs, scan = past or self._lately[-1]
        sighting = Sighting(here, beacon.pose, discs, scan, alone)
        log.take_beacon(since, pose_tick, sighting, self.spec.max_speed_mps / self.spec.lidar.rate_hz)
        if past is None:
            return
        log.take_sighting(sighting)
        peer = self.peers[log.name]
        if isinstance(peer, Proposed):
            self._weigh(peer.trial, sighting)
        elif isinstance(peer, Merged) and self.config.verification.discs:
            self._watch(peer, sighting)

    def _scan_of(self, tick: int) -> PastScan | None:
        """The newest scan if that is of about a tick, else the first one from then on; None where none is kept."""
        newest, late = self._lately[-1], self._ticks(LATE_S)
        if abs(newest.tick - tick) <= late:
            return newest
        return next((past for past in self._lately if 0 <= past.tick - tick <= late), None)

    def _take_word(self, tick: int, log: PeerLog, news: News) -> None:
        """Keep what a peer says of frames, its map, which then waits, and its viewpoints."""
        if news.frame is not None:
            log.take_frame(tick, news.frame)
        log.take_frames(news.others)
        if news.map is not None:
            log.offer_map(news.map)
        if news.views is not None:
            log.views, self._views_changed = news.views, True

    def _take_maps(self, own: Wireframe) -> None:
        """Take those of the maps that wait which are not too large."""
        waiting = [peer for peer in self.peers.values() if peer.log.waiting is not None]
        if not waiting:
            return
        mine = weigh(own)
        for peer in waiting:
            others = (other.log.weight for other in self.merged if other is not peer)
            if peer.log.take_map([mine, *others]):
                self._say("attempt", peer.log, "a map that is too large for what was seen waits", None, {})

    def _hears_one(self, tick: int, senders: Iterable[str]) -> bool:
        """Whether one robot alone was heard for a while, by a radio that reaches as far as the lidar."""
        lately = self._heard | dict.fromkeys(senders, tick)
        self._heard = dict(sorted(lately.items(), key=lambda one: one[1])[-2:])
        heard = [name for name, last in self._heard.items() if tick - last <= self._ticks(ALONE_S)]
        return len(heard) == 1 and self.aligner.range_m >= self.spec.lidar.range_max_m

    def _weigh(self, trial: Trial, sighting: Sighting) -> None:
        trial.weigh(sighting, self.aligner.reach_m, self.spec.radius_m)

    def _ask_thirds(self, peer: Proposed) -> None:
        peer.trial.ask_thirds(thirds.balance(peer, self.merged))

    def _watch(self, peer: Merged, sighting: Sighting) -> None:
        """Undo a merge whose teammate is not where it must be: the walls of a building may agree after a half turn."""
        here, theirs, scan = sighting.here, sighting.theirs, sighting.scan
        peer.watch.look(peer.transform, here, theirs, scan, sighting.discs, self.spec.radius_m)
        if peer.watch.missed >= EMPTY_LOOKS:
            self.undo(peer, "its place is empty", {"discs_missed": peer.watch.missed})

    def _look(self, peer: Peer, view: View, own: Wireframe) -> None:
        """Hold a received map against a scan, and draw the consequences for a merged one."""
        if isinstance(peer, Proposed):
            peer.trial.look_at_walls(view)
        elif isinstance(peer, Merged):
            peer.walls.look(peer.transform, view)
            if not peer.walls.take_doubt():
                return
            if figures := contradiction(peer):
                if peer.map is peer.log.map:  # else a newer one may bring another transform
                    self.aligner.take_growth(peer.log, own)  # these maps and sightings would bring the same one back
                self.undo(peer, "own scans contradict it", figures)
            else:
                self._replace(peer, hide_seen_through(peer))

    def _replace(self, peer: Merged, new: Merged) -> None:
        self.peers[peer.log.name] = new
        self.changed |= new.laid is not peer.laid

    # Z = Z + align_maps(C)

    def align_maps(self, tick: int, own: Wireframe) -> None:
        """Align the map of own scans with that of one peer for which that is due, in turn after the last one.

        Where odometry errs each of 20 merged peers is due every 20 ticks: a 21st would never be aligned before them.
        """
        names = list(self.peers)
        after = names.index(self._aligned) + 1 if self._aligned in self.peers else 0
        for name in names[after:] + names[:after]:
            if self._align(tick, self.peers[name], own):
                self._aligned = name
                break
        if self.changed or self._views_changed:
            self.views.gather(self.merged if self.config.division else [])

    def _align(self, tick: int, peer: Peer, own: Wireframe) -> bool:
        """Propose a transform, weigh later maps of a proposal, or refine a merged map; false where nothing is due."""
        log = peer.log
        if log.map is None:
            return False
        if isinstance(peer, Merged):
            own_moves = self.spec.odometry.noisy  # else own walls stay where they are
            map_is_news = log.map_is_news and not log.map_is_old
            if tick - peer.updated < self._ticks(REFINE_S) or not (map_is_news or own_moves):
                return False
            if map_is_news:
                self._update(tick, peer, own)
            else:
                self._replace(peer, refit(peer, tick, own))
            return True
        rests = isinstance(peer, Unaligned) and log.begins and tick < log.rests_until
        if rests or not log.has_place:
            return False
        if isinstance(peer, Unaligned) and self._align_by_word(peer, own):
            return True
        growth = log.growth if isinstance(peer, Unaligned) else GROWTH_ON_TRIAL
        if not self.aligner.has_grown(log, own, growth) or self._is_off_its_map(log):
            return isinstance(peer, Unaligned) and self._align_by_sight(peer, own)
        self.aligner.take_growth(log, own)
        said = self.aligner.align(log, own)
        if isinstance(peer, Proposed):
            self.aligner.compare(peer, own, said)
        elif said.transform is None:
            self._say("attempt", log, said.reason, said.best, said.figures())
            log.sighting_is_news = len(log.sightings) > 0  # the walls that both have may tell now
        else:
            self.propose(peer, said.transform, own, said.figures(), said)
        return True

    def _is_off_its_map(self, log: PeerLog) -> bool:
        """Whether a peer is where its own map has nothing. That is said once, until it is back."""
        was_off, log.is_off_map = log.is_off_map, off_its_map(log, self.spec.lidar.range_max_m)
        if log.is_off_map and not was_off:
            self._say("attempt", log, "its place is off its own map", None, {})
        return log.is_off_map

    def _update(self, tick: int, peer: Merged, own: Wireframe) -> None:
        """Take the newest map of a merged peer and fit its transform anew, or undo the merge."""
        new, figures = update(peer, tick, own, self.aligner.both(peer.log, own), self.aligner.config)
        self._replace(peer, new)
        if new.refused >= REFUSED_MAPS:
            self.undo(new, "its later maps contradict it", figures)

    def conclude(self, tick: int, own: Wireframe) -> None:
        """Weigh the last maps for all proposals that have grown by some walls at all, as none will come after them.

        Transforms of merged peers are fitted anew: the own map may have closed a loop since the last map was heard.
        """
        reach_m = self.spec.lidar.range_max_m
        for peer in self.proposed:
            if self.aligner.has_grown(peer.log, own, 0.0) and not off_its_map(peer.log, reach_m):
                self.aligner.take_growth(peer.log, own)
                self.aligner.compare(peer, own, self.aligner.align(peer.log, own))
        self._decide(tick, own)
        for merged in self.merged:
            self._take_last(tick, merged, own)

    def _take_last(self, tick: int, peer: Merged, own: Wireframe) -> None:
        """Take the last map of a merged peer, by an alignment where the transform does not fit, or else undo the merge.

        A loop may have moved the walls of either; a fit finds those that are 0.2 m off at most.
        """
        maps, config = self.aligner.both(peer.log, own), self.aligner.config
        new, figures = update(peer, tick, own, maps, config)
        if new.refused > peer.refused and peer.log.first_encounter is not None:
            said = self.aligner.align(peer.log, own)
            if said.transform is not None:
                fit = peer.fit._replace(transform=np.array(said.transform))
                new, figures = update(replace(peer, fit=fit), tick, own, maps, config)
        self._replace(peer, new)
        if new.refused > peer.refused:
            self.undo(new, "its last map contradicts it", figures)

    def _align_by_word(self, peer: Unaligned, own: Wireframe) -> bool:
        """Propose what the peer itself says, or thirds; true where walls were compared."""
        told = self._align_as_told(peer, own)
        return told or (self.config.verification.thirds and self._align_by_thirds(peer, own))

    def _align_as_told(self, peer: Unaligned, own: Wireframe) -> bool:
        """Propose what a peer that has merged the robot's map says itself, if the walls agree; true if compared."""
        said = self.aligner.align_as_told(peer.log, own)
        if said is None:
            return False
        if said.transform is not None:
            self.propose(peer, said.transform, own, said.figures(), said, how="told")
        elif said.reason != peer.log.claim_reason:
            self._say("attempt", peer.log, f"told, {said.reason}", said.best, said.figures())
        peer.log.claim_reason = said.reason
        return True

    def _align_by_thirds(self, peer: Unaligned, own: Wireframe) -> bool:
        """Propose the frame on which most merged peers agree, if their word suffices or the walls agree.

        Their word may be of the frame before of a peer that was started anew: there walls must agree.
        """
        log = peer.log
        assert log.map is not None
        said = thirds.words(peer, self.merged)
        if log.map is log.thirds_map and thirds.are_same(said, log.thirds_said):
            return False
        log.thirds_map, log.thirds_said = log.map, said
        found = thirds.best(thirds.claims(said), log.map.wireframe)
        if found is None or found.agree <= log.thirds_on_trial or log.thirds_tried == (found.agree, log.map.tick):
            return False
        log.thirds_tried = found.agree, log.map.tick
        near = self.aligner.align_near(log, own, found.transform)
        if near is None:
            return False
        suffices = not log.began_anew and nats_of_thirds(found.agree) >= self.config.verification.accept
        if near.transform is not None or suffices:
            log.thirds_on_trial = found.agree
            transform = near.transform or pose_of(found.transform)
            self.propose(peer, transform, own, {**near.figures(), "thirds": found.agree}, near, how="told by thirds")
        return True

    def _align_by_sight(self, peer: Unaligned, own: Wireframe) -> bool:
        """Propose the frame that the sightings of a peer give, if the walls agree; true where walls were compared."""
        log, found = peer.log, self.aligner.align_by_sight(peer.log, own)
        if found is None:
            return False
        seen, said = found
        figures = {**said.figures(), "sightings": seen.explained, "rival_sightings": seen.rival}
        if said.transform is not None:
            log.explained_by_proposal = seen.explained
            self.propose(peer, said.transform, own, figures, said, how="sighted")
            return True
        if seen.explained > log.explained:  # else that was said
            self._say("attempt", log, f"sighted, {said.reason}", said.best, figures)
        log.explained = seen.explained
        return True

    def propose(
        self, peer: Unaligned, transform: Pose, own: Wireframe, figures: Figures,
        alignment: Alignment | None = None, how: str = "aligned",
    ) -> Proposed:  # fmt: skip
        """Z = Z + proposal: put a transform of a peer whose map is known on trial.

        Earlier sightings count as evidence. Two of them give the transform in an alignment by sight, and may have given
        it to the peer that told it: these do not count. how: what the event says of it, `aligned`, `sighted`, `told` or
        `told by thirds`, or `on trial again`.
        """
        log, t, walls = peer.log, np.array(transform), WallEvidence()
        assert log.map is not None
        walls.lay(log.map.wireframe, t, own)
        trial = Trial(self.config.verification, t, walls, 0 if how == "aligned" else 2)
        for sighting in log.sightings:
            self._weigh(trial, sighting)
        proposed = self.peers[log.name] = Proposed(log, log.map, trial, transform_sd_m(alignment))
        log.begins = False
        self._ask_thirds(proposed)
        self.queue.add(proposed)
        self._say("proposed", log, how, transform, figures)
        return proposed

    # accept = judge(proposal)

    def judge(self, tick: int, own: Wireframe, pose: Pose) -> None:
        """Decide the proposals whose evidence suffices, and where to drive for the first of the others.

        Where only a sighting of the peer can decide, and it has gone, the proposal waits for the next contact with it,
        without a further drive, and what was seen is not lost.
        pose: the robot's, in its own frame.
        """
        self._decide(tick, own)
        if self._circles.take_due(tick) and self.config.verification.thirds:
            self._close_circles(own)
        for peer in self.proposed:
            if peer.waits_since is not None and peer.waits_since is not peer.log.first_encounter:
                peer.waits_since = None
                self.queue.add(peer)
        if ended := self.queue.set_out(tick, pose):
            self._end_drive(tick, *ended)

    def _decide(self, tick: int, own: Wireframe) -> None:
        """Accept and reject the proposals whose evidence suffices."""
        for peer in self.proposed:
            verdict, spare = peer.trial.verdict, peer.trial.weight - self.config.verification.accept
            must_overlap = peer.log.began_anew or not peer.trial.thirds_suffice
            if verdict and not self.aligner.walls_agree(peer.log, own, peer.transform, must_overlap, spare):
                self._reject(tick, peer, "its walls do not fit")
            elif verdict:
                merged = self.merge(peer, tick, own)
                self._say("accepted", peer.log, "the evidence decides", merged.transform, peer.trial.figures())
            elif verdict is not None:
                self._reject(tick, peer, "the evidence decides")

    def _close_circles(self, own: Wireframe) -> None:
        """Put the weakest link on trial again where circles of three do not close: each link once, till more are open.

        The weakest is the one in most of them, and of these the one with the least wall in common. Of a peer that was
        started anew its next map decides.
        """
        merged = self.merged
        opened = [(thirds.balance(peer, merged), peer.agreed_m, peer) for peer in merged if peer.log.has_place]
        opened = [link for link in opened if link[0] < -link[2].log.circles_open]
        if not opened:
            return
        balance, _, peer = min(opened, key=lambda link: link[:2])
        figures = {"circles_open": -balance}
        self.undo(peer, "a circle by way of others does not close", figures)
        peer.log.circles_open = -balance
        self.propose(Unaligned(peer.log), pose_of(peer.transform), own, figures, how="on trial again")

    def _end_drive(self, tick: int, peer: Proposed, reason: str) -> None:
        """A drive has decided nothing: the proposal waits for a sighting, if nothing else can decide, or ends."""
        if peer.trial.asks_for_a_sighting:
            self.queue.remove(peer)
            peer.waits_since = peer.log.first_encounter
        else:
            self._reject(tick, peer, reason)

    def _reject(self, tick: int, peer: Proposed, reason: str) -> None:
        self.queue.remove(peer)
        self._forget_transform(peer)
        peer.log.rejections += 1
        peer.log.rests_until = tick + self._ticks(REST_S) * RESTS[min(peer.log.rejections, len(RESTS)) - 1]
        self._say("rejected", peer.log, reason, peer.transform, peer.trial.figures())

    def _forget_transform(self, peer: Proposed | Merged) -> None:
        peer.log.growth = REJECTED_GROWTH
        self.peers[peer.log.name] = Unaligned(peer.log)

    def merge(self, peer: Proposed, tick: int, own: Wireframe) -> Merged:
        """Make the map of a peer of the queue part of the robot's: T = T + transform, fitted on all walls."""
        self.queue.remove(peer)
        merged = self.peers[peer.log.name] = merge(peer, tick, own)
        peer.log.rejections = peer.log.rests_until = 0
        self.changed = True
        return merged

    def undo(self, peer: Merged, reason: str, figures: Figures) -> None:
        """Take a peer's map out again, and forget its transform."""
        self._forget_transform(peer)
        self.changed = True
        self._say("unmerged", peer.log, reason, peer.transform, figures)

    def _say(self, event: str, log: PeerLog, reason: str, transform: Floats | Pose | None, figures: Figures) -> None:
        """Note a line of events.jsonl on a peer; numbers are rounded."""
        rounded = {key: round(value, 4) if isinstance(value, float) else value for key, value in figures.items()}
        data: dict[str, object] = {"peer": log.name, "reason": reason, **rounded}
        if transform is not None:
            data["transform"] = [round(float(value), 5) for value in transform]
        self.events.append(Event(event=event, data=data))
