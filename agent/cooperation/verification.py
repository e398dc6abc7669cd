"""A proposal on trial: a hypothesis with a weight that new scans and messages update (paper IV; the rule is ours).

The trial is a sequential test on evidence that the alignment did not use. Its weight is the log-odds, in nats, that
the transform is right. At either bound the trial decides, also before the robot arrives where it wanted to look.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from agent.alignment.by_sight import Sighting
from agent.cooperation.config import VerificationConfig
from agent.cooperation.evidence import WALL_MARGIN_M, WallEvidence
from agent.corner_scan import CornerScan
from agent.mapping.views import View, sees_place, view_of
from protocol.arrays import Floats
from protocol.geometry import Pose, apply, compose, pose_of

KINDS = ("ground", "discs", "heard", "thirds", "later_maps")
"""Kinds of evidence, as the switches of VerificationConfig and the figures of events name them."""

GROUND_NATS_PER_M = 0.6
"""Gain for newly seen wall as predicted: little, as rooms are alike."""
GROUND_MOST_NATS = 3.0
"""The gain by newly seen walls is never more than this, as a room's twin agrees everywhere."""
GROUND_AGAINST_NATS_PER_M = 4.0
"""Loss for predicted wall that is not there. Right maps have 0.2 m of it at the median, twins of a room several
metres."""
DISC_NATS = 2.5
"""Gain for a disc where the teammate must be. By chance a disc is there in one of twelve such looks at most."""
DISC_AGAINST_NATS = 2.5
"""Loss for free floor where the teammate must be in view: perception misses one teammate of ten."""
LATER_NATS = 2.5
"""Gain where maps that have grown give the same transform, unambiguously."""
LATER_AGAINST_NATS = 6.0
"""Loss where they give another one: decides."""
WALLS_MOST_NATS = 3.0
"""The gain by newly seen walls and later maps together, where a teammate may be seen: a building may look the same
after a half turn, and then its walls agree for good. So one of the two must have seen the other."""
HEARD_AGAINST_NATS = 10.0
"""Loss for a message from beyond the radio's range: decides."""

THIRD_NATS = 2.5
"""Gain for each merged peer but the first that says the same, and loss for each that says another one: that of a
sighting, as each of them has had one. The first one counts for nothing, so that no liar alone decides."""

FRESH_LOOKS = 2
"""Scans that must say the same of a piece of wall before it counts."""
DISC_GATE_M = 0.15
"""A disc this near to where a teammate is predicted is the teammate: 0.05 m that it drives in a tick, and 3 sigma of
the transform's error and of the disc's fit, 0.03 m."""
DISC_FAR_M = 2.5
"""A teammate farther off may be missed: its disc has five beams there."""
DISC_MOVED_M = 0.3
"""Looks at a teammate are independent once it or the robot has moved this far."""


def nats_of_thirds(balance: int) -> float:
    """What it weighs that so many more merged peers say a transform than say another one."""
    return THIRD_NATS * (balance - (balance > 0))


@dataclass
class Watch:
    """Whether a teammate is where a transform puts it."""

    missed: int = 0
    """Looks in a row that showed free floor there."""
    _looked_from: Floats | None = None
    """(4,) predicted place of the teammate, and the robot's, when the teammate was last missed."""

    def look(
        self, transform: Floats, here: Pose, theirs: Pose, scan: CornerScan, discs: Floats, radius_m: float
    ) -> bool | None:
        """True where a disc is there, false where free floor is; None where neither is seen, or as at the last miss.

        transform: (3,) the teammate's frame in the robot's own; theirs: its pose in its frame; discs: (d, 2) metres.
        """
        x, y = apply(transform, np.array([theirs[:2]]))[0].tolist()
        if len(discs) and np.hypot(discs[:, 0] - x, discs[:, 1] - y).min() <= DISC_GATE_M:
            self.missed = 0
            return True
        places = np.array([x, y, here[0], here[1]])
        if math.hypot(x - here[0], y - here[1]) > DISC_FAR_M:
            return None
        if self._looked_from is not None and np.abs(places - self._looked_from).max() < DISC_MOVED_M:
            return None
        if not sees_place(x, y, radius_m, view_of(scan, here, WALL_MARGIN_M)):
            return None
        self._looked_from, self.missed = places, self.missed + 1
        return False


@dataclass
class Trial:
    """The evidence on one transform (3,), which takes the peer's frame into the robot's own."""

    config: VerificationConfig
    transform: Floats
    walls: WallEvidence
    used: int = 0
    """Sightings of the peer that gave the transform, and so are no evidence for it."""
    nats: dict[str, float] = field(default_factory=lambda: dict.fromkeys(KINDS, 0.0))
    """Weight of each kind of evidence."""
    discs_seen: int = 0
    discs_missed: int = 0
    agreed_again: int = 0
    """Later alignments that gave the same transform."""
    watch: Watch = field(default_factory=Watch)
    _seen_at: list[tuple[float, float]] = field(default_factory=list)
    """Places of the peer, in its own frame, at which discs were counted."""

    @property
    def weight(self) -> float:
        """Log-odds of right against wrong, by the kinds of evidence that count."""
        walls = self._nats("ground", "later_maps")
        walls = min(walls, WALLS_MOST_NATS) if self.config.discs else walls
        return walls + self._nats("discs", "heard", "thirds")

    @property
    def verdict(self) -> bool | None:
        """Accepted, rejected, or not decided yet."""
        if self.weight >= self.config.accept:
            return True
        return False if self.weight <= -self.config.reject else None

    @property
    def asks_for_a_sighting(self) -> bool:
        """Whether only seeing the peer where it must be may decide: the most that walls can say would not suffice."""
        most = self._nats("discs", "heard", "thirds") + WALLS_MOST_NATS
        return self.config.discs and most < self.config.accept

    def _nats(self, *kinds: str) -> float:
        """Weight of some kinds of evidence, of those that count."""
        return sum(self.nats[kind] for kind in kinds if getattr(self.config, kind))

    @property
    def thirds_suffice(self) -> bool:
        """Whether merged peers alone decide: maps of robots that share their work need not have walls in common."""
        return self.config.thirds and self.nats["thirds"] >= self.config.accept

    def move(self, by: Pose) -> None:
        """The robot's map has moved by so much where it met the peer, in its own frame: the transform goes along."""
        self.transform, self.watch = np.array(compose(by, pose_of(self.transform))), Watch()

    def look_at_walls(self, view: View) -> None:
        """Hold a scan against the received walls, and weigh what is known of them."""
        self.walls.look(self.transform, view)
        confirmed, against = self.walls.said(FRESH_LOOKS)
        gain = min(GROUND_NATS_PER_M * confirmed, GROUND_MOST_NATS)
        self.nats["ground"] = gain - GROUND_AGAINST_NATS_PER_M * against

    def weigh(self, sighting: Sighting, reach_m: float, radius_m: float) -> None:
        """Weigh a message and the scan of its moment. reach_m: the radio's range; radius_m: of the peer's body."""
        self.hear(sighting.here, sighting.theirs, reach_m)
        self.look_for_disc(sighting.here, sighting.theirs, sighting.scan, sighting.discs, radius_m)

    def hear(self, here: Pose, theirs: Pose, reach_m: float) -> None:
        """A message was heard here from a peer that says where it is, in its own frame; both must fit the radio."""
        x, y = apply(self.transform, np.array([theirs[:2]]))[0]
        if math.hypot(x - here[0], y - here[1]) > reach_m:
            self.nats["heard"] -= HEARD_AGAINST_NATS

    def look_for_disc(self, here: Pose, theirs: Pose, scan: CornerScan, discs: Floats, radius_m: float) -> None:
        """Is the peer where the transform puts it? discs (d, 2): seen in this scan, robot's own frame, metres.

        A disc counts once the peer has moved on from all places where one counted, as what stands still may be a post
        or another teammate. Free floor counts once either robot has moved on since the last look.
        """
        there = self.watch.look(self.transform, here, theirs, scan, discs, radius_m)
        if there and all(math.dist(theirs[:2], place) >= DISC_MOVED_M for place in self._seen_at):
            self._seen_at.append((theirs[0], theirs[1]))
            self.discs_seen += 1
        self.discs_missed += there is False
        gain = DISC_NATS * max(self.discs_seen - self.used, 0)
        self.nats["discs"] = gain - DISC_AGAINST_NATS * self.discs_missed

    def ask_thirds(self, balance: int) -> None:
        """By how many more merged peers say this transform of the peer than say another one."""
        self.nats["thirds"] = nats_of_thirds(balance)

    def align_again(self, same: bool) -> None:
        """Later maps were aligned, and gave the same transform or another one."""
        self.agreed_again += int(same)
        self.nats["later_maps"] += LATER_NATS if same else -LATER_AGAINST_NATS

    def figures(self) -> dict[str, object]:
        """For an event."""
        confirmed, against = self.walls.said(FRESH_LOOKS)
        return {
            "weight": round(self.weight, 2),
            "evidence": {kind: round(nats, 2) for kind, nats in self.nats.items()},
            "ground_confirmed_m": round(confirmed, 2),
            "ground_against_m": round(against, 2),
            "discs_seen": self.discs_seen,
            "discs_missed": self.discs_missed,
            "agreed_again": self.agreed_again,
        }
