"""What a step costs, by stage, by particles and by the size of the map; and how fast whole runs are."""

import os
import time

import numpy as np

from agent.perception.perceive import perceive
from agent.robot import Robot, Step
from deploy.bench.cases import Case, Figures, each
from deploy.bench.explored import Stopwatch, explore, launched, read_json
from deploy.bench.filter.recording import record
from deploy.bench.layouts import path_of, present
from deploy.bench.tables import Outcomes, Row, Table, by_label, whole
from protocol.messages import Observation

PARTICLES = (1, 5, 10, 30, 100)
WARM = 25
"""Steps before the clock counts: kernels are compiled or loaded in them."""
BIN_VERTICES = 25
"""Maps are put together by size in steps of this."""


def load() -> float:
    """Processes that wanted a core in the last minute: above the number of cores, times are too long."""
    return round(os.getloadavg()[0], 2)


def measure_stages(world: str, limit_s: float) -> Figures:
    """Milliseconds of a step by stage, in a whole run of one robot with default settings."""
    clock = Stopwatch()
    spent: dict[str, list[float]] = {"step": [], "perception": [], "filter": [], "planning": []}

    def watch(robot: Robot, observation: Observation, step: Step) -> None:
        # perception has no state: once more, for the clock
        clock.timed("perception", perceive)(observation.scan(), robot.spec, robot.config.perception.method)
        clock.seconds["step"] = 1e-3 * step.action.step_ms
        for stage, times in spent.items():
            times.append(1e3 * clock.seconds.pop(stage, 0.0))
        if len(spent["step"]) == 1:  # from the second step on
            robot.filter.update = clock.timed("filter", robot.filter.update)  # type: ignore[method-assign]
            for part in ("look", "drive_forward", "place_of_contact", "frontier", "default_state", "drive"):
                setattr(robot.explorer, part, clock.timed("planning", getattr(robot.explorer, part)))

    run = explore({"world": world, "robots": 1, "max_time_s": limit_s}, {}, watch)
    figures: Figures = {}
    for stage, all_times in spent.items():
        times = np.array(all_times[WARM:])
        figures[stage] = {"median": np.median(times), "mean": times.mean(), "p99": np.percentile(times, 99)}
    return figures | {"particles": len(run.robots["r1"].filter.edges), "ticks": len(spent["step"]), "load": load()}


def measure_growth(world: str, particles: int | None, limit_s: float) -> Figures:
    """Milliseconds of a filter update over a recorded run, all in all and by vertices of the map."""
    run = record(world, 0, limit_s=limit_s)
    mind = run.new_filter(particles)
    times, vertices = np.empty(len(run.scans)), np.empty(len(run.scans), np.int64)
    for tick, (scan, pose) in enumerate(zip(run.scans, run.poses, strict=True)):
        begin = time.perf_counter()
        mind.update(scan, pose)
        times[tick] = 1e3 * (time.perf_counter() - begin)
        vertices[tick] = len(mind.wireframe().points)
    times, vertices = times[WARM:], vertices[WARM:]
    bins = vertices // BIN_VERTICES
    by_size = {str(BIN_VERTICES * b): float(np.median(times[bins == b])) for b in np.unique(bins).tolist()}
    figures = {"particles": len(mind.edges), "median": np.median(times), "p99": np.percentile(times, 99)}
    return figures | {"by_vertices": by_size, "bytes": mind.nbytes, "load": load()}


def measure_speed(world: str, robots: int, until: float | str) -> Figures:
    """Simulated seconds per second of `wireswarm run`: one process each, and Zenoh between them."""
    config = {"world": path_of(world), "robots": robots, "until": until}
    with launched(config) as (folder, ended):
        summary = read_json(folder / "summary.json")
    steps = [robot["step_ms_median"] for robot in summary["robots"].values()]
    factor = summary["real_time_factor"]
    return {"real_time_factor": factor, "step_ms_median": max(steps), "ended": ended, "load": load()}


def speed_cases(stages: str, run: str, quick: bool) -> list[Case]:
    """A step by stage and a whole run, under these names; alone each, for their figures are times."""
    small, large = {"world": "apartment", "limit_s": 60.0}, {"world": "maze-15", "limit_s": 3600.0}
    team = {"world": "apartment" if quick else "maze-15", "robots": 3, "until": 60.0 if quick else "complete"}
    return [
        *each(stages, measure_stages, small if quick else large, alone=True),
        *each(run, measure_speed, team, alone=True),
    ]


def cases(quick: bool) -> list[Case]:
    """Alone each: their figures are times."""
    world, limit_s = ("apartment", 60.0) if quick else ("maze-15", 3600.0)
    worlds = ["apartment"] if quick else ["maze-15", *present(["gbeltramo_building", "pal_home_w"])]
    sizes = PARTICLES[: 3 if quick else None]
    fixed = {"world": world, "particles": None, "limit_s": limit_s}
    return [
        *speed_cases("cost/stages", "cost/speed", quick),
        *each("cost/particles/{particles}", measure_growth, fixed, alone=True, particles=sizes),
        *each("cost/vertices/{world}", measure_growth, fixed, alone=True, world=worlds),
    ]


def stages_table(case: str) -> Table:
    """The table of `measure_stages` under that case's name."""

    def rows(figures: Outcomes) -> list[Row]:
        found = figures.get(case)
        stages = {"whole step": "step", "perception": "perception", "filter": "filter", "planning": "planning"}
        return [{"stage": stage, **found[key]} for stage, key in stages.items()] if found else []

    return Table(
        "stages",
        lambda figures: f"A step of one robot, {figures[case]['particles']} particles",
        rows,
        "stage; median <= 5: median ms; mean: mean ms; p99: 99 % ms",
        judged=lambda row: row["stage"] == "whole step",
        note=lambda figures: (
            f"The whole step has radio and coding, too. Load of the machine {figures[case]['load']:g}."
        ),
    )


def speed_table(case: str) -> Table:
    """The table of `measure_speed` under that case's name."""
    heads = "real_time_factor >= 30: times real time; step_ms_median: median step ms; ended; load"
    return Table("speed", "wireswarm run, 3 robots", whole(case), heads)


def _by_vertices(figures: Outcomes) -> list[Row]:
    return [
        {"world": world, "particles": found["particles"], "vertices": int(size), "median": median}
        for world, (found,) in by_label(figures, "cost/vertices/{world}").items()
        for size, median in found["by_vertices"].items()
    ]


TABLES = [
    stages_table("cost/stages"),
    Table(
        "particles",
        "Filter update by particles",
        whole("cost/particles/*"),
        "particles; median: median ms; p99: 99 % ms; bytes: filter bytes; load",
    ),
    Table(
        "vertices",
        "Filter update by vertices of the map",
        _by_vertices,
        f"world; particles; vertices: vertices, from (to {BIN_VERTICES} more); median: median ms",
    ),
    speed_table("cost/speed"),
]
