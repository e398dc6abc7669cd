"""Where other robots are, by what each said last and how far it may have driven since, and who is known (ours)."""

import math
from collections.abc import Iterable, Iterator

import numpy as np

from agent.cooperation.config import CooperationConfig
from agent.cooperation.peer import Merged, PeerLog, Peers, Proposed, Unaligned
from agent.cooperation.proposal_queue import STILL_HEARD_S
from agent.cooperation.verification import DISC_GATE_M
from protocol.arrays import Floats
from protocol.geometry import Pose
from protocol.messages import RobotSpec, TeammatePose

STRANGER_S = 20.0
"""A peer counts as a stranger for this long after it was merged: the merge may be undone by what is seen first."""
IN_TOUCH_S = 20.0
"""A teammate silent for longer bids for no task: four of its beacons are missed, and it knows no task since."""
PLACE_KNOWN_S = 60.0
"""A teammate silent for longer has no part in the division of work: it drives 13 m in the time."""
TOLD_SD = 0.01
"""Standard deviation, m and rad, of a pose that a teammate tells: of those of robots in their maps."""
STRAIGHT_SDS, TURNED_M = 3.0, 0.5
"""Since then it may have driven some metres. That it drove straight on counts as so many deviations. It may have turned
by a radian each so many metres: round the corner of a doorway."""
FARTHEST_M = 10_000.0
"""Where it is no more is said of one that may have driven farther: after days of silence, or by a beacon with a tick of
long ago, its variance was more than telemetry may hold."""
NEARER_M = 0.5
"""Of two that are about as near to a task the first by name goes: the second must be nearer by this much."""


class PeerPlaces:
    """Of all peers that a robot has heard, as they are now."""

    def __init__(self, peers: Peers, spec: RobotSpec, config: CooperationConfig) -> None:
        """peers: those of the team, which change. spec: of all robots."""
        self._peers, self._division, self._sharing = peers, config.division, config.sharing
        self._speed_mps, self._rate_hz = spec.max_speed_mps, spec.lidar.rate_hz

    def teammates(self, tick: int) -> list[TeammatePose]:
        """Where peers with a transform were last heard to be, in the robot's own frame."""
        known = []
        for name, peer in sorted(self._peers.items()):
            if isinstance(peer, Unaligned) or peer.log.pose_tick < 0:
                continue
            pose, drive_m = self._last_pose(tick, peer)
            # by the turn of its frame, too, which moves far places by more
            sd_m = peer.fit.sd_at(np.array(peer.log.pose[:2])) if isinstance(peer, Merged) else peer.transform_sd_m
            spread = math.hypot(TOLD_SD + sd_m, drive_m / STRAIGHT_SDS)
            turn = min(math.pi, TOLD_SD + drive_m / TURNED_M)
            known.append(
                TeammatePose(
                    robot=name,
                    tick=peer.log.pose_tick,
                    pose=pose,
                    covariance=(spread**2, 0.0, 0.0, 0.0, spread**2, 0.0, 0.0, 0.0, turn**2),
                    status="merged" if isinstance(peer, Merged) else "proposed",
                )
            )
        return known

    def lately(self, tick: int) -> Floats:
        """(k, 3) where merged peers said lately that they are, and by how much each may be off: metres, own frame."""
        heard = self._heard(tick, STILL_HEARD_S)
        return _rows((x, y, DISC_GATE_M + drive_m) for _, (x, y, _), drive_m in heard)

    def partners(self, tick: int, robot: str) -> tuple[Floats, Floats]:
        """(k, 3) those that divide the work and were heard lately, and (j, 3) those that are silent.

        Each one's place, and metres by which it must be nearer to a task: half of the way that it may have gone since,
        and NEARER_M more or less by name. robot: its own name.
        """
        heard = [*self._heard(tick, PLACE_KNOWN_S)] if self._division else []
        rows = _rows(
            (x, y, 0.5 * drive_m + (NEARER_M if robot < log.name else -NEARER_M)) for log, (x, y, _), drive_m in heard
        )
        in_touch = np.array([log.place_within(tick, IN_TOUCH_S * self._rate_hz) for log, *_ in heard], np.bool_)
        return rows[in_touch], rows[~in_touch]

    def strange_to(self, contacts: Iterable[str]) -> list[str]:
        """Those in contact that have not merged the robot's map, by all that they said; none where none are shared.

        Whose map the robot has not merged `strangers_among` tells.
        """
        return [name for name in contacts if self._sharing and not self._knows_me(name)]

    def _knows_me(self, name: str) -> bool:
        """Whether somebody has merged the robot's map. Where work is not divided nobody says so: merges are mutual."""
        peer = self._peers.get(name)
        return peer is not None and (peer.log.knows_me if self._division else isinstance(peer, Merged))

    def strangers_among(self, tick: int, heard: Iterable[str]) -> bool:
        """Whether the robot has not merged the map of one of those that are heard, or only lately.

        Who has not merged its own `strange_to` tells.
        """
        lately, peers = tick - STRANGER_S * self._rate_hz, map(self._peers.get, heard)
        return any(not isinstance(peer, Merged) or peer.since >= lately for peer in peers)

    def _heard(self, tick: int, within_s: float) -> Iterator[tuple[PeerLog, Pose, float]]:
        """Merged peers that were heard so lately, and what `_last_pose` says of each."""
        for peer in self._peers.merged:
            if peer.log.place_within(tick, within_s * self._rate_hz):
                yield peer.log, *self._last_pose(tick, peer)

    def _last_pose(self, tick: int, peer: Proposed | Merged) -> tuple[Pose, float]:
        """Where a peer said that it is, own frame, and how many metres it may have driven since, FARTHEST_M at most."""
        drive_m = self._speed_mps * (tick - peer.log.pose_tick) / self._rate_hz
        return peer.log.place(peer.transform), min(drive_m, FARTHEST_M)


def _rows(found: Iterable[tuple[float, float, float]]) -> Floats:
    """(k, 3) of k triples."""
    return np.array([*found], np.float64).reshape(-1, 3)
