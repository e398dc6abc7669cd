"""What is around the robot in a tick: walls of map and scan, teammates, walls found by touch, and ways around them."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from agent.errand import Errand
from agent.exploration.close_walls import CloseWalls, fronts
from agent.exploration.config import DrivingConfig
from agent.exploration.driving import CLEAR_SIDE_M, LOOKAHEAD_M, Obstacles, horizon_m, limits_of, passing_m, sees_m
from agent.exploration.glimpses import SeesPast, sees_nothing
from agent.exploration.path import GIVE_M
from agent.exploration.planning import NODE_SHARE, Roads, circle
from agent.exploration.sweep import RANGE_SHARE
from agent.exploration.teammates import Teammates
from agent.geometry.clearance import walls_near
from agent.mapping.exactness import Exactness
from agent.mapping.submaps.settled import Settled
from agent.period import WakingTime, in_ticks
from protocol.arrays import Floats
from protocol.geometry import Pose, apply, pose_of
from protocol.messages import RobotSpec
from protocol.wireframe import Wireframe

NEAR_M = 1.5  # walls within this of the robot matter for the next two commands, but see `_near_m`
PUSHING_SHARE = 0.3  # a robot that gets on by less than this share of what was commanded pushes against something
PUSHING_S = 1.0  # a robot that has pushed for so long pushes against an unseen wall
MOST_WALLS = 50  # most unseen walls kept in memory (32 bytes each): 12 m of glass


@dataclass(frozen=True)
class Situation:
    """What the robot knows in a tick. Metres and radians; the frame of the map, the robot's own, unless said."""

    tick: int
    wireframe: Wireframe  # the map
    version: int  # of the map, greater whenever it changed
    pose: Pose
    seen: Wireframe  # corners and walls seen now, frame of the robot's pose
    discs: Floats  # (k, 2) centres of teammates seen now, frame of the robot's pose
    close: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    """(c, 3) sectors of what is close and neither wall nor teammate: bearings from and to, and metres to it."""
    errand: Errand | None = None  # the drive to verify a proposal; whoever drives says how it ended
    partners: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    """(k, 3) teammates that share the work, heard lately: place, and metres by which each must be nearer to a task."""
    silent: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    """(j, 3) the same of those that have been silent for a while."""
    viewpoints: Floats = field(default_factory=lambda: np.zeros((0, 2)))  # (j, 2) of teammates with merged maps
    withdrawn: int = 0  # times that some of these were taken back
    left_ends: Floats = field(default_factory=lambda: np.zeros((0, 4)))
    """(v, 4) open ends that are left to teammates, which looked at them in vain, and unit: where their walls go on."""
    glimpses: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    """(g, 2) middles of what the last mapped scan hit and is no wall yet: the same array until another is mapped."""
    sees_past: SeesPast = sees_nothing  # which places the scan sees past, frame of the map
    strangers: Sequence[str] = ()  # those in contact that do not know where the robot's frame lies
    pose_sd_m: float = 0.0  # standard deviation of the place of the pose
    exactness: Exactness = field(default_factory=Exactness)  # of the map


@dataclass(frozen=True, kw_only=True)
class Scene(Situation):
    """A situation with what follows from it, in the frame of the map."""

    awake: int  # ticks for which the robot has been so: what it is given time for goes by them
    here: Floats  # (2,) the place of the pose
    walls: Floats  # (m, 4) all that may not be driven through or seen through
    near: Obstacles  # what the next commands must not touch


class Touch:
    """Whether the robot pushes against something, and the unseen walls, such as panes of glass, that it met so."""

    def __init__(self, spec: RobotSpec, driving: DrivingConfig) -> None:
        self.spec = spec
        self.walls = np.zeros((0, 4))  # (b, 4) as wide as the body with its air, frame of the map
        self._met = np.zeros(0, np.int64)  # (b,) ticks
        self._half_m = spec.radius_m + driving.wall_air_m
        self._commanded_m = 0.0  # metres that the last command was to drive
        self._pushing = 0  # commands in a row that moved the robot by too little
        self._last = np.full(2, math.inf)

    @property
    def pushes(self) -> bool:
        """Whether the robot has pushed against something for a while."""
        return self._pushing >= in_ticks(PUSHING_S, self.spec.lidar.rate_hz)

    def feel(self, here: Floats) -> None:
        """Compare how far the robot got with its last command; here: (2,) metres."""
        went = math.hypot(here[0] - self._last[0], here[1] - self._last[1])
        self._pushing = self._pushing + 1 if went < PUSHING_SHARE * self._commanded_m else 0
        self._last = here

    def command(self, speed_mps: float) -> None:
        """Note the command for this tick."""
        self._commanded_m = speed_mps / self.spec.lidar.rate_hz

    def remember(self, tick: int, pose: Pose) -> None:
        """Remember an unseen wall across the way just before the robot."""
        c, s = math.cos(pose[2]), math.sin(pose[2])
        off, half = self.spec.radius_m + GIVE_M, self._half_m
        x, y = pose[0] + off * c, pose[1] + off * s
        self.walls = np.vstack((self.walls, [x - half * s, y + half * c, x + half * s, y - half * c]))[-MOST_WALLS:]
        self._met = np.append(self._met, tick)[-MOST_WALLS:]

    def restore(self, walls: Floats) -> None:
        """Go on with walls (b, 4) from before; no map is merged anew with them."""
        self.walls, self._met = walls, np.zeros(len(walls), np.int64)

    def mend(self, settled: Settled) -> None:
        """Walls move with the part of the map in which the robot met them."""
        self.walls = settled.places(np.repeat(self._met, 2), self.walls.reshape(-1, 2)).reshape(-1, 4)

    def nodes(self, clearance_m: float) -> Floats:
        """(j, 2) places where paths that keep the clearance bend around these walls: eight around each end."""
        return (self.walls.reshape(-1, 1, 2) + NODE_SHARE * clearance_m * circle(8)).reshape(-1, 2)


class Surroundings:
    """Memory of what the map does not hold: teammates, and walls found by touch."""

    def __init__(self, driving: DrivingConfig, spec: RobotSpec) -> None:
        self.roomy_m = spec.radius_m + driving.path_air_m  # distance of paths from walls where there is room, metres
        self.tight_m = spec.radius_m + driving.tight_path_air_m  # the same where there is less
        aside_m = passing_m(limits_of(driving, spec)) + CLEAR_SIDE_M  # where it drives to pass a teammate
        ahead_m = max(LOOKAHEAD_M + horizon_m(spec), math.hypot(LOOKAHEAD_M, aside_m))
        self._near_m = max(NEAR_M, self.roomy_m + ahead_m)
        self._sight_m = RANGE_SHARE * sees_m(spec.lidar)
        self.teammates, self.touch, self._close = Teammates(spec), Touch(spec, driving), CloseWalls(spec)
        self._map, self._known = Wireframe(), np.zeros((0, 4))  # and its walls, as the map changes seldom
        self._awake = WakingTime(spec.lidar.rate_hz)

    @property
    def lasting(self) -> Floats:
        """(m, 4) walls of the map that was looked at last, and those found by touch."""
        return np.vstack((self._known, self.touch.walls))

    def mend(self, settled: Settled) -> None:
        """The map was torn and is merged anew: walls have moved with it, and teammates are forgotten."""
        self.touch.mend(settled)
        self._close.move(pose_of(settled.by[-1]))
        self.teammates.known = []

    def look(self, situation: Situation) -> Scene:
        """Take in what is seen."""
        tick, pose = situation.tick, situation.pose
        here = np.array((float(pose[0]), float(pose[1])))
        if situation.wireframe is not self._map:
            self._map, self._known = situation.wireframe, situation.wireframe.segments()
        seen = apply(pose, situation.seen.points)[situation.seen.edges].reshape(-1, 4)
        discs = apply(pose, situation.discs)
        self.teammates.update(tick, discs)
        self.touch.feel(here)
        walls = np.ascontiguousarray(np.vstack((self._known, seen, self.teammates.walls(tick), self.touch.walls)))
        discs = np.vstack((discs, self.teammates.too_near_to_see(tick, here[0], here[1])))
        hidden = self._close.hidden(here[0], here[1], seen, walls, fronts(situation.close, pose))
        near = Obstacles(np.vstack((walls_near(walls, here[0], here[1], self._near_m), hidden)), discs)
        return Scene(**vars(situation), awake=self._awake.at(tick), here=here, walls=walls, near=near)

    def ways(self, scene: Scene, teammates: bool = True) -> Iterator[Roads]:
        """Ways from here with room, then tight ones; around teammates or through them, never through unseen walls."""
        for clearance in (self.roomy_m, self.tight_m):
            yield self._ways(scene, clearance, teammates)

    def tight_ways(self, scene: Scene) -> Roads:
        """The last of `ways`, around teammates."""
        return self._ways(scene, self.tight_m, True)

    def _ways(self, scene: Scene, clearance: float, teammates: bool) -> Roads:
        walls, nodes, theirs = self.touch.walls, self.touch.nodes(clearance), None
        if teammates and self.teammates.in_the_way(scene.tick):
            walls = np.vstack((walls, self.teammates.walls(scene.tick)))
            nodes = np.vstack((nodes, self.teammates.nodes(scene.tick, clearance)))
            theirs = partial(self._ways, scene, clearance, False)
        return Roads(scene.wireframe, scene.here, clearance, walls, nodes, of_teammates=theirs, sight_m=self._sight_m)
