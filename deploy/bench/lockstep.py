"""`wireswarm bench lockstep`: what processes and Zenoh cost, by ticks a second of robots that do not think."""

import time
from collections.abc import Sequence

from agent.config import AgentConfig
from agent.robot import Step
from deploy import inprocess
from deploy.bench.cases import Case, Figures, each
from deploy.bench.explored import launched, mute_step, read_json
from deploy.bench.tables import Table, whole
from deploy.config import RunConfig
from deploy.sensing import of_benchmark
from protocol.messages import Action, Heard, Observation, RobotSpec


class Thoughtless:
    """Stands still and says as little as the protocol allows."""

    def __init__(self, robot: str, spec: RobotSpec, config: AgentConfig, seed: int) -> None: ...

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
        """Answer at once."""
        return mute_step(Action(tick=observation.tick, speed_mps=0.0, turn_rps=0.0), observation.odometry)


def cases(quick: bool) -> list[Case]:
    """Teams of several sizes in maze-15, or a smaller world where quick; alone each: their figures are times."""
    fixed = {"world": "apartment" if quick else "maze-15", "ticks": 300 if quick else 2000}
    return each("lockstep/{robots}", measure, fixed, alone=True, robots=(1, 3) if quick else (1, 3, 10))


def measure(world: str, robots: int, ticks: int) -> Figures:
    """Ticks a second with processes and in one process."""
    rate_hz = RobotSpec().lidar.rate_hz
    settings = {"world": world, "robots": robots, "until": ticks / rate_hz}
    config = RunConfig.model_validate(of_benchmark(settings))
    times: list[float] = []  # of the ends of ticks
    inprocess.run(config, config.agent, None, lambda _: times.append(time.perf_counter()), Thoughtless)
    alone = (len(times) - 1) / (times[-1] - times[0])
    with launched(settings, Thoughtless) as (folder, _):
        shells = rate_hz * read_json(folder / "summary.json")["real_time_factor"]
    return {
        "robots": robots,
        "ticks_per_s": round(shells),
        "ticks_per_s_one_process": round(alone),
        "shell_ms_per_tick_and_robot": round((1e3 / shells - 1e3 / alone) / robots, 3),
    }


HEADS = "robots; ticks_per_s; ticks_per_s_one_process; shell_ms_per_tick_and_robot: shell ms / tick, robot"
TABLES = [Table("lockstep", "Robots that do not think, in processes and in one", whole("lockstep/*"), HEADS)]
