"""A run in one process without a network: the same minds in the same world, for benchmarks and tests."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from agent.config import AgentConfig
from agent.robot import Robot, Step
from agent.shell.checkpoint import Keeps, period
from agent.shell.mind import MakeMind, Mind
from agent.state import State
from deploy import manifest
from deploy.launch.faults import schedule
from world.config import WorldConfig
from world.episode import Episode
from world.tick import Outputs


def run(
    config: WorldConfig,
    agent_config: AgentConfig,
    out: Path | None,
    progress: Callable[[Episode], None] | None = None,
    make_mind: MakeMind | None = None,
    watch: Callable[[str, Step], None] | None = None,
) -> dict[str, Any]:
    """Run to the end and return the fields of summary.json; `out` is the run directory, None to write nothing.

    `progress` is called after every tick, `watch` before with every robot and its step. What a mind raises ends the run
    as interrupted and is raised.
    """
    begin = time.perf_counter()
    episode = Episode(config, out)
    if out is not None:
        begun = manifest.begun(config, episode.world)
        begun["config"]["agent"] = agent_config.model_dump(mode="json")
        manifest.begin(out, begun)
    try:

        def make(robot: str) -> Mind:
            welcome = episode.welcome(robot)
            return (make_mind or Robot)(robot, welcome.spec, agent_config, welcome.seed)

        keeping = period(config.spec.lidar.rate_hz)
        faults, kept = schedule(config.robot_ids, config.faults), dict[str, State]()
        minds = {robot: make(robot) for robot in episode.robots}
        while episode.ended is None:
            for robot in episode.live:
                if episode.tick in faults[robot]:
                    episode.came_back(robot)
                    mind = minds[robot] = make(robot)
                    if isinstance(mind, Keeps) and robot in kept:
                        mind.restore(kept[robot])
            tick = episode.tick
            steps = {robot: minds[robot].step(seen, heard) for robot, (heard, seen) in episode.inputs().items()}
            if watch is not None:
                for robot, step in steps.items():
                    watch(robot, step)
            episode.advance({robot: Outputs(step.sends, step.action, step.map) for robot, step in steps.items()})
            if config.faults and keeping.take_due(tick):
                kept = {robot: mind.state() for robot, mind in minds.items() if isinstance(mind, Keeps)}
            if progress is not None:
                progress(episode)
    finally:
        episode.wall_s = time.perf_counter() - begin
        try:
            episode.close()
        finally:
            if out is not None:
                manifest.finish(out, ended=episode.ended)
    return episode.summary()
