"""What is around the robot in a tick: walls of map and scan, teammates, walls found by touch, and ways around them."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from agent.exploration.config import DrivingConfig
from agent.exploration.driving import Obstacles
from agent.exploration.planning import Roads
from agent.exploration.teammates import Teammates
from agent.exploration.touch import Touch
from agent.geometry.clearance import walls_near
from protocol.arrays import Floats
from protocol.geometry import Pose, apply
from protocol.messages import RobotSpec
from protocol.wireframe import Wireframe

NEAR_M = 1.5
"""Walls within this of the robot matter for the next commands; at full speed it drives 0.09 m in two."""


@dataclass(frozen=True)
class Situation:
    """What the robot knows in a tick. Metres and radians; the robot's own frame, if nothing else is said."""

    tick: int
    wireframe: Wireframe
    """The map."""
    version: int
    """Greater whenever the map changed structurally."""
    pose: Pose
    scan: Wireframe
    """Corners and walls seen now, frame of the robot's pose."""
    discs: Floats
    """(k, 2) centres of teammates seen now, frame of the robot's pose."""
    errand: Floats | None = None
    """(2,) where the robot is sent to verify a proposal."""
    rivals: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    """(k, 3) places of teammates that share the work, and metres by which each must be nearer to have a goal."""
    viewpoints: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    """(j, 2) places from where teammates have looked whose maps are merged."""


@dataclass(frozen=True, kw_only=True)
class Scene(Situation):
    """The same with what follows from it, frame of the map."""

    here: Floats
    """(2,) the place of the pose."""
    walls: Floats
    """(m, 4) all that may not be driven through or seen through."""
    near: Obstacles
    """What the next commands must not touch."""


class Surroundings:
    """Memory of what the map does not hold: teammates, and walls found by touch."""

    def __init__(self, driving: DrivingConfig, spec: RobotSpec) -> None:
        self.roomy_m = spec.radius_m + driving.path_air_m
        """Distance of paths from walls where there is room, metres."""
        self.tight_m = spec.radius_m + driving.tight_path_air_m
        """The same where there is less."""
        self.teammates = Teammates(spec)
        self.touch = Touch(spec, driving)

    def look(self, situation: Situation) -> Scene:
        """Take in what is seen."""
        tick, pose, scan = situation.tick, situation.pose, situation.scan
        here = np.array((float(pose[0]), float(pose[1])))
        known = situation.wireframe.segments()
        seen = apply(pose, scan.points)[scan.edges].reshape(-1, 4)
        discs = self.teammates.update(tick, apply(pose, situation.discs), known)
        standing, fronts = self.teammates.walls(tick), self.teammates.fronts(here)
        self.touch.feel(here)
        walls = np.ascontiguousarray(np.vstack((known, seen, standing, fronts, self.touch.walls)))
        near = Obstacles(walls_near(walls, here[0], here[1], NEAR_M), discs)
        return Scene(**vars(situation), here=here, walls=walls, near=near)

    def lasting_walls(self, scene: Scene) -> Floats:
        """(m, 4) walls of the map and those found by touch."""
        return np.vstack((scene.wireframe.segments(), self.touch.walls))

    def ways(self, scene: Scene, teammates: bool = True) -> Iterator[Roads]:
        """Ways from here with room, then tight ones; around teammates or through them, never through unseen walls."""
        for clearance in (self.roomy_m, self.tight_m):
            walls, nodes = self.touch.walls, self.touch.nodes(clearance)
            if teammates:
                walls = np.vstack((walls, self.teammates.walls(scene.tick)))
                nodes = np.vstack((nodes, self.teammates.nodes(scene.tick, clearance)))
            yield Roads(scene.wireframe, scene.here, clearance, walls, nodes)
