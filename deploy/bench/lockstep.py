"""What the processes and Zenoh cost: ticks a second with robots that do not think, with and without a network."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agent.config import AgentConfig
from agent.robot import Step
from deploy import inprocess
from deploy.config import RunConfig
from deploy.launcher import launch
from protocol.messages import Action, Heard, Observation, PoseReport, RobotSpec, ScanReport
from protocol.wireframe import Wireframe, encode_wireframe


class Thoughtless:
    """Stands still and says as little as the protocol allows."""

    def __init__(self, robot: str, spec: RobotSpec, config: AgentConfig, seed: int) -> None:
        self._nothing = encode_wireframe(Wireframe())

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
        """Answer at once."""
        tick = observation.tick
        return Step(
            action=Action(tick=tick, speed_mps=0.0, turn_rps=0.0),
            sends=[],
            scan=ScanReport(tick=tick, wireframe=self._nothing),
            pose=PoseReport(tick=tick, pose=observation.odometry),
            map=None,
        )


def measure(quick: bool) -> list[dict[str, Any]]:
    """One row per number of robots, in maze-15, or a smaller world where quick."""
    rows = []
    for robots in (1, 3) if quick else (1, 3, 10):
        ticks = 300 if quick else 2000
        settings = {"world": "apartment" if quick else "maze-15", "robots": robots, "until": ticks / 5}
        config = RunConfig.model_validate(settings)
        with tempfile.TemporaryDirectory() as folder:
            alone = _one_process(config)
            out = Path(folder) / "run"
            launch(config, out, command_line=[], robot_factory=Thoughtless)
            factor = json.loads((out / "summary.json").read_text(encoding="utf-8"))["real_time_factor"]
            shells = factor * config.spec.lidar.rate_hz
        rows.append(
            {
                "robots": robots,
                "ticks_per_s": round(shells),
                "ticks_per_s_one_process": round(alone),
                "shell_ms_per_tick_and_robot": round((1e3 / shells - 1e3 / alone) / robots, 3),
            }
        )
    return rows


def _one_process(config: RunConfig) -> float:
    """Ticks a second without processes and network, from the end of the first tick."""
    times: list[float] = []
    inprocess.run(config, config.agent, None, lambda episode: times.append(time.perf_counter()), Thoughtless)
    return (len(times) - 1) / (times[-1] - times[0])
