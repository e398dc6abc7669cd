"""What a robot costs in a crowd: CPU of a robot and tick in teams of growing size, each robot with as much room."""

import time
from statistics import median

from deploy import inprocess
from deploy.bench.cases import Case, Figures, each
from deploy.bench.tables import Outcomes, Row, Table, by_label
from deploy.config import RunConfig
from deploy.sensing import of_benchmark

SIDES = {3: "13x12", 10: "23x23", 30: "40x40", 100: "73x73"}
"""Mazes by the robots in them, m: 52 to 53 m2 a robot."""
SEEDS = {3: 4, 10: 3, 30: 2, 100: 1}
"""Runs of each: small teams differ more from run to run."""
TICKS = 300


def cases(quick: bool) -> list[Case]:
    """Each size alone, as its figures are times."""
    made = []
    for robots, side in list(SIDES.items())[: 2 if quick else None]:
        fixed = {"robots": robots, "side": side, "ticks": 50 if quick else TICKS}
        seeds = range(1 if quick else SEEDS[robots])
        made += each(f"crowd/{robots}/{{seed}}", measure, fixed, alone=True, seed=seeds)
    return made


def measure(robots: int, side: str, seed: int, ticks: int) -> Figures:
    """Milliseconds of CPU of a robot and tick, its share of the world's included, from the second tick on."""
    settings = {"world": f"generated-{side}-{seed}", "robots": robots, "seed": seed, "starts": "random"}
    config = RunConfig.model_validate(of_benchmark(settings))
    config = config.model_copy(update={"until": ticks / config.spec.lidar.rate_hz})
    spent: list[float] = []
    inprocess.run(config, config.agent, None, lambda _: spent.append(time.thread_time()))
    return {"ms": round(1e3 * (spent[-1] - spent[0]) / (len(spent) - 1) / robots, 4)}


def _rows(figures: Outcomes) -> list[Row]:
    """A row a size of the team."""
    ms = {robots: median(run["ms"] for run in runs) for robots, runs in by_label(figures, "crowd/{robots}/*").items()}
    return [{"robots": int(robots), "ms": one, "ratio": one / next(iter(ms.values()))} for robots, one in ms.items()]


TABLES = [
    Table(
        "crowd",
        "A robot and tick in one process, with the same room for each robot",
        _rows,
        "robots; ms: CPU ms, median; ratio <= 1.5: to the first",
    )
]
