"""Every message that travels, as pydantic models; `protocol.codec` turns them to bytes and back.

Units: metres, radians, seconds; a pose is (x, y, theta), counter-clockwise.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Strict, StringConstraints

PROTOCOL_VERSION = 1

EVERYONE = "*"
"""The receiver of a broadcast."""

RobotId = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_-]{0,15}$")]
Receiver = Annotated[str, StringConstraints(pattern=r"^(\*|[a-z][a-z0-9_-]{0,15})$")]
Kind = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_-]{0,15}$")]
Text = Annotated[str, StringConstraints(max_length=1000)]
Tick = Annotated[int, Field(ge=0, le=2**40)]
Count = Annotated[int, Field(ge=0, le=2**40)]


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError("not finite")
    return value


Finite = Annotated[float, AfterValidator(_finite)]
Pose = Annotated[tuple[Finite, Finite, Finite], Strict(False)]


class Message(BaseModel):
    """Immutable, strict, and free of unknown fields."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class LidarSpec(Message):
    """A scanning lidar; the default is the LDS-01 of a TurtleBot3 (facts/simulation.md)."""

    beams: Annotated[int, Field(ge=8, le=4096)] = 360
    """Beams over a full turn; beam k points at k * 2 pi / beams from the robot's heading."""
    rate_hz: Annotated[Finite, Field(gt=0, le=100)] = 5.0
    range_min_m: Annotated[Finite, Field(ge=0)] = 0.12
    range_max_m: Annotated[Finite, Field(gt=0, le=100)] = 3.5
    noise_m: Annotated[Finite, Field(ge=0, le=1)] = 0.01
    """Standard deviation of a range."""
    dropout: Annotated[Finite, Field(ge=0, le=1)] = 0.0
    """Probability that a beam returns nothing."""


class RobotSpec(Message):
    """A differential-drive robot; the default is the TurtleBot3 Burger."""

    radius_m: Annotated[Finite, Field(gt=0, le=5)] = 0.105
    max_speed_mps: Annotated[Finite, Field(gt=0, le=10)] = 0.22
    max_turn_rps: Annotated[Finite, Field(gt=0, le=20)] = 2.84
    lidar: LidarSpec = LidarSpec()


class Join(Message):
    """Robot to world, a query on robots/ID/srv/join: let me in."""

    version: int
    robot: RobotId


class Welcome(Message):
    """World to robot, the reply: what the robot must know of its body and clock, and nothing else."""

    version: int
    robot: RobotId
    spec: RobotSpec
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    """The robot's own seed, drawn from the run's; tells nothing of the world."""
    lockstep: bool


class Refused(Message):
    """World to robot, the other reply."""

    reason: Text


class Observation(Message):
    """World to robot, the last of a tick's messages on robots/ID/in/**."""

    tick: Tick
    ranges: Annotated[bytes, Field(max_length=4 * 4096)]
    """float32 little-endian metres, one per beam; inf where nothing came back."""
    odometry: Pose
    """In the robot's own frame, which is its start pose."""
    heard: Count = 0
    """How many Heard of the same tick came before."""

    def scan(self) -> NDArray[np.float64]:
        """Ranges as (beams,) float64 metres; inf where nothing came back."""
        return np.frombuffer(self.ranges, "<f4").astype(np.float64)


class Heard(Message):
    """World to robot: what came through the radio gate."""

    tick: Tick
    sender: RobotId
    kind: Kind
    payload: Annotated[bytes, Field(max_length=2**20)]


class Send(Message):
    """Robot to world: a message for another robot, which only the gate can deliver."""

    tick: Tick
    to: Receiver
    kind: Kind
    payload: Annotated[bytes, Field(max_length=2**20)]


class Event(Message):
    """Something that a researcher wants to know later; a line of events.jsonl."""

    event: Kind
    data: dict[Text, Any] = {}
    """JSON values only."""


class Action(Message):
    """Robot to world, the last of a tick."""

    tick: Tick
    speed_mps: Finite
    turn_rps: Finite
    sent: Count = 0
    """How many Send of the same tick came before."""
    complete: bool = False
    events: Annotated[list[Event], Field(max_length=1000)] = []
    map_bytes: Count = 0
    filter_bytes: Count = 0
    step_ms: Annotated[Finite, Field(ge=0)] = 0.0
    """Wall-clock time of the step; reported, never used."""


class ScanReport(Message):
    """Telemetry on robots/ID/out/scan: the corner scan in the robot's frame."""

    tick: Tick
    wireframe: Annotated[bytes, Field(max_length=2**20)]


class MapReport(Message):
    """Telemetry on robots/ID/out/map: the robot's map in its own frame, sent when it changed."""

    tick: Tick
    wireframe: Annotated[bytes, Field(max_length=2**20)]


class PoseReport(Message):
    """Telemetry on robots/ID/out/pose: the robot's pose in its own frame."""

    tick: Tick
    pose: Pose


class MapBroadcast(Message):
    """Robot to robot, the payload of kind "map": what the paper's robots send (section III)."""

    robot: RobotId
    pose: Pose
    """Where the sender is, in its own frame."""
    wireframe: Annotated[bytes, Field(max_length=2**20)]
