"""Another robot: unaligned, proposed or merged, and in each of these states a log of what it told."""

import math
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, MutableMapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from agent.alignment.align import Alignment
from agent.alignment.by_sight import Sighting
from agent.alignment.encounter import Encounter
from agent.communication.receiving import PeerViews, ReceivedMap
from agent.cooperation.evidence import WallEvidence
from agent.cooperation.verification import DISC_MOVED_M, Trial, Watch
from agent.cooperation.wall_fit import WallFit
from agent.cooperation.weight import NO_WEIGHT, Weight, is_too_large, weigh
from agent.geometry.transform import DISTINCT_M, DISTINCT_RAD, apart, inverse
from agent.mapping.layers import Layer
from protocol.arrays import Bools, Floats
from protocol.geometry import Pose, compose, pose_of
from protocol.messages import MAX_ROBOTS

ENCOUNTERS_KEPT = 60
"""Messages of a contact of which both places are kept, and sightings: five minutes of beacons, or one of those in
sight."""


MOST_SPEED = 1.5
"""Times a robot's top speed: who seems to have driven faster was started anew, in another frame. A smaller jump is one
by which its map corrected its pose."""
KNOWN_S = 16.0
"""Who has merged the robot's map says so in the first two periods of beacons of its own contact, of 5 s at most. The
robot's may begin later, where it alone heard nothing for a while. Then that word comes later, too; what the peer told
of frames holds until it is taken back."""
GIVEN_SD_M, LEAST_CORNER_SD_M = 0.1, 0.01
"""Standard error of a transform that no alignment gave, and least one of a corner in it: that of a range."""


@dataclass
class PeerLog:
    """What a peer told so far, and what alignment made of it. Poses, maps and viewpoints are in the peer's frame."""

    name: str
    map: ReceivedMap | None = None
    """Its newest map."""
    weight: Weight = NO_WEIGHT
    """Of that map."""
    waiting: ReceivedMap | None = None
    """A newer one that was not taken yet."""
    waiting_weight: Weight = NO_WEIGHT
    """Of the one that waits."""
    waits: bool = False
    """Whether it is too large to be taken, and that was said."""
    map_is_news: bool = False
    """Whether this map was neither aligned nor merged yet."""
    map_is_old: bool = False
    """Whether the peer was started anew since it told this map: its places are in another frame."""
    began_anew: bool = False
    """Whether it ever said that it was started anew: what thirds say of it may be of its frame before."""
    views: PeerViews = field(default_factory=PeerViews)
    pose: Pose = (0.0, 0.0, 0.0)
    """Where it was last heard to be."""
    pose_tick: int = -1
    """When it was there; -1: never heard."""
    placed: tuple[Floats, Pose, Pose] | None = None
    """Its frame in the robot's own and its pose, and where both put it, when that was last asked; see `place`."""
    met: int = -1
    """When the last contact with it began."""
    encounters: list[Encounter] = field(default_factory=list)
    """At messages of this contact, the first ones."""
    sightings: deque[Sighting] = field(default_factory=lambda: deque(maxlen=ENCOUNTERS_KEPT))
    """What was seen at messages, each after one of the two had moved; the newest ones."""
    sighting_is_news: bool = False
    """Whether the newest sighting was not used for an alignment yet."""
    aligned_walls: tuple[int, int] = (0, 0)
    """Walls that the owners saw themselves, of the own map and of the peer's, at the last alignment."""
    growth: float = 0.0
    """Share of them that one map must gain before the next alignment."""
    begins: bool = False
    """Whether it was started anew, or its place jumped, and nothing was aligned or proposed since."""
    jumped_with: ReceivedMap | None = None
    """Its map at the last jump of its place: this very one is not aligned for another jump."""
    rejections: int = 0
    """Proposals that were rejected since it was last merged."""
    rests_until: int = 0
    """Tick before which nothing is proposed if it is started anew, as many were."""
    is_off_map: bool = False
    """Whether it was far from all walls of its own map when an alignment was last due."""
    explained: int = 0
    """Sightings that the last alignment by sight explained."""
    explained_by_proposal: int = 0
    """The same of the last proposal by sight: another one must explain more."""

    knows_me: bool = False
    """Whether it has said where the robot's own frame lies, and not gone back on it: it has merged the robot's map."""
    knew_me: int = -1
    """When it last said so."""
    claim: Floats | None = None
    """(3,) its frame in the robot's own by its own word, which it gives where it has merged the robot's map."""
    tried_claim: Floats | None = None
    """The claim that was put on trial: it is not tried again."""
    claim_reason: str = ""
    """Why the last claim was not proposed."""

    frames: dict[str, Floats] = field(default_factory=dict)
    """(3,) the frames of others that it has merged, in its own, by its word."""
    thirds_said: list[tuple[Floats, Floats]] = field(default_factory=list)
    """Words of thirds when they were last counted, and `thirds_map` its map then: the same count for nothing more."""
    thirds_map: ReceivedMap | None = None
    balanced: tuple[list[tuple[Floats, Floats]], int] | None = None
    """What thirds say against what it says itself, when that was last weighed, and the balance."""
    thirds_tried: tuple[int, int] | None = None
    """How many thirds agreed, and the peer's map, when their word was last held against the walls."""
    thirds_on_trial: int = 0
    """How many of them agreed on the last transform of theirs that was on trial: another one must have more."""
    circles_open: int = 0
    """Circles by way of thirds that did not close, beyond those that did, when its transform was last on trial."""

    @property
    def first_encounter(self) -> Encounter | None:
        """Where both were as the last contact began."""
        return self.encounters[0] if self.encounters else None

    @property
    def has_place(self) -> bool:
        """Whether it has said where it is in the frame of its newest map: an alignment waits for that."""
        return self.first_encounter is not None and not self.map_is_old

    def place(self, transform: Floats) -> Pose:
        """Where it was last heard to be by its frame in the robot's own (3,): asked several times in each tick."""
        if self.placed is None or self.placed[0] is not transform or self.placed[1] is not self.pose:
            self.placed = transform, self.pose, compose(pose_of(transform), self.pose)
        return self.placed[2]

    def place_within(self, tick: int, ticks: float) -> bool:
        """Whether it said where it was at most so many ticks ago."""
        return tick - self.pose_tick <= ticks

    @property
    def met_alone(self) -> bool:
        """Whether it was seen, and nobody else was heard whenever it was: then a disc that moves as it does is it."""
        seen = [one for one in self.sightings if len(one.discs)]
        return len(seen) > 0 and all(one.alone for one in seen)

    def take_contact(self, tick: int, since: int, known_ticks: int) -> None:
        """Something was heard in the contact that began then. Who has not said in known_ticks of it that it knows the
        robot's frame does so no more: it has undone the merge, or begun anew."""
        if self.knew_me < since < tick - known_ticks:
            self.knows_me = False

    def take_frame(self, tick: int, mine_in_theirs: Pose) -> None:
        """Keep where the peer says that the robot's own frame lies in its frame, if that was not on trial before."""
        self.knows_me, self.knew_me, claim = True, tick, inverse(np.array(mine_in_theirs))
        if self.tried_claim is None or apart(claim, self.tried_claim, np.zeros(2), DISTINCT_M, DISTINCT_RAD):
            self.claim = claim

    def take_frames(self, others: Mapping[str, Pose | None]) -> None:
        """Keep where the peer says that the frames of others lie, and forget what it takes back."""
        for name, frame in others.items():
            if frame is None:
                self.frames.pop(name, None)
            elif name in self.frames or len(self.frames) < MAX_ROBOTS:
                self.frames[name] = np.array(frame)

    def begin_anew(self, since: int) -> None:
        """The peer was started anew, or its map moved as if: what it told before, and was seen of it, holds no more.

        since: tick from which on its maps may be of the frame that it has now.
        """
        self.sightings.clear()
        self.sighting_is_news, self.explained, self.explained_by_proposal = False, 0, 0
        self.knows_me, self.claim, self.tried_claim, self.frames = False, None, None, {}
        self.thirds_on_trial, self.thirds_tried, self.thirds_map, self.circles_open = 0, None, None, 0
        self.encounters, self.begins = [], True
        if self.map is not None and self.map.tick < since:
            self.map_is_old = True
        if self.waiting is not None and self.waiting.tick < since:
            self.waiting, self.waits = None, False

    def align_anew(self) -> None:
        """The next alignment waits for no growth of the maps."""
        self.aligned_walls, self.growth = (0, 0), 0.0

    def take_beacon(self, since: int, pose_tick: int, sighting: Sighting, max_drive_m: float) -> None:
        """Keep where the peer says that it was at pose_tick; and of the first messages of a contact where both were.

        since: when the contact began. max_drive_m: what a robot drives in a tick.
        """
        if since != self.met:
            self.met, self.encounters = since, []
        may_have_driven = max_drive_m * (pose_tick - self.pose_tick)
        jump_m = math.dist(sighting.theirs[:2], self.pose[:2]) if self.pose_tick >= 0 else 0.0  # none from nowhere
        if jump_m > MOST_SPEED * may_have_driven + DISC_MOVED_M:
            self.begin_anew(self.pose_tick + 1)
            if self.map_is_old or self.map is not self.jumped_with:  # else the same map is aligned for each jump
                self.align_anew()
            self.jumped_with = self.map
        self.pose, self.pose_tick = sighting.theirs, pose_tick
        if len(self.encounters) < ENCOUNTERS_KEPT:
            self.encounters.append(Encounter(sighting.here, sighting.theirs))

    def move(self, by: Pose) -> None:
        """The robot's map has moved by so much where the last contact began, in its own frame.

        What was seen of the peer, and its word on frames, are of the map before. Of the last contact its begin is kept.
        """
        self.encounters = [one._replace(here=compose(by, one.here)) for one in self.encounters[:1]]
        self.sightings.clear()
        self.sighting_is_news, self.explained, self.explained_by_proposal = False, 0, 0
        self.claim = self.tried_claim = None

    def take_sighting(self, sighting: Sighting) -> None:
        """Keep a sighting if one of the two robots has moved since the last one."""
        if self.sightings:
            last = self.sightings[-1]
            pairs = (sighting.here, last.here), (sighting.theirs, last.theirs)
            if all(math.dist(one[:2], two[:2]) < DISC_MOVED_M for one, two in pairs):
                return
        self.sightings.append(sighting)
        self.sighting_is_news = True

    def offer_map(self, received: ReceivedMap) -> None:
        """Let a map wait to be taken, in place of an older one."""
        self.waiting, self.waiting_weight = received, weigh(received.wireframe)

    def take_map(self, known: Iterable[Weight]) -> bool:
        """Take the map that waits, unless it is too large beside all known maps; True when it begins to wait for that.

        known: of the own map and those that other peers have merged into it.
        """
        waiting, waited = self.waiting, self.waits
        self.waits = waiting is not None and all(is_too_large(self.waiting_weight, one) for one in known)
        if waiting is not None and not self.waits:
            self.map, self.map_is_news, self.map_is_old = waiting, True, False
            self.weight, self.waiting = self.waiting_weight, None
        return self.waits and not waited


@dataclass(eq=False)
class Unaligned:
    """A peer that was heard, and whose frame is not known."""

    log: PeerLog


@dataclass(eq=False)
class Proposed:
    """A peer of which a transform is on trial."""

    log: PeerLog
    map: ReceivedMap
    """The map on trial."""
    trial: Trial
    transform_sd_m: float
    """Standard error of the transform, metres."""
    waits_since: Encounter | None = None
    """How the contact began after which it waits for a sighting in another one; None while it is in the queue."""

    @property
    def transform(self) -> Floats:
        """(3,) the peer's frame in the robot's own."""
        return self.trial.transform


class Laid(NamedTuple):
    """A received map in the robot's own frame."""

    hidden: Bools
    """(m,) its walls that are not shown: own scans have seen through them, or their sender seldom saw them."""
    layer: Layer
    """The others."""
    first_hand: Layer
    """Those of them that the peer saw itself: the rest is told to nobody."""


@dataclass(frozen=True, eq=False)
class Merged:
    """A peer whose map is part of the robot's."""

    log: PeerLog
    map: ReceivedMap
    """The merged map: a newer one takes its place only if it agrees with the own map."""
    fit: WallFit
    """The transform, and how well it is known."""
    walls: WallEvidence
    """What own scans say of the merged map."""
    laid: Laid
    """The merged map in the robot's own frame."""
    since: int
    """Tick at which it was merged."""
    updated: int
    """Tick at which its transform was last fitted, to a newer map or to own walls that have moved."""
    agreed_m: float = 0.0
    """Wall that the merged map and the own one have in common."""
    refused: int = 0
    """Newer maps in a row that contradict the own map."""
    watch: Watch = field(default_factory=Watch)
    """Whether it is seen where it must be since it was merged."""

    @property
    def transform(self) -> Floats:
        """(3,) the peer's frame in the robot's own: T."""
        return self.fit.transform


Peer = Unaligned | Proposed | Merged


class _AllMerged(NamedTuple):
    """What each tick asks of the peers that are merged."""

    peers: list[Merged]
    ticks: dict[str, int]
    frames: dict[str, Pose]


class Peers(MutableMapping[str, Peer]):
    """All peers by name. What each tick asks of those that are merged is worked out once, until one is another."""

    def __init__(self) -> None:
        self._by_name: dict[str, Peer] = {}
        self._merged: _AllMerged | None = None

    def __getitem__(self, name: str) -> Peer:
        return self._by_name[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._by_name)

    def __len__(self) -> int:
        return len(self._by_name)

    def __setitem__(self, name: str, peer: Peer) -> None:
        self._by_name[name] = peer
        self._merged = None

    def __delitem__(self, name: str) -> None:
        del self._by_name[name]
        self._merged = None

    @property
    def merged(self) -> list[Merged]:
        """Those whose maps are part of the robot's, by name."""
        return self._all_merged().peers

    @property
    def merged_ticks(self) -> dict[str, int]:
        """When their maps were so."""
        return self._all_merged().ticks

    @property
    def frames(self) -> dict[str, Pose]:
        """Their frames in the robot's own."""
        return self._all_merged().frames

    def _all_merged(self) -> _AllMerged:
        if self._merged is None:
            peers = [peer for _, peer in sorted(self._by_name.items()) if isinstance(peer, Merged)]
            ticks = {peer.log.name: peer.map.tick for peer in peers}
            self._merged = _AllMerged(peers, ticks, {peer.log.name: pose_of(peer.transform) for peer in peers})
        return self._merged


Figures = Mapping[str, object]
"""Numbers of an event."""


def transform_sd_m(alignment: Alignment | None) -> float:
    """Standard error in metres of a transform by its alignment; of a given one where there is none, or it failed."""
    if alignment is None or alignment.transform is None:
        return GIVEN_SD_M
    return max(alignment.residual, LEAST_CORNER_SD_M) / math.sqrt(max(alignment.inliers, 1))
