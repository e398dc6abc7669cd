"""The queue of proposals, Z of Algorithm 1, and the drive that verifies its first one.

The robot drives to where the peer was at contact (paper IV). Where that has decided nothing, it looks from other places
(ours).
"""

import numpy as np

from agent.cooperation.peer import Proposed
from agent.errand import Errand
from agent.period import WakingTime
from protocol.arrays import Floats
from protocol.geometry import Pose, apply

DETOURS = 4
"""Other places that the robot drives to when the place of contact has decided nothing."""
STILL_HEARD_S = 10.0
"""The robot drives to the peer itself if its place is not older: the peer drives 2.2 m in the time."""
HERE_M = 0.6
"""Places nearer than this show the robot nothing new."""
IN_FRONT_M = 0.8
"""Distance from a wall at which the robot stands to see it."""


class ProposalQueue:
    """Proposals in the order in which they were made, and the drive for the first of them."""

    def __init__(self, time_out_s: float, rate_hz: float) -> None:
        """time_out_s: after which a drive ends undecided; rate_hz: ticks a second."""
        self._time_out, self._still_heard = time_out_s * rate_hz, STILL_HEARD_S * rate_hz
        self._awake = WakingTime(rate_hz)
        self.proposals: list[Proposed] = []
        self.errand: Errand | None = None
        """To verify the first; None without proposal."""

    def add(self, peer: Proposed) -> None:
        """Z = Z + proposal."""
        self.proposals.append(peer)

    def remove(self, peer: Proposed) -> None:
        """Z = Z - proposal, if it is not out of it already."""
        if self.proposals[:1] == [peer]:
            self.errand = None
        if peer in self.proposals:
            self.proposals.remove(peer)

    def set_out(self, tick: int, pose: Pose) -> tuple[Proposed, str] | None:
        """To the place of contact of the first proposal, then elsewhere; that proposal, and why its drive has ended.

        pose: the robot's, in its own frame.
        """
        awake = self._awake.at(tick)
        if not self.proposals:
            return None
        peer, errand = self.proposals[0], self.errand
        if errand is None:
            assert peer.log.first_encounter is not None
            self.errand = Errand(apply(peer.transform, np.array([peer.log.first_encounter.theirs[:2]]))[0], awake)
        elif awake - errand.since > self._time_out:
            return peer, "it took too long"
        elif errand.ended == "no way" and not errand.detours:
            return peer, "unreachable"
        elif (errand.detours or errand.ended) and peer.trial.asks_for_a_sighting and not self._is_heard(tick, peer):
            return peer, "undecided"
        elif errand.ended:
            place = self._elsewhere(tick, peer, pose, errand.detours)
            if place is None or errand.detours >= DETOURS:
                return peer, "undecided"
            self.errand = Errand(place, errand.since, errand.detours + 1)
        return None

    def _is_heard(self, tick: int, peer: Proposed) -> bool:
        return peer.log.place_within(tick, self._still_heard)

    def _elsewhere(self, tick: int, peer: Proposed, pose: Pose, detours: int) -> Floats | None:
        """(2,) where to look next: in turns the peer itself, if it is still heard, and what only it has seen."""
        unseen, heard = peer.trial.walls.unseen(), self._is_heard(tick, peer)
        if heard and (detours % 2 == 0 or not len(unseen) or peer.trial.asks_for_a_sighting):
            return np.asarray(apply(peer.transform, np.array([peer.log.pose[:2]]))[0])
        stands = unseen[:, :2] + IN_FRONT_M * np.column_stack([-unseen[:, 3], unseen[:, 2]])
        stands = apply(peer.transform, stands)
        away = np.hypot(stands[:, 0] - pose[0], stands[:, 1] - pose[1])
        stands, away = stands[away >= HERE_M], away[away >= HERE_M]
        return np.asarray(stands[away.argmin()]) if len(stands) else None
