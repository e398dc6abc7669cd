"""A run in one process without a network: the same minds in the same world, for benchmarks and tests."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from agent.config import AgentConfig
from protocol.messages import Heard, Observation, RobotSpec
from world.config import WorldConfig
from world.episode import Episode, Outputs

if TYPE_CHECKING:
    from agent.robot import Step


class Mind(Protocol):
    """What a robot is to its shell: `agent.robot.Robot`, or a script in a test."""

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
        """One turn of the control loop."""
        ...


MakeMind = Callable[[str, RobotSpec, AgentConfig, int], Mind]


def run(
    config: WorldConfig,
    agent_config: AgentConfig,
    out: Path | None,
    progress: Callable[[Episode], None] | None = None,
    make_mind: MakeMind | None = None,
) -> dict[str, Any]:
    """Run to the end and return the fields of summary.json; `out` is the run directory, None to write nothing.

    `progress` is called after every tick. What a mind raises ends the run as interrupted and is raised.
    """
    if make_mind is None:
        from agent.robot import Robot  # numba's half second, not for those who bring their own minds

        make_mind = Robot
    begin = time.perf_counter()
    episode = Episode(config, out)
    try:
        minds = {}
        for robot in episode.robots:
            welcome = episode.welcome(robot)
            minds[robot] = make_mind(robot, welcome.spec, agent_config, welcome.seed)
        while episode.ended is None:
            outputs = {}
            for robot, (heard, observation) in episode.inputs().items():
                step = minds[robot].step(observation, heard)
                outputs[robot] = Outputs(step.sends, step.action, step.map)
            episode.advance(outputs)
            if progress is not None:
                progress(episode)
    finally:
        episode.wall_s = time.perf_counter() - begin
        episode.close()
    return episode.summary()
