"""A proposal on trial: a hypothesis with a weight that new scans and messages update (paper IV; the rule is ours).

A sequential test on evidence that the alignment did not use. Its weight is the log-odds, in nats, that the transform
is right; at either bound it decides, before the robot arrives where it wanted to look.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from agent.cooperation.config import VerificationConfig
from agent.cooperation.ground import Ground, sees_place
from agent.corner_scan import CornerScan
from agent.mapping.contradiction import ViewRules
from agent.mapping.scan_merge import to_map_frame
from protocol.arrays import Floats
from protocol.geometry import Pose, apply

KINDS = ("ground", "discs", "heard", "later_maps")


@dataclass
class Verification:
    """The evidence on one transform (3,), which takes the peer's frame into the robot's own."""

    config: VerificationConfig
    transform: Floats
    ground: Ground
    begun: int
    """Tick of the proposal."""
    used: int = 0
    """Sightings of the peer that gave the transform, and so are no evidence for it."""
    nats: dict[str, float] = field(default_factory=lambda: dict.fromkeys(KINDS, 0.0))
    """Weight of each kind of evidence."""
    discs_seen: int = 0
    discs_missed: int = 0
    agreed_again: int = 0
    """Later alignments that gave the same transform."""
    _looked_from: Floats | None = None
    _seen_at: list[tuple[float, float]] = field(default_factory=list)
    """Places of the peer, in its own frame, at which discs were counted."""

    @property
    def weight(self) -> float:
        """Log-odds of right against wrong."""
        return sum(self.nats[kind] for kind in KINDS if getattr(self.config, kind))

    @property
    def verdict(self) -> bool | None:
        """Accepted, rejected, or not decided yet."""
        if self.weight >= self.config.accept:
            return True
        return False if self.weight <= -self.config.reject else None

    def walk(self) -> None:
        """Weigh the ground that was looked at."""
        confirmed, against = self.ground.said(self.config.fresh_looks)
        gain = min(self.config.ground_nats_per_m * confirmed, self.config.ground_most)
        self.nats["ground"] = gain - self.config.ground_against_per_m * against

    def hear(self, here: Pose, theirs: Pose, reach_m: float) -> None:
        """A message was heard here from a peer that says where it is, in its own frame; both must fit the radio."""
        x, y = apply(self.transform, np.array([theirs[:2]]))[0]
        if math.hypot(x - here[0], y - here[1]) > reach_m:
            self.nats["heard"] -= self.config.heard_against

    def look_for_disc(
        self, here: Pose, theirs: Pose, scan: CornerScan, discs: Floats, radius_m: float, rules: ViewRules
    ) -> None:
        """Is the peer where the transform puts it? discs (d, 2): seen in this scan, robot's own frame, metres.

        A disc counts once the peer has moved on from all places where one did, as what stands still may be a post or
        another teammate; free floor once either robot has moved on since the last look.
        """
        x, y = apply(self.transform, np.array([theirs[:2]]))[0].tolist()
        away = math.hypot(x - here[0], y - here[1])
        if away < 2.0 * radius_m:
            return
        if len(discs) and np.hypot(discs[:, 0] - x, discs[:, 1] - y).min() <= self.config.disc_gate_m:
            if all(math.dist(theirs[:2], place) >= self.config.disc_moved_m for place in self._seen_at):
                self._seen_at.append((theirs[0], theirs[1]))
                self.discs_seen += 1
        elif away <= self.config.disc_far_m:
            places = np.array([x, y, here[0], here[1]])
            if self._looked_from is not None and np.abs(places - self._looked_from).max() < self.config.disc_moved_m:
                return
            if sees_place(x, y, radius_m, here, scan.pieces, to_map_frame(scan.pieces, here), scan.sight, rules):
                self.discs_missed += 1
                self._looked_from = places
        gain = self.config.disc_nats * max(self.discs_seen - self.used, 0)
        self.nats["discs"] = gain - self.config.disc_against * self.discs_missed

    def align_again(self, same: bool | None) -> None:
        """Later maps were aligned: the same transform, another one, or none (None)."""
        if same is None:
            return
        self.agreed_again += int(same)
        self.nats["later_maps"] += self.config.later_nats if same else -self.config.later_against

    def figures(self) -> dict[str, object]:
        """For an event."""
        confirmed, against = self.ground.said(self.config.fresh_looks)
        return {
            "weight": round(self.weight, 2),
            "evidence": {kind: round(nats, 2) for kind, nats in self.nats.items()},
            "ground_confirmed_m": round(confirmed, 2),
            "ground_against_m": round(against, 2),
            "discs_seen": self.discs_seen,
            "discs_missed": self.discs_missed,
            "agreed_again": self.agreed_again,
        }
