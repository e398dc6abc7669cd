"""The configuration of a whole run."""

from collections.abc import Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any, Self

from pydantic import ValidationInfo, model_validator

from agent.config import ProcessConfig
from agent.shell.ros2.config import Ros2Config
from protocol import configuration
from protocol.configuration import ConfigError
from protocol.messages import EVERYONE
from protocol.settings import is_to_come
from world.config import ServerConfig, WorldConfig

ONE_PROCESS = ("server.begin_with", "server.real_time")
"""Settings by which a run with processes differs, and one process has no use for."""


class RunConfig(WorldConfig, ProcessConfig):
    """A whole run: the world's settings at the top, the robots' minds and the processes below."""

    restart: bool = False
    """Whether `wireswarm run` starts a process that dies again; robots then keep checkpoints to go on from."""
    server: ServerConfig = ServerConfig()
    """How the world meets its robots."""
    ros2: Ros2Config = Ros2Config()
    """How robots of ROS 2 are reached."""

    @model_validator(mode="after")
    def _minds_of_robots(self, info: ValidationInfo) -> Self:
        for robot in self.mind if is_to_come(info) else ():
            if robot not in (EVERYONE, *self.robot_ids):
                raise ValueError(f"mind: {robot:.60} is no robot that takes part")
        return self

    @model_validator(mode="after")
    def _enough_to_begin(self, info: ValidationInfo) -> Self:
        if is_to_come(info) and (first := self.server.begin_with) is not None and first > self.robots:
            raise ValueError(f"server.begin_with: {first} robots are more than the {self.robots} that take part")
        return self


def check_heeded(config: RunConfig, keys: Sequence[str], by: str) -> None:
    """Raise ConfigError where a setting, by dotted key, is not as by default: `by` has no use for these."""
    default = RunConfig()
    for key in keys:
        if attrgetter(key)(config) != attrgetter(key)(default):
            raise ConfigError(f"{key}: {by} has no use for it, so leave it out")


def load(file: Path | None = None, flags: Mapping[str, Any] | None = None, sets: Sequence[str] = ()) -> RunConfig:
    """Configuration of a run, as `protocol.configuration.load` reads it. Raises ConfigError."""
    return configuration.load(RunConfig, file, flags, sets)
