"""Every message that travels, as pydantic models; `protocol.codec` turns them to bytes and back.

Units: metres, radians, seconds; a pose is (x, y, theta), counter-clockwise.
"""

from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Strict, StringConstraints

from protocol.arrays import Floats
from protocol.settings import MAX_NUMBER

PROTOCOL_VERSION = 2

EVERYONE = "*"
"""The receiver of a broadcast."""
MAX_TEXT = 1000
"""Characters of a text (ours)."""
MAX_EVENT_DEPTH = 8
"""Levels of nested values in an event (ours). A transform in a list of candidates is at level 4."""
MAX_EVENT_NODES = 10_000
"""Values in one event (ours)."""
MTU_BYTES = 1200
"""The longest message that goes on the air by default: below what any IP link carries in one piece."""

ID = r"^[a-z][a-z0-9_-]{0,15}$"
"""Pattern of a robot's name, which becomes part of keys and file names."""
Kind = Annotated[str, StringConstraints(pattern=ID)]
RobotId = Kind
Receiver = Annotated[str, StringConstraints(pattern=r"^(\*|[a-z][a-z0-9_-]{0,15})$")]
Text = Annotated[str, StringConstraints(max_length=MAX_TEXT)]
Count = Annotated[int, Field(ge=0, le=2**40)]
Tick = Count
Payload = Annotated[bytes, Field(max_length=2**20)]


def _bounded_json(value: dict[str, Any]) -> dict[str, Any]:
    """The value, if it is JSON, bounded and small. It is walked without recursion, so that no depth is a danger."""
    left = MAX_EVENT_NODES
    level: list[Any] = [value]
    for _ in range(MAX_EVENT_DEPTH):
        below: list[Any] = []
        for node in level:
            match node:
                case dict():
                    if any(not isinstance(key, str) or len(key) > MAX_TEXT for key in node):
                        raise ValueError("a key is no short text")
                    below.extend(node.values())
                case list() | tuple():
                    below.extend(node)
                case str():
                    if len(node) > MAX_TEXT:
                        raise ValueError(f"a text of more than {MAX_TEXT} characters")
                case float():
                    if not abs(node) <= MAX_NUMBER:  # NaN is not
                        raise ValueError(f"not within {MAX_NUMBER:g}")
                case bool() | int() | None:
                    pass
                case _:
                    raise ValueError(f"{type(node).__name__} is no JSON value")
        left -= len(below)
        if left < 0:
            raise ValueError(f"more than {MAX_EVENT_NODES} values")
        if not below:
            return value
        level = below
    raise ValueError(f"nested deeper than {MAX_EVENT_DEPTH}")


def _ranges(value: bytes) -> bytes:
    if len(value) % 4:
        raise ValueError("not a whole number of float32")
    if not (np.frombuffer(value, "<f4") >= 0).all():  # NaN is not
        raise ValueError("a range is negative or not a number")
    return value


Finite = Annotated[float, Field(ge=-MAX_NUMBER, le=MAX_NUMBER, allow_inf_nan=False)]
FinitePose = Annotated[tuple[Finite, Finite, Finite], Strict(False)]


class Message(BaseModel):
    """Immutable, strict, and free of unknown fields."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class LidarSpec(Message, use_attribute_docstrings=True):
    """A scanning lidar; the default is the LDS-01 of a TurtleBot3 Burger, by its data sheet."""

    beams: Annotated[int, Field(ge=8, le=4096)] = 360
    """Beams over a full turn; beam k points at k * 2 pi / beams from the robot's heading."""
    rate_hz: Annotated[Finite, Field(ge=0.01, le=100)] = 5.0
    """Scans a second; a tick of the run is one scan."""
    range_min_m: Annotated[Finite, Field(ge=0, le=100)] = 0.12
    """Metres; a nearer wall returns nothing."""
    range_max_m: Annotated[Finite, Field(ge=0.05, le=100)] = 3.5
    """Metres; a farther wall returns nothing."""
    noise_m: Annotated[Finite, Field(ge=0, le=1)] = 0.01
    """Standard deviation of a range, metres."""
    dropout: Annotated[Finite, Field(ge=0, le=1)] = 0.0
    """Probability that a beam returns nothing."""


class OdometrySpec(Message, use_attribute_docstrings=True):
    """Dead reckoning: exact by default (paper III), or with errors that add up (ours)."""

    noisy: bool = False
    """Whether the errors below are added."""
    distance_sd: Annotated[Finite, Field(ge=0, le=1000)] = 0.02
    """Metres of error along the path, per square root of a metre driven."""
    heading_sd_deg: Annotated[Finite, Field(ge=0, le=1000)] = 1.0
    """Degrees of heading error, per square root of a metre driven."""
    turn_sd: Annotated[Finite, Field(ge=0, le=1000)] = 0.02
    """Radians of heading error, per square root of a radian turned."""


class RobotSpec(Message, use_attribute_docstrings=True):
    """A differential-drive robot; the default is the TurtleBot3 Burger."""

    radius_m: Annotated[Finite, Field(ge=0.01, le=5)] = 0.105
    """Radius of the body, metres."""
    max_speed_mps: Annotated[Finite, Field(ge=1e-3, le=10)] = 0.22
    """Largest speed, metres a second."""
    max_turn_rps: Annotated[Finite, Field(ge=1e-3, le=20)] = 2.84
    """Largest turn rate, radians a second."""
    lidar: LidarSpec = LidarSpec()
    """The robot's lidar."""
    odometry: OdometrySpec = OdometrySpec()
    """The robot's odometry."""
    radio_range_m: Annotated[Finite, Field(gt=0)] | None = None
    """Radio range, which the world fills in from `radio.range_m`; None where the radio has no such limit."""
    radio_mtu_bytes: Annotated[int, Field(ge=64)] = MTU_BYTES
    """The longest message on the air, which the world fills in from `radio.mtu_bytes`."""


class Join(Message):
    """Robot to world, a query on robots/ID/srv/join: let me in."""

    version: int
    robot: RobotId
    session: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{0,32}$")] = ""
    """The robot's Zenoh ID, by which the world knows its link."""
    process: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{0,16}$")] = ""
    """Drawn by the robot's process, by which the world tells one that comes back from a new one."""


class Welcome(Message):
    """World to robot, the reply: body, clock and seed, and nothing of the world."""

    version: int
    robot: RobotId
    spec: RobotSpec
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    """The robot's own seed, drawn from the run's seed."""
    lockstep: bool
    run: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{16}$")]
    """Which run this is: a robot that comes back to it goes on, and begins anew in another."""
    tick: Tick = 0
    """The tick at which the robot joins: 0 before the run begins."""


class Refused(Message):
    """World to robot, the other reply: the robot may not take part."""

    reason: Text


class End(Message):
    """World to robot, the last message: the run is over for this robot."""

    reason: Text
    """`complete`, `time` or `interrupted` end the run for all; another reason is why this robot was given up."""


class Observation(Message):
    """World to robot, the last of a tick's messages on robots/ID/in/**."""

    tick: Tick
    ranges: Annotated[bytes, Field(max_length=4 * 4096), AfterValidator(_ranges)]
    """float32 little-endian metres, one per beam; inf where nothing came back."""
    odometry: FinitePose
    """In the robot's own frame, which is its start pose."""
    heard: Count = 0
    """How many Heard of the same tick came before."""

    def scan(self) -> Floats:
        """Ranges as (beams,) float64 metres; inf where nothing came back."""
        return np.frombuffer(self.ranges, "<f4").astype(np.float64)


class Heard(Message):
    """World to robot: what came through the radio gate."""

    tick: Tick
    sender: RobotId
    kind: Kind
    payload: Payload


class Send(Message):
    """Robot to world: a message for other robots, which only the radio gate can deliver."""

    tick: Tick
    to: Receiver
    kind: Kind
    payload: Payload


class Event(Message):
    """A line of events.jsonl."""

    event: Kind
    data: Annotated[dict[str, Any], AfterValidator(_bounded_json)] = {}
    """JSON values, numbers within MAX_NUMBER, of limited size."""


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
    """Wall-clock time of the step; it is reported and changes nothing."""
    merged: dict[RobotId, Tick] = {}
    """Peers whose maps are part of the robot's, with the ticks of these maps."""


class ScanReport(Message):
    """Telemetry on robots/ID/out/scan: the corner scan in the robot's frame."""

    tick: Tick
    wireframe: Payload


class MapReport(Message):
    """Telemetry on robots/ID/out/map: the robot's map in its own frame, sent when it changed."""

    tick: Tick
    wireframe: Payload


class TeammatePose(Message):
    """Where a peer is, as far as the robot knows."""

    robot: RobotId
    tick: Tick
    """When it was there."""
    pose: FinitePose
    """In the frame of the robot that knows it."""
    covariance: Annotated[tuple[Finite, ...], Strict(False), Field(min_length=9, max_length=9)]
    """3 x 3 of x, y, theta, row by row: m2, m rad, rad2; grows while the peer is not heard."""
    status: Annotated[str, StringConstraints(pattern=r"^(proposed|merged)$")]
    """Whether the peer's transform is on trial or accepted."""


class PoseReport(Message):
    """Telemetry on robots/ID/out/pose: the robot's pose in its own frame, and what it knows of teammates."""

    tick: Tick
    pose: FinitePose
    teammates: list[TeammatePose] = []


class Clock(Message):
    """World to anybody, some times a second: how far the run is. Nothing in it depends on the walls."""

    tick: Tick
    t: Annotated[Finite, Field(ge=0)]
    """Simulated seconds."""
    status: dict[RobotId, Text]
    """Per robot: `exploring`, `complete`, `away` (its link is lost, and awaited) or `dead`."""
    ended: Text | None = None
    """How the run ended: `complete`, `time`, `dead`, `interrupted`; None while it goes on."""


class LinkReport(Message):
    """One directed link on which something was heard lately."""

    sender: RobotId
    receiver: RobotId
    loss: Annotated[Finite, Field(ge=0, le=1)]
    """Share of the last seconds' messages that did not arrive."""
    bytes: Count
    """Delivered since the start."""


class LinkTable(Message):
    """World to anybody, with the clock: who hears whom. No positions are in it."""

    tick: Tick
    links: Annotated[list[LinkReport], Field(max_length=250_000)]


class Progress(Message):
    """World to viewers with its credential: what only the truth can judge."""

    clock: Clock
    coverage: dict[RobotId, Finite]
    """Per robot: share of the visible wall, 0 to 1."""
    team: Finite
    """The union of all robots."""
    late_ticks: Count = 0
    """Ticks that a robot missed in real time."""
