"""What a step costs by stage, and how fast whole runs are: a part of several benchmarks."""

import os

import numpy as np

from agent.robot import Robot, Step
from deploy.bench.cases import Case, Figures
from deploy.bench.explored import Stopwatch, explore, launched, read_json
from deploy.bench.tables import Row, Table, runs_of, whole
from protocol.messages import Observation

WARM = 25  # steps before the clock counts: kernels are compiled or loaded in them


def load() -> float:
    """Processes that wanted a core in the last minute: above the number of cores, times are too long."""
    return round(os.getloadavg()[0], 2)


def measure_stages(world: str, limit_s: float) -> Figures:
    """Milliseconds of a step by stage, in a whole run of one robot with default settings."""
    clock = Stopwatch()
    spent: dict[str, list[float]] = {"whole step": [], "perception": [], "filter": [], "planning": []}

    def watch(robot: Robot, _: Observation, step: Step) -> None:
        clock.seconds["whole step"] = 1e-3 * step.action.step_ms
        for stage, times in spent.items():
            times.append(1e3 * clock.seconds.pop(stage, 0.0))
        if len(spent["whole step"]) == 1:  # from the second step on
            robot.perception.see = clock.timed("perception", robot.perception.see)  # type: ignore[method-assign]
            robot.filter.update = clock.timed("filter", robot.filter.update)  # type: ignore[method-assign]
            for part in ("look", "drive_forward", "place_of_contact", "frontier", "default_state", "drive"):
                setattr(robot.explorer, part, clock.timed("planning", getattr(robot.explorer, part)))

    run = explore({"world": world, "robots": 1, "max_time_s": limit_s}, {}, watch)
    stages: list[Row] = []
    for stage, all_times in spent.items():
        times = np.array(all_times[WARM:])
        row = {"median": np.median(times), "mean": times.mean(), "p99": np.percentile(times, 99)}
        stages.append({"stage": stage, **row})
    return {"stages": stages, "particles": len(run.robots["r1"].filter.edges), "load": load()}


def measure_speed(world: str, robots: int, until: float | str) -> Figures:
    """Simulated seconds per second of `wireswarm run`: one process each, and Zenoh between them."""
    with launched({"world": world, "robots": robots, "until": until}) as (folder, ended):
        summary = read_json(folder / "summary.json")
    steps = [robot["step_ms_median"] for robot in summary["robots"].values()]
    factor = summary["real_time_factor"]
    return {"real_time_factor": factor, "step_ms_median": max(steps), "ended": ended, "load": load()}


def cases(quick: bool) -> list[Case]:
    """One robot's steps by stage and a run of three, alone each: their figures are times."""
    world, limit_s, until = ("apartment", 60.0, 60.0) if quick else ("maze-15", 3600.0, "complete")
    return [
        Case("speed/stages", measure_stages, {"world": world, "limit_s": limit_s}, alone=True),
        Case("speed/run", measure_speed, {"world": world, "robots": 3, "until": until}, alone=True),
    ]


TABLES = [
    Table(
        "stages",
        lambda figures: f"A step of one robot, {figures['speed/stages']['particles']} particles",
        lambda figures: [row for run in runs_of(figures, "speed/stages") for row in run["stages"]],
        "stage; median <= 5: median ms; mean: mean ms; p99: 99 % ms",
        judged=lambda row: row["stage"] == "whole step",
        note=lambda figures: (
            f"The whole step has radio and coding, too. Load of the machine {figures['speed/stages']['load']:g}."
        ),
    ),
    Table(
        "speed",
        "wireswarm run, 3 robots",
        whole("speed/run"),
        "real_time_factor >= 30: times real time; step_ms_median: median step ms; ended; load",
    ),
]
