"""Settings of the world, with units and reasons."""

from typing import Annotated, Literal, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from protocol.messages import MAX_ROBOTS, MTU_BYTES, RobotSpec
from protocol.settings import Config, Positive, is_to_come, shaped
from world.radio.config import RadioConfig

FaultText = Annotated[str, shaped(r"[a-z][a-z0-9_-]{0,15}@[1-9][0-9]{0,8}", "ROBOT@TICK, such as r2@100")]


class WorldConfig(Config):
    """One run, as the world sees it."""

    world: str = "maze-15"
    """Name of a bundled world, generated-WIDTHxHEIGHT-SEED for a maze (sides in metres), or a world file."""
    robots: Annotated[int, Field(ge=1, le=MAX_ROBOTS)] = 3
    """Number of robots: r1, r2, ..."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Everything random in a run is drawn from it."""
    starts: Literal["file", "random"] = "file"
    """`random` draws all starts from the seed, even where the file gives spawns."""
    until: Literal["complete"] | Positive = "complete"
    """`complete`: end when all live robots are complete in one tick. A number: end after so many simulated seconds."""
    max_time_s: Positive = 7200.0
    """Simulated seconds after which the run ends in any case. No bundled world takes a robot two hours."""
    people: Annotated[int, Field(ge=0, le=100)] = 0
    """People who walk about on ways drawn from the seed; lidars see their legs or coats, and they touch nobody."""
    snapshot_s: Positive = 10.0
    """Simulated seconds between two maps in snapshots/."""
    scans: bool = False
    """Whether every scan is kept, as measured, in scans/: 13 kB a simulated second and robot. `wireswarm export --to
    carmen` needs them."""
    faults: list[FaultText] = Field([], max_length=1000)
    """Robots whose process is killed and started again, each with the tick at which, such as r2@100: for tests of
    recovery. A run in one process does the same with its minds."""
    spec: RobotSpec = RobotSpec()
    """Body and lidar of every robot."""
    radio: RadioConfig = RadioConfig()
    """Who hears whom. What robots say, and how often, is `agent.radio`."""

    @field_validator("spec")
    @classmethod
    def _radio_once(cls, spec: RobotSpec) -> RobotSpec:
        if (spec.radio_range_m, spec.radio_mtu_bytes) != (None, MTU_BYTES):
            raise ValueError("the robots' radio follows from radio.range_m and radio.mtu_bytes: set these")
        return spec

    @model_validator(mode="after")
    def _faults_of_robots(self, info: ValidationInfo) -> Self:
        for fault in self.faults if is_to_come(info) else ():
            if fault.partition("@")[0] not in self.robot_ids:
                raise ValueError(f"faults: {fault} is of no robot that takes part")
        return self

    @model_validator(mode="after")
    def _radio_of_robots(self, info: ValidationInfo) -> Self:
        for robot in self.radio.named() if is_to_come(info) else ():
            if robot not in self.robot_ids:
                raise ValueError(f"radio.models: {robot} is no robot that takes part")
        return self

    @model_validator(mode="after")
    def _ends_at_its_time(self) -> Self:
        if self.until != "complete" and self.until > self.max_time_s:
            raise ValueError(f"until: {self.until:g} s are more than max_time_s, {self.max_time_s:g}: raise that, too")
        return self

    @property
    def robot_ids(self) -> list[str]:
        """r1, r2, ..."""
        return [f"r{number + 1}" for number in range(self.robots)]


class ServerConfig(Config):
    """How robots reach the world."""

    listen: str | None = None
    """Endpoint such as tcp/0.0.0.0:7447; null for a free port of 127.0.0.1."""
    connect: str | None = None
    """Endpoint of a Zenoh router between the world and its robots; null: the world is the router."""
    insecure: bool = False
    """Whether the world may listen beyond this machine though anybody could take part, with neither certificates nor
    secrets."""
    access_control: bool = True
    """Whether `wireswarm run` gives each robot a secret, with which it reads and writes its own keys only."""
    real_time: Positive | None = None
    """Simulated seconds per second of the clock; null for lockstep, which goes as fast as the robots answer."""
    begin_with: Annotated[int, Field(ge=1)] | None = None
    """Robots that must be ready for the run to begin; null for all. The others may join later, and stand until then."""
    join_timeout_s: Positive = 60.0
    """Seconds until all robots must be ready. One that was let in may still compile its kernels, `silence_s` more."""
    silence_s: Positive = 300.0
    """Seconds without a word after which a robot counts as dead, if nobody knows of the end of its process. A step
    takes some ms, but the first ones compile kernels where installation did not (a minute, measured with three robots
    on two cores), and a machine may stand still for a while."""

    @model_validator(mode="after")
    def _one_router(self, info: ValidationInfo) -> Self:
        if is_to_come(info) and self.listen is not None and self.connect is not None:
            raise ValueError("listen goes without connect: the world is the router, or connects to one")
        return self
