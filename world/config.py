"""All numbers of the world, with units and reasons."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from protocol.messages import RobotSpec
from protocol.settings import Config, NotNegative, Positive
from world.radio_config import RadioConfig


class PhysicsConfig(Config):
    """The bodies of the robots (facts/simulation.md)."""

    step_s: Positive = 0.02
    """Time of one physics step: at 0.22 m/s a robot moves 4 mm in it."""
    iterations: Annotated[int, Field(ge=1, le=100)] = 10
    """Rounds of the contact solver; measured to be enough."""
    slop_m: Positive = 1e-3
    """How far bodies may sink into each other at rest; pymunk's own 0.1 is meant for pixels."""
    mass_kg: Positive = 1.0
    """Of a TurtleBot3 Burger; decides only who pushes whom."""


class CoverageConfig(Config):
    """What of the walls counts as visible; the scorer's numbers."""

    piece_m: Positive = 0.05
    """Walls are counted in pieces of at most this length."""
    grazing_deg: NotNegative = 8.0
    """A wall seen flatter than this is not expected to be mapped."""
    grid_m: Positive = 0.30
    """Distance between the poses that visibility is tried from."""


class WorldConfig(Config):
    """One run, as the world sees it."""

    world: str = "maze-15"
    """A bundled world's name or a world file."""
    robots: Annotated[int, Field(ge=1, le=500)] = 3
    """r1, r2, ..."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """All that is random in a run is drawn from it."""
    starts: Literal["file", "random"] = "file"
    """`random` draws all starts from the seed, even where the file gives spawns."""
    until: Literal["complete"] | Positive = "complete"
    """End when all live robots are complete in one tick, or after so many simulated seconds."""
    max_time_s: Positive = 7200.0
    """End at this simulated time at the latest: no bundled world takes a robot two hours."""
    snapshot_s: Positive = 10.0
    """Simulated time between the maps kept in snapshots/."""
    spec: RobotSpec = RobotSpec()
    """Body and lidar of every robot."""
    physics: PhysicsConfig = PhysicsConfig()
    radio: RadioConfig = RadioConfig()
    coverage: CoverageConfig = CoverageConfig()


class ServerConfig(Config):
    """How the world meets its robots."""

    listen: str | None = None
    """Endpoint such as tcp/0.0.0.0:7447; None for a free port of 127.0.0.1."""
    access_control: bool = True
    """Whether `wireswarm run` gives each robot a secret of its own, and lets it read and write its own keys only."""
    real_time: Positive | None = None
    """Simulated seconds per second of the clock; None for lockstep, as fast as the robots answer."""
    join_timeout_s: Positive = 60.0
    """For all robots to be ready; a robot on a slow machine compiles its kernels at its first start."""
    silence_s: Positive = 300.0
    """In lockstep, for one answer, before a robot that is alive counts as dead. A step takes some ms, but the
    first ones compile kernels where that was not done before: a minute, measured with three robots on two cores."""
    farewell_s: Positive = 1.0
    """At the end, for the robots to go by themselves."""
    progress_s: Positive = 0.2
    """Between two messages of clock and progress, for a viewer to look alive."""
