"""A scripted robot for tests of the shells: drives until something is near, turns, and says a little of all."""

import math
import os
import signal
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agent.config import AgentConfig
from protocol.messages import (
    EVERYONE,
    Action,
    Event,
    Heard,
    MapReport,
    Observation,
    PoseReport,
    RobotSpec,
    ScanReport,
    Send,
)
from protocol.wireframe import Wireframe, encode_wireframe


class Turn(NamedTuple):
    """As agent.robot.Step."""

    action: Action
    sends: list[Send]
    scan: ScanReport
    pose: PoseReport
    map: MapReport | None


class Wanderer:
    """Complete after `ticks`; what it does depends on its scan, its seed and what it heard."""

    def __init__(self, robot: str, spec: RobotSpec, config: AgentConfig, seed: int, ticks: int = 100) -> None:
        self.robot, self.spec, self.ticks = robot, spec, ticks
        self.rng = np.random.default_rng(seed)
        self.heard_bytes = 0

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Any:
        tick, scan = observation.tick, observation.scan()
        self.heard_bytes += sum(len(message.payload) for message in heard)
        ahead = np.fmin(scan, self.spec.lidar.range_max_m)[np.arange(-40, 41)]
        blocked = ahead.min() < 0.4
        near = np.where(np.isfinite(scan), scan, 0.0)[::30]
        angle = np.arange(len(near)) * math.tau / len(near)
        points = near[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        edges = np.stack([np.arange(len(near) - 1), np.arange(1, len(near))], axis=1).astype(np.int32)
        wireframe = encode_wireframe(
            Wireframe(
                points,
                np.zeros(len(points), np.uint8),
                edges,
                np.ones(len(edges), np.float32),
                np.ones(len(edges), np.bool_),
            )
        )
        sends = [Send(tick=tick, to=EVERYONE, kind="map", payload=wireframe)] if tick % 5 == 0 else []
        action = Action(
            tick=tick,
            speed_mps=0.0 if blocked else 0.2,
            turn_rps=1.0 if blocked else float(self.rng.normal(0, 0.1)),
            sent=len(sends),
            complete=tick >= self.ticks,
            events=[Event(event="contact", data={"heard": self.heard_bytes})] if heard else [],
        )
        return Turn(
            action,
            sends,
            ScanReport(tick=tick, wireframe=wireframe),
            PoseReport(tick=tick, pose=observation.odometry),
            MapReport(tick=tick, wireframe=wireframe) if tick % 5 == 0 else None,
        )


def endless(robot: str, spec: RobotSpec, config: AgentConfig, seed: int) -> Wanderer:
    """Never complete."""
    return Wanderer(robot, spec, config, seed, ticks=2**40)


class Sleeper(Wanderer):
    """r2 is slow: takes half a second for each step."""

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Any:
        if self.robot == "r2":
            time.sleep(0.5)
        return super().step(observation, heard)


class Held(Wanderer):
    """Slow while the file is there that the environment names in HOLD, so that a run does not end before its test."""

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Any:
        if Path(os.environ["HOLD"]).exists():
            time.sleep(0.02)
        return super().step(observation, heard)


class Misbehaving(Wanderer):
    """r2 answers for the wrong tick, r3 has a mistake in its program, r4 dies as of `kill -9`."""

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Any:
        turn = super().step(observation, heard)
        match self.robot, observation.tick:
            case "r2", 5:
                return turn._replace(action=turn.action.model_copy(update={"tick": 4}))
            case "r3", 10:
                raise ZeroDivisionError("as promised")
            case "r4", 15:
                os.kill(os.getpid(), signal.SIGKILL)
        return turn


def lame(robot: str, spec: RobotSpec, config: AgentConfig, seed: int) -> Wanderer:
    """r3 and r4 fail before the others, which are slow, begin."""
    if robot in ("r3", "r4"):
        raise ZeroDivisionError("as promised")
    time.sleep(1.0)
    return Wanderer(robot, spec, config, seed)


class _Stillborn:
    """Ends the process that unpickles it, which never becomes a robot."""

    def __reduce__(self) -> tuple[object, tuple[int]]:
        return os._exit, (7,)

    def __call__(self, robot: str, spec: RobotSpec, config: AgentConfig, seed: int) -> Wanderer:
        raise AssertionError("never called")


stillborn = _Stillborn()
