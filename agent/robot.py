"""One robot: takes what it senses and hears, gives what it does and says. Without clock, network or shared state."""

import time
import zlib
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from agent.communication.exchange import Exchange
from agent.config import AgentConfig
from agent.cooperation.merging import SAME_WALL_M
from agent.cooperation.team import Team
from agent.corner_scan import CornerScan, range_noise
from agent.exploration.explorer import Explorer
from agent.exploration.surroundings import Situation
from agent.look_round import HELD_RAD, LookRound
from agent.mapping.drawing import Drawing
from agent.mapping.laying import Laying
from agent.mapping.particle_filter import WireframeFilter
from agent.mapping.submaps.loop_closing import LoopClosing
from agent.mapping.submaps.wireframe import records_of
from agent.mapping.views import margin_of, sees_places, view_of
from agent.perception.perceive import Perception
from agent.period import Period, in_ticks
from agent.state import State
from protocol.geometry import Pose, pose_of
from protocol.messages import Action, Heard, MapReport, Observation, PoseReport, RobotSpec, ScanReport, Send
from protocol.wireframe import Wireframe, encode_wireframe

UPDATE_S = 0.2
"""Scans update the filter this far apart, at least: walls and their ends count scans for and against them, which have
much the same errors where they come from nearly one place."""


class Step(NamedTuple):
    """What a robot does and says in a tick."""

    action: Action
    sends: list[Send]
    map: MapReport | None
    telemetry: Callable[[], tuple[ScanReport, PoseReport]]
    """What viewers are shown beside the map, made only where somebody looks, and before the next step."""

    @property
    def scan(self) -> ScanReport:
        """The corner scan."""
        return self.telemetry()[0]

    @property
    def pose(self) -> PoseReport:
        """Where the robot and its teammates are."""
        return self.telemetry()[1]


class Robot:
    """A robot's mind. It knows its body, its configuration and its own random numbers, and nothing of the world."""

    def __init__(self, robot: str, spec: RobotSpec, config: AgentConfig, seed: int) -> None:
        """Be `robot`; the pose at the first tick is the origin of its frame."""
        self.robot, self.spec, self.config = robot, spec, config
        self.perception = Perception(config.perception, spec)
        self.filter = WireframeFilter(config.filter, spec, np.random.SeedSequence([seed, zlib.crc32(b"filter")]))
        self.loops: LoopClosing | None = None  # without correction odometry has the pose, and no loop could move it
        if spec.odometry.noisy and config.filter.correct_pose:
            self.loops = LoopClosing(config.filter.submaps, spec.lidar.view())
        self.explorer = Explorer(config.exploration, config.driving, spec, self._random(seed, "explore"))
        wants_maps = config.cooperation.sharing
        self.exchange = Exchange(config.radio, spec.lidar.rate_hz, spec.radio_mtu_bytes, wants_maps)
        self.team = Team(config.cooperation, config.alignment, spec, self._random(seed, "align"))
        self._own = Drawing()  # of own scans alone
        self._map = Drawing()  # the same with merged maps laid over it
        self._told_version = 0  # rises whenever what peers are told may have changed
        self._map_bytes, self._shown_version = encode_wireframe(self.wireframe), self._map.version
        self._update = Period(in_ticks(UPDATE_S, spec.lidar.rate_hz))
        self._laying = Laying(spec.lidar.rate_hz)
        self._look_round = LookRound(spec.lidar.rate_hz) if spec.odometry.noisy else None

    @property
    def own(self) -> Wireframe:
        """The map of own scans alone, in the robot's own frame."""
        return self._own.wireframe

    @property
    def wireframe(self) -> Wireframe:
        """The map: the same with merged ones laid over it."""
        return self._map.wireframe

    def state(self) -> State:
        """For a checkpoint, after a step: the own map, the pose, and what was seen. Peers are met anew."""
        return self.filter.state() | self.explorer.state()

    def restore(self, state: State) -> None:
        """Go on from a checkpoint, before the first step. Raises ValueError or LookupError where it makes no sense."""
        self.filter.restore(state)
        self.explorer.restore(state)
        self._own.replace(self.filter.wireframe())
        if not self.filter.is_at_start:
            # without the submaps from before, a map that is merged anew from them would lose the walls from before
            self.loops, self._look_round = None, None

    @staticmethod
    def _random(seed: int, purpose: str) -> np.random.Generator:
        """A generator of its own for each purpose, so that a draw in one place moves nothing elsewhere."""
        return np.random.default_rng(np.random.SeedSequence([seed, zlib.crc32(purpose.encode())]))

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
        """Take one tick: the paper's Algorithm 1 after mapping. C are `exchange.contacts`; Z and T are in `team`.

        Of its branches the first look and the way home are ours, for robots whose odometry errs.
        """
        started, tick = time.perf_counter(), observation.tick
        senders = {message.sender for message in heard}
        scan = self._map_scan(observation, senders)
        own_changed = self._own.update(self.filter.wireframe())
        pose, seen = self.filter.pose, scan.wireframe()
        news, events = self.exchange.hear(tick, heard)  # C
        if self.config.cooperation.sharing:
            self.team.hear(tick, news, pose, scan, self.own, senders)
            self.team.judge(tick, self.own, pose)  # accept = judge(proposal), of the last tick's Z
            self.team.align_maps(tick, self.own)  # Z = Z + align_maps(C)
        self._draw_map(tick, own_changed)
        explorer = self.explorer
        scene = explorer.look(self._situation(tick, scan, seen))
        if self._looks_round():
            command = explorer.stop("look round")
        elif not len(self.wireframe.edges):
            command = explorer.drive_forward(scene)
        elif contact := explorer.place_of_contact(scene):
            command = explorer.drive(scene, contact)
        elif home := explorer.way_home(scene):
            command = explorer.drive(scene, home)
        elif frontier := explorer.frontier(scene):
            command = explorer.drive(scene, frontier)
        else:
            command = explorer.drive(scene, explorer.default_state(scene))
        sends = self._talk(tick, pose, scan)
        changed = self._map.version != self._shown_version  # in this tick, or since the robot had to stand
        if changed:
            self._map_bytes, self._shown_version = encode_wireframe(self.wireframe), self._map.version
        return Step(
            Action(
                tick=tick,
                speed_mps=command.speed_mps,
                turn_rps=command.turn_rps,
                sent=len(sends),
                complete=command.complete,
                events=[*events, *self.team.events, *command.events],
                map_bytes=len(self._map_bytes),
                filter_bytes=self._nbytes(),
                step_ms=(time.perf_counter() - started) * 1e3,
                merged=self.team.merged_ticks,
            ),
            sends,
            MapReport(tick=tick, wireframe=self._map_bytes) if changed else None,
            lambda: (
                ScanReport(tick=tick, wireframe=encode_wireframe(seen)),
                PoseReport(tick=tick, pose=pose, teammates=self.team.places.teammates(tick)),
            ),
        )

    def _looks_round(self) -> bool:
        """Whether the robot stands and looks: first of all, where odometry errs, until it knows how its frame lies."""
        if self._look_round is None:
            return False
        if not self._look_round.goes_on(self._knows_little):
            self._look_round = None
            return False
        self.perception.take_scans(self._look_round.scans)
        return True

    def _knows_little(self) -> bool:
        """Whether the robot would know how its frame lies better if it looked on: not once it was moved or pushed."""
        return self.perception.takes_as_one and self.filter.first_heading_sd() > HELD_RAD

    def look(self, observation: Observation) -> Pose:
        """Take a tick in which the robot must stand, or somebody else drives it: it maps on, and plans nothing.

        Returns where it is in its own frame, m, m, rad.
        What others say meanwhile is thrown away, so any disc may be one of them: a stranger without a name is heard.
        """
        self._map_scan(observation, {""})
        self.team.changed = False  # what changed in the last step is known to `_laying`
        self._draw_map(observation.tick, self._own.update(self.filter.wireframe()))
        self._looks_round()  # who must stand looks, too
        return self.filter.pose

    def _talk(self, tick: int, pose: Pose, scan: CornerScan) -> list[Send]:
        """What the robot says in this tick: where it is, and what changed of its map and of what it looked at."""
        viewpoints, ends = self.explorer.viewpoints, self.explorer.goals.in_vain
        is_laid = not (self.team.merged and self._laying.waits)
        looked = self.team.views.looked(tick, viewpoints.ticks, viewpoints.own, ends, is_laid)
        places, contacts = self.team.places, self.exchange.contacts
        in_sight = self.config.cooperation.sharing and len(scan.discs) > 0
        in_sight = in_sight and bool(places.strange_to(contacts) or places.strangers_among(tick, contacts))
        frames, asks = self.team.frames, self.team.asks_for_views
        return self.exchange.talk(tick, pose, self._told_to(), self._told_version, looked, frames, in_sight, asks)

    def _map_scan(self, observation: Observation, heard: set[str]) -> CornerScan:
        """Perceive a scan and merge it into the filter's map: the corner scan. heard: who was heard in this tick."""
        tick, poses, way = observation.tick, observation.poses(), self.filter.way(observation.poses())
        places, strangers = self.team.places.lately(tick), self.team.places.strangers_among(tick, heard)
        pose, known = self.filter.pose, self.wireframe
        scan = self.perception.see(observation, way, pose, known, len(heard) > 0, places, strangers=strangers)
        if self._update.take_due(tick):
            self.filter.update(scan, poses, places, tick)
        else:
            self.filter.move(poses, slips=scan.touching)
        if self.loops and self.loops.take(
            tick, scan, pose_of(way[-1]), self.filter.length_scale, self.filter.pose, self.filter.covariance
        ):
            settled = self.loops.settled()
            self.filter.replace(records_of(settled.walls), settled.pose, settled.places)
            self.explorer.mend(settled)
            self.team.mend(settled)
            self._laying = Laying(self.spec.lidar.rate_hz)  # what was laid lies on the torn map: it is laid at once
            self.perception.forget_posts()
            self.exchange.tell_frames_anew()
        self.perception.remember(tick, self.filter.pose)
        return scan

    def _situation(self, tick: int, scan: CornerScan, seen: Wireframe) -> Situation:
        """What the robot knows before it decides. seen: the scan as a wireframe."""
        partners, silent = self.team.places.partners(tick, self.robot)
        margin_m = margin_of(range_noise(self.spec.lidar))
        return Situation(
            tick=tick,
            wireframe=self.wireframe,
            version=self._map.version,
            pose=self.filter.pose,
            seen=seen,
            discs=scan.discs,
            close=scan.close,
            errand=self.team.errand,
            partners=partners,
            silent=silent,
            viewpoints=self.team.views.places,
            withdrawn=self.team.views.withdrawn,
            left_ends=self.team.views.ends,
            glimpses=self.filter.glimpses,
            sees_past=lambda places, aside_m: sees_places(places, aside_m, view_of(scan, self.filter.pose, margin_m)),
            strangers=self.team.places.strange_to(self.exchange.contacts),
            pose_sd_m=self.filter.place_sd_m,
            exactness=self.filter.exactness,
        )

    def _nbytes(self) -> int:
        """Bytes of the filter, of the submaps, and of the places seen and tried."""
        loops = self.loops.submaps.nbytes if self.loops else 0
        return self.filter.nbytes + self.explorer.nbytes + loops

    def _draw_map(self, tick: int, own_changed: bool) -> None:
        """Lay merged maps over the own one."""
        merged, new, merged_anew = self.team.merged, self.own, False
        if merged:
            rests = self.explorer.complete
            if not self._laying.take_due(tick, len(merged), own_changed, self.team.changed, rests):
                return
            new = self.filter.wireframe_with([peer.laid.layer for peer in merged], SAME_WALL_M)
            merged_anew = self._laying.merged_anew
        changed = self._map.update(new)
        # a layer that lies wholly on own walls changes nothing that is shown, but what may be told to whom
        self._told_version += changed or merged_anew

    def _told_to(self) -> Callable[[str], Wireframe]:
        """What each peer is told: own walls, and those that other merged peers saw themselves.

        A peer's own walls never come back to it (split horizon, as in routing): it would keep what it has dropped.
        """
        merged = self.team.merged
        layer_of = {peer.log.name: k for k, peer in enumerate(merged)}
        told = self.filter.told_with([peer.laid.first_hand for peer in merged], SAME_WALL_M)
        return lambda peer: told(layer_of.get(peer)) if layer_of.keys() - {peer} else self.own
