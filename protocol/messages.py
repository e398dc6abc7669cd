"""Every message that travels, as pydantic models; `protocol.codec` turns them to bytes and back.

Units: metres, radians, seconds; a pose is (x, y, theta), counter-clockwise.
"""

import math
from collections.abc import Iterable
from itertools import chain, islice
from typing import Annotated, Any, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    FailFast,
    Field,
    Strict,
    StringConstraints,
    model_validator,
)

from protocol.arrays import Floats
from protocol.errors import ProtocolError
from protocol.geometry import Pose, wrapped
from protocol.settings import MAX_NUMBER
from protocol.wireframe import MAX_COORDINATE_M

PROTOCOL_VERSION = 3

EVERYONE = "*"
"""The receiver of a broadcast."""
MAX_ROBOTS = 500
"""Robots of a run (ours)."""
MAX_TEXT = 1000
"""Characters of a text (ours)."""
MAX_EVENTS = 1000
"""Events of a robot in a tick (ours)."""
WORLD_EVENTS = frozenset({"dead", "joined", "left", "muted", "rejoined"})
"""Of what becomes of a robot: only the world says so, and whoever reads events.jsonl believes it."""
MAX_EVENT_DEPTH = 8
"""Levels of nested values in an event (ours). A transform in a list of candidates is at level 4."""
MAX_EVENT_VALUES = 10_000
"""Values in all events of a robot in a tick (ours): they take some ms to check."""
MTU_BYTES = 1200
"""The longest message that goes on the air by default: below what any IP link carries in one piece."""
MAX_WAY = 1000
"""Poses of the odometry in one observation (ours)."""
MAX_BEAMS = 4096
"""Beams of a scan (ours): a tenth of a degree apart."""
MAX_AROUND = 4 * MAX_BEAMS
"""Beams of a whole revolution, as close as those of a lidar that looks at less (ours). Who maps fills up what it leaves
out: in 0.1 s a scan with so many; 4096 over one degree took more than 1 s."""
MOST_LINKS = 12_000
"""Links in one table (ours): a row takes 80 bytes at most, a message 1 MiB. 110 robots that all hear each other."""

ID = r"^[a-z][a-z0-9_-]{0,15}$"
"""Pattern of a robot's name, which becomes part of keys and file names."""
Kind = Annotated[str, StringConstraints(pattern=ID)]
RobotId = Kind
Receiver = Annotated[str, StringConstraints(pattern=r"^(\*|[a-z][a-z0-9_-]{0,15})$")]
Text = Annotated[str, StringConstraints(max_length=MAX_TEXT)]
Count = Annotated[int, Field(ge=0, le=2**40)]
MAX_TICK = 2**32 - 1
"""What a beacon has room for (ours): 27 years at 5 Hz."""
Tick = Annotated[int, Field(ge=0, le=MAX_TICK)]
Payload = Annotated[bytes, Field(max_length=2**20)]


def clipped(text: str) -> str:
    """As much of a text as a message holds: what a robot did wrong may quote it at length."""
    return text[:MAX_TEXT]


def _of_a_robot(event: str) -> str:
    if event in WORLD_EVENTS:
        raise ValueError(f"only the world says {event}")
    return event


def _bounded_json(value: dict[str, Any]) -> dict[str, Any]:
    """The value, if it is JSON and bounded. It is walked without recursion, so that no depth is a danger."""
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
                case float() | int():
                    if not abs(node) <= MAX_NUMBER:  # NaN is not
                        raise ValueError(f"not within {MAX_NUMBER:g}")
                case None:
                    pass
                case _:
                    raise ValueError(f"{type(node).__name__} is no JSON value")
        if not below:
            return value
        level = below
    raise ValueError(f"nested deeper than {MAX_EVENT_DEPTH}")


def _ranges(value: bytes) -> bytes:
    if len(value) % 4:
        raise ValueError("not a whole number of float32")
    if (np.frombuffer(value, "<f4") < 0).any():
        raise ValueError("a range is negative")
    return value


def _way(value: bytes) -> bytes:
    if len(value) % 24:
        raise ValueError("not a whole number of poses of three float64")
    if not (np.abs(np.frombuffer(value, "<f8")) <= MAX_NUMBER).all():  # NaN is not
        raise ValueError(f"a pose is not within {MAX_NUMBER:g}")
    return value


Finite = Annotated[float, Field(ge=-MAX_NUMBER, le=MAX_NUMBER, allow_inf_nan=False)]
FinitePose = Annotated[tuple[Finite, Finite, Finite], Strict(False)]


class Message(BaseModel):
    """Immutable, strict, and free of unknown fields."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class LidarSpec(Message, use_attribute_docstrings=True):
    """A scanning lidar; the default is the LDS-01 of a TurtleBot3 Burger, by its data sheet."""

    beams: Annotated[int, Field(ge=8, le=MAX_BEAMS)] = 360
    """Beams of a scan, evenly over the field of view: beam k points at `bearings()[k]`."""
    turning: bool = True
    """Whether beams are taken one after the other while the lidar turns, the last one at the scan's stamp; else all at
    the stamp (paper)."""
    field_of_view_deg: Annotated[Finite, Field(ge=1, le=360)] = 360.0
    """Degrees that a scan looks at."""
    first_beam_deg: Annotated[Finite, Field(ge=-360, le=360)] = 0.0
    """Degrees counter-clockwise from the lidar's own heading to beam 0."""
    clockwise: bool = False
    """Whether the lidar turns clockwise as seen from above."""
    mount_x_m: Annotated[Finite, Field(ge=-5, le=5)] = 0.0
    """Metres by which the lidar stands before the middle of the axle, which is the robot's origin."""
    mount_y_m: Annotated[Finite, Field(ge=-5, le=5)] = 0.0
    """Metres by which it stands left of it."""
    mount_yaw_deg: Annotated[Finite, Field(ge=-360, le=360)] = 0.0
    """Degrees counter-clockwise from the robot's heading to the lidar's."""
    rate_hz: Annotated[Finite, Field(ge=0.01, le=100)] = 5.0
    """Scans a second; a tick of the run is one scan."""
    range_min_m: Annotated[Finite, Field(ge=0, le=100)] = 0.12
    """Metres; a nearer wall is not measured."""
    range_max_m: Annotated[Finite, Field(ge=0.05, le=100)] = 3.5
    """Metres; a farther wall returns nothing."""
    noise_m: Annotated[Finite, Field(ge=0, le=1)] = 0.01
    """Standard deviation of a near range, metres: the data sheet's +-10 mm below 0.5 m, read as one deviation as in the
    robot's Gazebo model. Its error of accuracy (+-15 mm, +-5 %) is one of the sensor's scale, which calibration takes
    out, and is left out."""
    noise_share: Annotated[Finite, Field(ge=0, le=1)] = 0.0175
    """Standard deviation of a far range, as a share of it; the larger of both holds. 0.0175 is the data sheet's +-3.5 %
    beyond 0.5 m, read as two deviations, as limits are without other notice (GUM, coverage factor 2)."""
    dropout: Annotated[Finite, Field(ge=0, le=1)] = 0.0
    """Probability that a beam is not measured, whatever it meets."""
    grazing_deg: Annotated[Finite, Field(ge=0, le=90)] = 3.0
    """Degrees between beam and wall at which a beam is lost with a probability of 1/e, and of less the steeper it
    meets: exp(-sin(angle) / sin(grazing_deg)). 3 loses one in 14 at 8 degrees and 1 in 14,000 at 30 (ours)."""
    mixed: Annotated[Finite, Field(ge=0, le=1)] = 0.2
    """Probability that one of the two beams at an edge reads a range between the near and the far surface: the width of
    a beam's footprint over the distance of two beams. 0.2 is a footprint of 3.5 mrad (ours)."""

    @model_validator(mode="after")
    def _is_not_too_fine(self) -> Self:
        if (around := self.beams * 360 / self.field_of_view_deg) > MAX_AROUND:
            fine = f"{self.beams} beams over {self.field_of_view_deg:g} degrees are {around:.0f} a revolution"
            raise ValueError(f"{fine}; at most {MAX_AROUND} are taken")
        return self

    @property
    def mount(self) -> Pose:
        """Where the lidar is on its robot, and where it points."""
        return self.mount_x_m, self.mount_y_m, math.radians(self.mount_yaw_deg)

    @property
    def beam_step(self) -> float:
        """Radians from a beam to the next one."""
        return math.radians(self.field_of_view_deg) / self.beams

    def bearings(self) -> Floats:
        """(beams,) rad from the robot's heading at a beam's moment, counter-clockwise, the mount's yaw included."""
        step = self.beam_step * (-1 if self.clockwise else 1)
        return math.radians(self.mount_yaw_deg + self.first_beam_deg) + step * np.arange(self.beams, dtype=np.float64)

    def view(self) -> tuple[float, float]:
        """Radians from the robot's heading to the middle of what the lidar sees, and from there to either side."""
        bearings = self.bearings()
        return float(wrapped(0.5 * (bearings[0] + bearings[-1]))), 0.5 * self.beams * self.beam_step

    def cleaned(self, readings: Floats) -> Floats:
        """Readings (beams,), m, as ranges: inf from the lidar's range on, NaN for no number, 0 and what is too near."""
        with np.errstate(invalid="ignore"):
            ranges = np.where(readings >= self.range_max_m, np.inf, readings)
            return np.where((ranges > 0.0) & (ranges >= self.range_min_m), ranges, np.nan)

    def moments(self) -> Floats:
        """(beams,) when each beam is taken: shares of the period that ends at the scan's stamp, in (0, 1].

        The lidar turns evenly. With a smaller field of view it looks at nothing in the first part of the period.
        """
        if not self.turning:
            return np.ones(self.beams)
        still_to_come = np.arange(self.beams - 1, -1, -1.0)
        return 1 - self.field_of_view_deg / 360 / self.beams * still_to_come


class OdometrySpec(Message, use_attribute_docstrings=True):
    """Dead reckoning with errors that add up (ours), or exact (paper III)."""

    noisy: bool = True
    """Whether the wheels have the errors below, and slip where the robot touches something."""
    distance_sd: Annotated[Finite, Field(ge=0, le=1000)] = 0.02
    """Metres of error along the path, per square root of a metre driven."""
    heading_sd_deg: Annotated[Finite, Field(ge=0, le=1000)] = 1.0
    """Degrees of heading error, per square root of a metre driven."""
    turn_sd: Annotated[Finite, Field(ge=0, le=1000)] = 0.02
    """Radians of heading error, per square root of a radian turned."""
    wheel_sd: Annotated[Finite, Field(ge=0, le=0.2)] = 0.01
    """Standard deviation of the size of each of the two wheels, drawn for each robot, as a share. Wheels that differ
    bend a straight drive: by 5 degrees a metre at one standard deviation."""
    axle_sd: Annotated[Finite, Field(ge=0, le=0.2)] = 0.01
    """Standard deviation of the distance between the wheels, drawn for each robot, as a share."""
    axle_m: Annotated[Finite, Field(ge=0.01, le=10)] = 0.16
    """Distance between the wheels, metres; that of a TurtleBot3 Burger."""
    rate_hz: Annotated[Finite, Field(ge=0.01, le=1000)] = 25.0
    """How often the wheels are read; at least once a scan. A TurtleBot3 publishes its odometry at 20 to 30 Hz."""


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

    @property
    def poses_per_scan(self) -> int:
        """How many poses of the odometry come with each scan."""
        return min(max(round(self.odometry.rate_hz / self.lidar.rate_hz), 1), MAX_WAY)


class Join(Message):
    """Robot to world, a query on robots/ID/srv/join: let me in; or on robots/ID/srv/leave: I go, wait no more."""

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


Ranges = Annotated[bytes, Field(max_length=4 * MAX_BEAMS), AfterValidator(_ranges)]


class Observation(Message):
    """World to robot, the last of a tick's messages on robots/ID/in/**. Its stamp is the end of a revolution."""

    tick: Tick
    ranges: Ranges
    """float32 little-endian metres, one per beam; inf where nothing came back, NaN where nothing was measured."""
    odometry: FinitePose
    """At the stamp, in the robot's own frame, which is its start pose."""
    way: Annotated[bytes, Field(max_length=24 * MAX_WAY), AfterValidator(_way)] = b""
    """float64 little-endian poses in the same frame, at equal steps of the period since the last stamp; the last one is
    `odometry`. Empty where the wheels were read at the stamp only."""
    heard: Count = 0
    """How many Heard of the same tick came before."""

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        if self.way and self.way[-24:] != np.array(self.odometry, "<f8").tobytes():
            raise ValueError("the way does not end at the odometry's pose")
        if np.abs(self.poses()[:, :2]).max() > MAX_COORDINATE_M:
            raise ValueError(f"odometry of more than {MAX_COORDINATE_M:g} m")
        return self

    def check(self, beams: int) -> None:
        """Raise ProtocolError for a scan of another lidar than one of so many beams."""
        if len(self.ranges) != 4 * beams:
            raise ProtocolError(f"a scan of {len(self.ranges) // 4} ranges from a lidar of {beams} beams")

    def scan(self) -> Floats:
        """Ranges as (beams,) float64 metres; inf where nothing came back, NaN where nothing was measured."""
        return scan_of(self.ranges)

    def poses(self) -> Floats:
        """(k, 3) poses of `way`; of the stamp alone where there is none."""
        poses = self.way or np.array(self.odometry, "<f8").tobytes()
        return np.frombuffer(poses, "<f8").astype(np.float64).reshape(-1, 3)


def scan_of(ranges: bytes) -> Floats:
    """The ranges of a message as `Observation.scan` gives them."""
    return np.frombuffer(ranges, "<f4").astype(np.float64)


class Heard(Message):
    """World to robot: a message of another robot that came through the radio gate."""

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


class SharedPlace(Message):
    """Robot to robots that hear it without a world: where it is, by which each judges whether it is in range."""

    x_m: Finite
    y_m: Finite


class Event(Message):
    """A robot's line of events.jsonl."""

    event: Annotated[Kind, AfterValidator(_of_a_robot)]
    data: Annotated[dict[str, Any], AfterValidator(_bounded_json)] = {}
    """JSON values, numbers within MAX_NUMBER, of limited size."""


def values_in(events: Iterable[Any]) -> int:
    """How many values there are in events, or in what may become such; one too many where there are more."""
    level = [_data(event) for event in events]
    count = 0
    while level and count <= MAX_EVENT_VALUES:
        level = list(islice(chain.from_iterable(map(_within, level)), MAX_EVENT_VALUES + 1 - count))
        count += len(level)
    return count


def _data(event: Any) -> Any:
    if isinstance(event, Event):
        return event.data
    return event.get("data") if isinstance(event, dict) else None


def _within(value: Any) -> Iterable[Any]:
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, list | tuple) else ()


def _of_few_values(events: Any) -> Any:
    """Events, if they are few enough to be looked at."""
    if isinstance(events, list) and values_in(events) > MAX_EVENT_VALUES:
        raise ValueError(f"more than {MAX_EVENT_VALUES} values")
    return events


class Action(Message):
    """Robot to world, the last of a tick's messages: how it drives, and how it does."""

    tick: Tick
    speed_mps: Finite
    turn_rps: Finite
    sent: Count = 0
    """How many Send of the same tick came before."""
    complete: bool = False
    """Whether the robot has nothing left to explore."""
    events: Annotated[list[Event], FailFast(), Field(max_length=MAX_EVENTS), BeforeValidator(_of_few_values)] = []
    map_bytes: Count = 0
    """Of the map as `MapReport` carries it."""
    filter_bytes: Count = 0
    """Of its own map with all that goes on with it, and of places seen, felt and tried; not of peers' maps."""
    step_ms: Annotated[Finite, Field(ge=0)] = 0.0
    """Wall-clock time of the step; it is reported and changes nothing."""
    merged: Annotated[dict[RobotId, Tick], Field(max_length=MAX_ROBOTS)] = {}
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
    """Where a peer is whose frame is proposed or known, as far as the robot knows."""

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
    teammates: Annotated[list[TeammatePose], FailFast(), Field(max_length=MAX_ROBOTS)] = []


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
    links: Annotated[list[LinkReport], Field(max_length=MOST_LINKS)]
    left_out: Count = 0
    """Links beside these, which carried fewer bytes: MOST_LINKS are told."""


class Progress(Message):
    """World to viewers with its credential: what only the truth can judge."""

    clock: Clock
    coverage: dict[RobotId, Finite]
    """Per robot: share of the visible wall, 0 to 1."""
    team: Finite
    """The union of all robots."""
    late_ticks: Count = 0
    """Ticks that a robot missed in real time."""


class Site(Message):
    """World to viewers with its credential, once a second while one reads: what stays the same in a run."""

    world: Text
    """The world's name."""
    solid: Payload
    """Its walls and obstacles, as the WKB of polygons (OGC 06-103r4), metres."""
    spec: RobotSpec
    frames: dict[RobotId, FinitePose]
    """Per robot, in their order: the pose of its own frame in the world."""


class Whereabouts(Message):
    """World to viewers with its credential, ten times a second at most while one reads: where the robots truly are."""

    tick: Tick
    poses: dict[RobotId, FinitePose]
    ranges: dict[RobotId, Ranges]
    """Of live robots, as in their observations."""
