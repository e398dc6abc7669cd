"""Robots that follow a script: they drive about, send what they are told to, and map nothing true."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agent.config import AgentConfig
from protocol.messages import Action, Event, Heard, MapReport, Observation, PoseReport, RobotSpec, ScanReport, Send
from protocol.wireframe import Wireframe, encode_wireframe


class ScriptedStep(NamedTuple):
    action: Action
    sends: list[Send]
    scan: ScanReport
    pose: PoseReport
    map: MapReport | None


class Wanderer:
    """Drives on while the way is free, else turns; broadcasts once a simulated second; draws from its seed."""

    def __init__(
        self, robot: str, spec: RobotSpec, config: AgentConfig, seed: int, complete_at: int | None = None
    ) -> None:
        self.robot, self.spec = robot, spec
        self.rng = np.random.default_rng(seed)
        self.complete_at = complete_at
        self.heard: list[Heard] = []
        corner = Wireframe(
            points=np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]),
            labels=np.array([2, 0, 1], np.uint8),
            edges=np.array([[0, 1], [1, 2]], np.int32),
            likelihood=np.ones(2, np.float32),
            own=np.array([True, False]),
        )
        self.wireframe = encode_wireframe(corner)

    def step(self, observation: Observation, heard: Sequence[Heard]) -> ScriptedStep:
        tick = observation.tick
        assert observation.heard == len(heard)
        assert all(message.tick == tick for message in heard)
        self.heard += heard
        ahead = np.fmin.reduce(np.roll(observation.scan(), 25)[:51], initial=np.inf)  # NaN: not measured
        turn = float(self.rng.normal(0, 0.2)) if ahead > 0.4 else 1.5
        sends = [Send(tick=tick, to="*", kind="map", payload=self.wireframe)] if tick % 5 == 0 else []
        events = [Event(event="contact", data={"peer": m.sender, "tick": -1}) for m in heard[:1] if tick % 50 == 1]
        return ScriptedStep(
            action=Action(
                tick=tick,
                speed_mps=0.2 if ahead > 0.4 else 0.0,
                turn_rps=turn,
                sent=len(sends),
                complete=self.complete_at is not None and tick >= self.complete_at,
                events=events,
                map_bytes=len(self.wireframe),
            ),
            sends=sends,
            scan=ScanReport(tick=tick, wireframe=self.wireframe),
            pose=PoseReport(tick=tick, pose=observation.odometry),
            map=MapReport(tick=tick, wireframe=self.wireframe) if tick % 5 == 0 else None,
        )
