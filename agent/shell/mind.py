"""What a shell needs of the robot in it, so that tests and other programs can bring their own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol

from agent.config import AgentConfig
from protocol.messages import Heard, Observation, RobotSpec

if TYPE_CHECKING:
    from agent.robot import Step


class Mind(Protocol):
    """A robot without clock or network, such as agent.robot.Robot."""

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
        """Take one tick: an observation and the messages heard with it."""
        ...


MakeMind = Callable[[str, RobotSpec, AgentConfig, int], Mind]
"""Makes a mind of a robot's name, body, settings and seed, as agent.robot.Robot does."""
