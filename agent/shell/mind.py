"""What a shell needs of the robot in it, and a base for minds of your own, which need not be part of the project."""

from __future__ import annotations

import sys
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from inspect import getsourcefile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from agent.config import AgentConfig
from protocol.errors import InputError
from protocol.geometry import Pose
from protocol.messages import EVERYONE, Action, Heard, MapReport, Observation, PoseReport, RobotSpec, ScanReport, Send
from protocol.wireframe import Wireframe, encode_wireframe

if TYPE_CHECKING:
    from agent.robot import Step


class Mind(Protocol):
    """A robot without clock or network, such as agent.robot.Robot. It may have OwnMind's `look`, too."""

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
        """Take one tick: an observation and the messages heard with it."""
        ...


MakeMind = Callable[[str, RobotSpec, AgentConfig, int], Mind]
"""Makes a mind of a robot's name, body, settings and seed, as agent.robot.Robot does."""


class OwnMind:
    """A base for minds of your own: derive from it, write `drive`, run it by `wireswarm run --mind package:Class`."""

    complete = False
    """Set it when there is nothing left to explore; a run until complete ends when all robots say so."""

    def __init__(self, robot: str, spec: RobotSpec, config: AgentConfig, seed: int) -> None:
        """Be `robot`, with the body `spec`. Draw all that is random from `self.random`, and runs can be repeated."""
        self.robot, self.spec = robot, spec
        self.random = np.random.default_rng(seed)
        self._sends: list[tuple[str, str, bytes]] = []
        self._map: Wireframe | None = None

    @abstractmethod
    def drive(self, observation: Observation, heard: Sequence[Heard]) -> tuple[float, float]:
        """Take one tick: what was seen, and the messages heard. Returns speed (m/s) and turn rate (rad/s, left)."""
        raise NotImplementedError

    def look(self, observation: Observation) -> Pose | None:
        """Take a tick in which a ROS 2 robot must stand, or somebody else drives it.

        Returns where it is in its map: by odometry, unless you write it; None where that is not to be shown.
        """
        return observation.odometry

    def send(self, kind: str, payload: bytes, to: str = EVERYONE) -> None:
        """Give the radio a message in this tick, for one robot or whoever hears it; it may get lost.

        At most `spec.radio_mtu_bytes` long, else the radio drops it. kind: a name under which its bytes are counted.
        """
        self._sends.append((to, kind, payload))

    def show(self, wireframe: Wireframe) -> None:
        """Publish a map in the robot's own frame, metres: it is recorded and scored, and no robot can read it."""
        self._map = wireframe

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
        """What the shell calls."""
        from agent.robot import Step  # only here, as it brings all of our own mind

        tick = observation.tick
        self._sends, self._map = [], None
        speed, turn = self.drive(observation, heard)
        sends = [Send(tick=tick, to=to, kind=kind, payload=payload) for to, kind, payload in self._sends]
        action = Action(tick=tick, speed_mps=speed, turn_rps=turn, sent=len(sends), complete=self.complete)
        shown = None if self._map is None else MapReport(tick=tick, wireframe=encode_wireframe(self._map))
        scan, pose = ScanReport(tick=tick, wireframe=encode_wireframe(Wireframe())), observation.odometry
        return Step(action, sends, shown, lambda: (scan, PoseReport(tick=tick, pose=pose)))


@dataclass(frozen=True)
class Minds:
    """Makes the mind that is named for each robot; ours where none is."""

    names: Mapping[str, str]
    """package:Class by robot, `*` for all others, as in the setting `mind`."""

    def __call__(self, robot: str, spec: RobotSpec, config: AgentConfig, seed: int) -> Mind:
        """Make a mind."""
        name = self.names.get(robot) or self.names.get(EVERYONE)
        if name is None:
            from agent.robot import Robot

            return Robot(robot, spec, config, seed)
        mind: Mind = _class(name)(robot, spec, config, seed)
        return mind


def minds_of(names: Mapping[str, str]) -> MakeMind | None:
    """What makes the minds of the setting `mind`; None where all are ours. Raises InputError where one is not there."""
    for name in names.values():
        _class(name)
    return Minds(names) if names else None


def source_of(name: str) -> Path | None:
    """The file in which a mind, package:Class, is written; None where it has none. Raises InputError."""
    try:
        file = getsourcefile(_class(name))
    except TypeError:  # it is not written in Python
        return None
    return None if file is None else Path(file)


def _class(name: str) -> Any:
    """A class by package:Class, its package installed or in the working directory."""
    package, _, what = name.partition(":")
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)  # last, so that nothing there hides what is installed
    try:
        module = import_module(package)
    except ImportError as error:
        raise InputError(f"--mind {name:.200}: {error}") from None
    except (Exception, SystemExit) as error:  # a module runs as it is imported, and may raise anything
        why = f"{type(error).__name__}: {error}"
        raise InputError(f"--mind {name:.200}: {package:.200} fails on import: {why}") from None
    try:
        found = getattr(module, what)
    except AttributeError as error:
        raise InputError(f"--mind {name:.200}: {error}") from None
    if not callable(getattr(found, "step", None)):
        raise InputError(f"--mind {name:.200}: a mind is a class with a method `step` (agent.shell.mind)")
    return found
