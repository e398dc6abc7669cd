"""A mind that is carried: it maps what its lidar sees, and somebody else drives, as in a recorded log.

It cooperates as one that drives does, but for what needs driving or a body: it drives nowhere to verify, and nobody
stands where a peer of another log says that it is.
"""

import math
from collections.abc import Sequence

import numpy as np

from agent.communication.exchange import Exchange
from agent.config import AgentConfig
from agent.cooperation.team import Team
from agent.corner_scan import BRIDGE_M
from agent.mapping.drawing import Drawing
from agent.mapping.submaps.chain import Submaps, travelled
from agent.mapping.submaps.crossings import overrun_of
from agent.mapping.submaps.wireframe import wireframe_of
from agent.mapping.wheels import way_from
from agent.perception.perceive import Perception
from protocol.arrays import Floats
from protocol.geometry import Pose, compose, pose_of, relative
from protocol.grid_map import MAX_TOLD
from protocol.messages import Event, Heard, LidarSpec, Observation, RobotSpec, Send
from protocol.wireframe import MAX_VERTICES, Wireframe

ODOMETRY_SCALE_SD = 0.03  # of a metre that odometry tells: by 2 % in the logs, 5 % was seen
ODOMETRY_BEND_SD = 0.09
"""rad a metre by which it bends a straight way: of wheels that err by 1 % each, 0.16 m apart."""
FAR_BRIDGE_M = 2.0
"""Between neighbouring hits of one line, up to which there is wall. A log's lidar of few beams meets walls far ahead
that sparsely, and without those hits little tells its heading in a corridor. A robot that drives comes near enough to
see whether there is wall, and must not take an open door for one."""
FAR_BEAMS = 4.0
"""The same, in distances of two beams at the lidar's range, where that is less. One that reaches 3.5 m meets no wall so
sparsely, and with 2 m closed doors: of three layouts' maps 0.74 to 0.79 was wall, now 0.84 to 0.92."""
LOOKS_M = 1.0  # m of way (`travelled`), at least, after which peers are told a newer map, and it is held against theirs
LOOKS_SHARE = 0.01
"""The same, as a share of the whole way: an old map changes little in a metre, and to draw it takes as long as it is
large."""
IN_LIVED_ROOMS = {"conflict_weight": 1.0, "max_conflict": 0.6, "min_score_m": 10.0, "max_beside": 1.0}
"""Settings of alignment for recorded logs. What stands in a building moves between visits, people walk, and maps told
before a loop was closed are bent. Measured on maps of thirds of two logs: right transforms score 24 m and more, with up
to 0.57 m of conflict a metre that agrees; of 27 pairs of other buildings none scores more than 1 m."""

WITHOUT_A_BODY = {"discs": False, "ground": False, "time_out_s": 1e9}
"""Settings of verification: nobody stands where a peer of another log says that it is, and nobody drives there."""


class Passenger:
    """Perception, mapping and cooperation of a robot without its driving."""

    def __init__(self, spec: RobotSpec, config: AgentConfig) -> None:
        """The pose at the first observation is the origin of its frame. config: as by `carried`."""
        self.perception = Perception(config.perception, spec, alone=True, bridge_m=_bridge_m(spec.lidar))
        self.submaps = Submaps(config.filter.submaps, spec.lidar.view(), ODOMETRY_SCALE_SD, ODOMETRY_BEND_SD)
        self.exchange = Exchange(config.radio, spec.lidar.rate_hz, spec.radio_mtu_bytes)
        self.team = Team(config.cooperation, config.alignment, spec, np.random.default_rng(0))
        self._overrun_m = overrun_of(spec.lidar)
        self._told = Drawing()  # the own map, as peers are told it
        self._since_own = math.inf  # metres of way
        self._way = 0.0  # metres
        self._odometry: Pose | None = None
        self._places: list[tuple[int, Floats]] = []  # where each scan was taken, as of `Submaps.place`

    @property
    def own(self) -> Wireframe:
        """The own map, as peers are told it."""
        return self._told.wireframe

    def step(self, observation: Observation, heard: Sequence[Heard] = ()) -> tuple[list[Send], list[Event]]:
        """Take one scan and what was heard; what to send, and what happened.

        Its odometry may have any error; the steps between scans may be of any length. Its way, where there is one,
        leads from the begin of the lidar's revolution to its end, however long ago the last was.
        """
        before = observation.odometry if self._odometry is None else self._odometry
        self._odometry = observation.odometry
        poses = observation.poses()
        begin, since = (pose_of(poses[0]), poses[1:]) if observation.way else (before, poses)
        start = compose(self.submaps.pose, relative(before, begin))
        seen = observation.model_copy(update={"tick": len(self._places)})  # the way is told whenever the last scan was
        scan = self.perception.see(seen, way_from(begin, since), start, Wireframe())
        by = relative(before, observation.odometry)
        self.submaps.take(scan, by)
        self._places.append(self.submaps.place)
        self._since_own += travelled(by)
        self._way += travelled(by)

        tick, pose = observation.tick, self.submaps.pose
        news, events = self.exchange.hear(tick, heard)
        if self.exchange.contacts or self.team.peers:
            self._look_at_own()
            if self.team.config.sharing:
                self.team.hear(tick, news, pose, scan, self.own, {message.sender for message in heard})
                events = [*events, *self._cooperate(tick)]
        return self.exchange.talk(tick, pose, lambda _: self.own, self._told.version), events

    def finish(self, tick: int = 0) -> list[Event]:
        """After the last scan: look for loops on the last of the way, and settle all once more; what happened."""
        self.submaps.finish()
        self._since_own = math.inf
        self.team.events = []
        if not self.team.peers:
            return []
        self._look_at_own()
        self.team.conclude(tick, self.own)
        return self.team.events

    def _look_at_own(self) -> None:
        """Draw the own map anew where the robot has moved far enough since the last one."""
        if self._since_own >= max(LOOKS_M, LOOKS_SHARE * self._way):
            self._told.replace(self.drawn(MAX_TOLD))
            self._since_own = 0.0

    def _cooperate(self, tick: int) -> list[Event]:
        """Align maps, and judge proposals without a drive to verify them."""
        self.team.align_maps(tick, self.own)
        self.team.judge(tick, self.own, self.submaps.pose)
        return self.team.events

    def drawn(self, most: int = MAX_VERTICES) -> Wireframe:
        """The map of own scans, in the own frame; without its shortest walls where it would have more vertices."""
        return wireframe_of(self.submaps.walls(), self._overrun_m, most)

    def wireframe(self) -> Wireframe:
        """The map with those of merged peers, in the own frame."""
        return wireframe_of(self.submaps.walls([peer.laid.layer for peer in self.team.merged]), self._overrun_m)

    def path(self) -> Floats:
        """(scans, 3) pose at each scan by what is known now, in the own frame."""
        return np.array([self.submaps.pose_at(*place) for place in self._places]).reshape(-1, 3)


def _bridge_m(lidar: LidarSpec) -> float:
    """Metres between neighbouring hits of one line up to which there is wall."""
    apart_m = lidar.range_max_m * lidar.beam_step
    return min(max(FAR_BEAMS * apart_m, BRIDGE_M), FAR_BRIDGE_M)


def carried(config: AgentConfig) -> AgentConfig:
    """The settings of a mind that does not drive, in a building in which not all stands still.

    What was set for alignment stays so.
    """
    lived_in = {key: value for key, value in IN_LIVED_ROOMS.items() if key not in config.alignment.model_fields_set}
    verification = config.cooperation.verification.model_copy(update=WITHOUT_A_BODY)
    return config.model_copy(
        update={
            "alignment": config.alignment.model_copy(update=lived_in),
            "cooperation": config.cooperation.model_copy(update={"verification": verification}),
        }
    )
