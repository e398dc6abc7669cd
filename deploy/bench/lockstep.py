"""`wireswarm bench lockstep`: what processes and Zenoh cost, by ticks a second of robots that do not think."""

import sys
import time
from collections.abc import Sequence

from agent.config import AgentConfig
from agent.robot import Step
from deploy import inprocess
from deploy.bench.benchmark import Benchmark
from deploy.bench.cases import Case, Figures, each
from deploy.bench.explored import launched, read_json
from deploy.bench.tables import Table, columns, whole
from deploy.config import RunConfig
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


def cases(quick: bool) -> list[Case]:
    """Teams of several sizes in maze-15, or a smaller world where quick; alone each: their figures are times."""
    fixed = {"world": "apartment" if quick else "maze-15", "ticks": 300 if quick else 2000}
    return each("lockstep/{robots}", measure, fixed, alone=True, robots=(1, 3) if quick else (1, 3, 10))


def measure(world: str, robots: int, ticks: int) -> Figures:
    """Ticks a second with processes and in one process."""
    spec = RobotSpec()
    settings = {"world": world, "robots": robots, "until": ticks / spec.lidar.rate_hz}
    alone = _one_process(RunConfig.model_validate(settings))
    with launched(settings, Thoughtless) as (folder, _):
        factor = read_json(folder / "summary.json")["real_time_factor"]
    shells = factor * spec.lidar.rate_hz
    return {
        "robots": robots,
        "ticks_per_s": round(shells),
        "ticks_per_s_one_process": round(alone),
        "shell_ms_per_tick_and_robot": round((1e3 / shells - 1e3 / alone) / robots, 3),
    }


def _one_process(config: RunConfig) -> float:
    """Ticks a second without processes and network, from the end of the first tick."""
    times: list[float] = []
    inprocess.run(config, config.agent, None, lambda episode: times.append(time.perf_counter()), Thoughtless)
    return (len(times) - 1) / (times[-1] - times[0])


COLUMNS = columns("robots; ticks_per_s; ticks_per_s_one_process; shell_ms_per_tick_and_robot: shell ms / tick, robot")
TABLES = [Table("lockstep", "Robots that do not think, in processes and in one", whole("lockstep/*"), COLUMNS)]
BENCHMARK = Benchmark("lockstep", (sys.modules[__name__],))
