"""Whole runs of one robot: the bundled worlds and the real layouts, each from five starts drawn from the seed."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping
from typing import Any

from agent.robot import Robot, Step
from deploy.bench.bars import Column, Section
from deploy.bench.cases import Case, Figures
from deploy.bench.explored import explore
from deploy.bench.layouts import present
from protocol.messages import Event, Observation
from protocol.wireframe import Label

BUNDLED = ["apartment", "hall", "maze-15", "office", "symmetric"]
SHARED = ["drlnav_stage7", "gbeltramo_building", "pal_passage_110cm_w", "tb3_dqn_stage4", "uday_building"]
FURNISHED = ["drlnav_house_tomas", "hurtado_apartment", "pal_home_w"]
SEEDS = 5
LIMIT_S = 4000.0
"""Simulated seconds after which a run counts as not finished: twice what the largest layout takes."""
MAZE_15_S = 600.0
"""Median time to complete in maze-15."""


def worlds(quick: bool) -> list[str]:
    """The layouts that are there."""
    return ["apartment"] if quick else BUNDLED + present(SHARED + FURNISHED)


def seeds(quick: bool) -> range:
    """Seeds of each layout."""
    return range(1 if quick else SEEDS)


def settings(world: str, seed: int) -> dict[str, Any]:
    """World settings of one robot whose start is drawn from the seed, so that each seed is another start."""
    return {"world": world, "robots": 1, "seed": seed, "starts": "random", "max_time_s": LIMIT_S}


def measure_run(world: Mapping[str, Any], agent: Mapping[str, Any]) -> Figures:
    """Figures of r1 in one run: score, times, paths, contacts, and what it said of its frontiers and its end."""
    events: list[Event] = []

    def watch(robot: Robot, observation: Observation, step: Step) -> None:
        if robot.robot == "r1":
            events.extend(step.action.events)

    run = explore(world, agent, watch)
    return run.figures() | told(run.robots["r1"], events)


def told(robot: Robot, events: Iterable[Event]) -> Figures:
    """What a robot's events and its last map say.

    `silent`: frontier or occlusion ends that it neither resolved nor recorded as given up with a reason.
    """
    events = list(events)
    explorer = robot.explorer
    tried = explorer.memory.find(explorer.ends.points, explorer.ends.along).tolist()
    reasons = [explorer.memory.tried[k].reason if k >= 0 else "" for k in tried]
    completes = [event.data for event in events if event.event == "complete"]
    return {
        "reason": completes[-1]["reason"] if completes and explorer.complete else "",
        "frontiers": int((robot.wireframe.labels == Label.FRONTIER).sum()),
        "unreachable": sum(map(bool, reasons)),
        "silent": reasons.count("") if explorer.complete else None,
        "stuck": sum(event.event == "stuck" for event in events),
        "goals": sum(event.event == "frontier" and event.data["what"] == "chosen" for event in events),
        "resumed": sum(event.event == "resumed" for event in events),
    }


def cases(quick: bool) -> list[Case]:
    """Every layout from every start."""
    return [
        Case(f"runs/{world}/{seed}", measure_run, {"world": settings(world, seed), "agent": {}})
        for seed in seeds(quick)  # all layouts once before any twice
        for world in worlds(quick)
    ]


def grouped(figures: Mapping[str, Figures], prefix: str) -> dict[str, list[Figures]]:
    """Figures of the cases prefix/GROUP/SEED by GROUP, in the order of their seeds."""
    groups: dict[str, list[Figures]] = {}
    for name, found in figures.items():
        if name.startswith(f"{prefix}/"):
            groups.setdefault(name.removeprefix(f"{prefix}/").rpartition("/")[0], []).append(found)
    return groups


def median(runs: Iterable[Figures], key: str) -> float | None:
    """Median over runs; None where one never got so far."""
    values = [run[key] for run in runs]
    return None if any(value is None for value in values) else float(statistics.median(values))


def spread(runs: Iterable[Figures], key: str) -> str:
    """Least and most over runs that got so far."""
    values = [run[key] for run in runs if run[key] is not None]
    return f"{min(values):.0f}-{max(values):.0f}" if values else "-"


def _end(runs: list[Figures]) -> dict[str, Any]:
    """How runs ended, the worst of each."""
    return {
        "runs": len(runs),
        "complete": sum(run["ended"] == "complete" and bool(run["reason"]) for run in runs) / len(runs),
        "silent": max((len_or(run["silent"]) for run in runs), default=0),
        "unreachable": max(run["unreachable"] for run in runs),
        "wall_recall": min(run["wall_recall"] for run in runs),
        "wall_precision": min(run["wall_precision"] for run in runs),
        "wall_rmse_m": max(run["wall_rmse_m"] for run in runs),
        "wall_contacts": max(run["wall_contacts"] for run in runs),
        "stuck": max(run["stuck"] for run in runs),
    }


def len_or(count: int | None) -> float:
    """The count; more than any bar where there is none."""
    return float("inf") if count is None else count


def _ends(name: str, title: str, groups: Mapping[str, list[Figures]], recall: float, precision: float) -> Section:
    columns = [
        Column("world", "world"),
        Column("runs", "runs"),
        Column("complete", "complete", at_least=1.0, digits=2),
        Column("silent", "open, no reason", at_most=0),
        Column("unreachable", "open, with reason"),
        Column("wall_recall", "recall", at_least=recall, digits=4),
        Column("wall_precision", "precision", at_least=precision, digits=4),
        Column("wall_rmse_m", "wall rmse m", at_most=0.01, digits=4),
        Column("wall_contacts", "wall contacts", at_most=0),
        Column("stuck", "stuck"),
    ]
    rows = [{"world": world, **_end(runs)} for world, runs in groups.items()]
    return Section(name, title, columns, rows, note="Worst of the runs; complete: share that ended so, with a reason.")


def sections(figures: Mapping[str, Figures]) -> list[Section]:
    """How the runs ended, and how long they took."""
    groups = grouped(figures, "runs")
    plain = {world: runs for world, runs in groups.items() if world not in FURNISHED}
    furnished = {world: runs for world, runs in groups.items() if world in FURNISHED}
    made = [
        _ends("plain", "One robot in plain layouts, starts drawn from the seed", plain, 0.99, 0.99),
        _ends("furnished", "... in furnished layouts", furnished, 0.96, 0.97),
    ]
    columns = [Column("world", "world")]
    rows = []
    for key, head in (("t_90", "T_90 s"), ("t_99", "T_99 s"), ("ended_at", "complete s"), ("path_m", "path m")):
        columns += [Column(key, f"{head} median", digits=0), Column(f"{key}_spread", "least-most")]
    for world, runs in groups.items():
        row: dict[str, Any] = {"world": world}
        for key in ("t_90", "t_99", "ended_at", "path_m"):
            row |= {key: median(runs, key), f"{key}_spread": spread(runs, key)}
        rows.append(row)
    made.append(Section("times", "Simulated seconds and path to 90 %, 99 % and complete", columns, rows))
    if "maze-15" in groups:
        bar = [Column("world", "world"), Column("ended_at", "complete s, median", at_most=MAZE_15_S, digits=0)]
        row = {"world": "maze-15", "ended_at": median(groups["maze-15"], "ended_at")}
        made.append(Section("maze-15", "Time to complete", bar, [row]))
    return made
