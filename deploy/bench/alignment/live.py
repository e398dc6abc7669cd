"""Whole runs of several robots that meet: what is merged, rightly or wrongly, and what sharing is worth."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from statistics import fmean, median
from typing import Any

import numpy as np

from deploy.bench.alignment.plots import draw_division, draw_range
from deploy.bench.alignment.recordings import mapped
from deploy.bench.cases import Case, Figures, each
from deploy.bench.errors import errors, is_false
from deploy.bench.explored import Enough, Explored, explore
from deploy.bench.layouts import drawn_starts, path_of, written
from deploy.bench.tables import Outcomes, Reduce, Row, Table, columns, least, most, over, row_of, runs_of, times, total
from deploy.bench.tables import median as of_runs
from deploy.sweep.statistics import time_of, told_of, wilson
from world.worldfile import load

BUNDLED = ("apartment", "hall", "maze-15", "office", "symmetric")
SEEDS = 20  # runs of each bundled world: 100 in all
PAIRED_SEEDS = 10  # runs of maze-15 with and without what is compared
TEAM_SEEDS = 5  # the same for teams of 2 and 5 robots, which have no bar
LIMIT_S = 600.0  # simulated seconds of a run. All robots have seen all walls before, though some still sweep
UNSHARED_S = 1200.0  # the same where robots do not share: alone in maze-15 they need 500 to 750 s
LOOK_S = 10.0  # simulated time between two looks at what maps have in common
OVERLAP = 0.3
JOINT_S = 120.0  # pairs in contact with this overlap and this time left should be merged by the end
DEFAULT_RANGE_M = 4.0
RANGES = (1.0, 2.0, DEFAULT_RANGE_M, 8.0, 1000.0)  # radio ranges in metres; the last one is more than any building
RANGE_SEEDS = 3
FULL = 0.99 - 1e-9
EVENTS = ("attempt", "proposed", "accepted", "rejected", "unmerged")
Due = Mapping[tuple[str, str], float]
"""Simulated time since which a robot and a peer have been in contact with maps that overlap enough to be merged."""


def cases(quick: bool) -> list[Case]:
    """Runs over the bundled worlds, and the comparisons in maze-15. Each ends when what it is for is known."""
    world = {"world": "apartment" if quick else "maze-15"}
    seeds = range(1 if quick else PAIRED_SEEDS)
    made = []
    for seed, live in product(range(1 if quick else SEEDS), world.values() if quick else BUNDLED):
        # the comparisons read the last maps and the bytes of these runs, so they go on to their own end
        until = None if live == "maze-15" and seed < PAIRED_SEEDS else "merged"
        made.append(Case(f"live/{live}/{seed}", measure, {"world": live, "seed": seed, "until": until}))
    alone = {**world, "limit_s": UNSHARED_S, "until": "each"}
    made += each("unshared/{seed}", measure, {**alone, "cooperation": {"sharing": False}}, seed=seeds)
    made += each("alone/{seed}/{start}", measure, alone, seed=seeds, start=range(3))
    team = {**world, "until": "team"}
    undivided = {**team, "cooperation": {"division": False}}
    made += each("undivided/{robots}/{seed}", measure, undivided, robots=[3], seed=seeds)
    made += each("undivided/{robots}/{seed}", measure, undivided, robots=[2, 5], seed=seeds[:TEAM_SEEDS])
    made += each("divided/{robots}/{seed}", measure, team, robots=[2, 5], seed=seeds[:TEAM_SEEDS])
    if quick:  # else three robots with division are among the live runs
        made += each("divided/3/{seed}", measure, {**world, "until": "each"}, seed=seeds)
    ranges = [1000.0] if quick else [range_m for range_m in RANGES if range_m != DEFAULT_RANGE_M]
    far = {**world, "until": "each" if quick else None}
    return made + each("range/{range_m:g}/{seed}", measure, far, seed=seeds[:RANGE_SEEDS], range_m=ranges)


def measure(
    world: str,
    seed: int,
    robots: int = 3,
    range_m: float = DEFAULT_RANGE_M,
    limit_s: float = LIMIT_S,
    cooperation: Mapping[str, Any] | None = None,
    start: int | None = None,
    until: str | None = None,
    spec: Mapping[str, Any] | None = None,
) -> Figures:
    """One run, until `team` or `each` robot has 99 %, until all is `merged`, or to its own end (None).

    start: the run is of one robot, from the start of that number; None: from all starts. spec: settings of the robots.
    """
    settings = {"robots": robots, "seed": seed, "starts": "random", "max_time_s": limit_s, "spec": spec or {}}
    name = world
    if start is not None:
        spawn = drawn_starts(world, 3, seed)[start].tolist()
        world = written({**load(path_of(world)).document, "spawns": [spawn]})
        settings |= {"robots": 1, "starts": "file"}
    settings |= {"world": world, "radio": {"range_m": range_m}}
    due: dict[tuple[str, str], float] = {}
    ends: dict[str, Enough] = {"team": _team, "each": _each, "merged": lambda run: _all_merged(run, due)}

    def enough(run: Explored) -> bool:
        _see_overlaps(run, due)
        return until is not None and ends[until](run)

    run = explore(settings, {"cooperation": cooperation or {}}, enough=enough)
    return {"world": name, **_figures(run, due)}


def _team(run: Explored) -> bool:
    return run.episode.team_coverage >= FULL


def _each(run: Explored) -> bool:
    return min(run.episode.coverage.values()) >= FULL


def _all_merged(run: Explored, due: Due) -> bool:
    """Whether no pair can be merged any more, all have 99 %, and every pair had JOINT_S."""
    merged = all(len(mind.team.merged_ticks) == len(run.robots) - 1 for mind in run.robots.values())
    return merged and _each(run) and run.episode.t >= max(due.values(), default=0.0) + JOINT_S


def _see_overlaps(run: Explored, due: dict[tuple[str, str], float]) -> None:
    """Note since when each pair has been in contact with enough overlap, at every look."""
    tick, rate_hz = run.episode.tick - 1, run.episode.config.spec.lidar.rate_hz
    pairs = [(name, peer) for name, mind in run.robots.items() for peer in mind.exchange.contacts]
    for one, two in pairs if tick % round(LOOK_S * rate_hz) == 0 else ():
        a, b = (mapped(run.robots[robot].own, run.frame(robot), run.truth(robot)) for robot in (one, two))
        lengths = run.truth(one).seen_lengths
        smaller = min(float(lengths[a].sum()), float(lengths[b].sum()))
        if smaller > 0 and float(lengths[a & b].sum()) / smaller >= OVERLAP:
            due.setdefault((one, two), tick / rate_hz)


def _figures(run: Explored, due: Due) -> Figures:
    """All that the tables need."""
    events = [(t, robot, event.event, event.data) for t, robot, event in run.events if event.event in EVENTS]
    accepted = []
    for t, robot, name, data in events:
        if name == "accepted":
            theirs = run.robots[data["peer"]].own.points
            centre = theirs.mean(0) if len(theirs) else np.zeros(2)
            frames = run.frame(robot), run.frame(data["peer"])
            metres, degrees = errors(data["transform"], *frames, centre)
            found = {"t": t, "robot": robot, "error_m": metres, "error_deg": degrees}
            accepted.append(data | found | {"false": is_false(data["transform"], *frames)})
    last = {(robot, data["peer"]): f"{name}: {data['reason']}" for _, robot, name, data in events}
    pairs = [
        {"robot": one, "peer": two, "since": since, "merged": two in run.robots[one].team.merged_ticks}
        | {"reason": last.get((one, two), "never tried")}
        for (one, two), since in sorted(due.items())
        if since <= run.episode.t - JOINT_S
    ]
    robots = {name: run.figures(name) for name in run.robots}
    maps = list(robots.values())
    return {
        "ended_at": run.episode.t,
        "robots": robots,
        "maps": len(maps),
        **{key: least(maps, key) for key in ("wall_recall", "wall_precision")},
        "t_99": most(maps, "t_99"),
        "team": run.summary["team"]["t_99"],
        "bytes": total(maps, "bytes_sent"),
        "rtf": run.summary["real_time_factor"],
        "alignments": accepted,
        "false": sum(one["false"] for one in accepted),
        **{event: sum(name == event for _, _, name, _ in events) for event in EVENTS},
        "due": pairs,
        "pairs": len(pairs),
        "merged": sum(pair["merged"] for pair in pairs),
    }


def _worst(key: str) -> Reduce:
    """The largest of all accepted alignments of all runs."""
    return lambda runs, _: max((one[key] for run in runs for one in run["alignments"]), default=None)


def _left(figures: Outcomes) -> list[Row]:
    """Last words of the pairs that were not merged, the most frequent first."""
    left = [(run, pair) for run in runs_of(figures, "live/*/*") for pair in run["due"] if not pair["merged"]]
    counts = Counter(f"{run['world']}: {pair['reason']}" for run, pair in left)
    return [{"reason": reason, "pairs": n} for reason, n in counts.most_common()]


def _divided(figures: Outcomes, robots: int, seed: int) -> Figures | None:
    """The run with sharing and division of that many robots."""
    found = figures.get(f"divided/{robots}/{seed}")
    return figures.get(f"live/maze-15/{seed}") if found is None and robots == 3 else found


def _titled(title: str) -> Callable[[Outcomes], str]:
    """A title with the world of the comparisons before it."""
    return lambda figures: next((run["world"] for run in runs_of(figures, "unshared/*")), "maze-15") + title


def _over(time: float, other: float) -> float | None:
    """How many times the other one a time is: infinitely many where it was not reached, 0 where the other was not.

    None where neither was.
    """
    return None if math.isinf(time) and math.isinf(other) else time / other


def _paired(ratios: Sequence[float]) -> Row:
    """Median and middle half of paired ratios."""
    low, high = np.quantile(ratios, (0.25, 0.75), method="nearest").tolist()
    return {"ratio": told_of(median(ratios)), "spread": f"{low:.2f} to {high:.2f}".replace("inf", "∞")}


def _sharing(figures: Outcomes) -> list[Row]:
    """Runs with and without sharing, a row a seed and their median, which needs all seeds to be judged."""
    rows: list[Row] = []
    ratios: list[float] = []
    for seed in range(PAIRED_SEEDS):
        on, off = _divided(figures, 3, seed), figures.get(f"unshared/{seed}")
        if on is not None and off is not None:
            ratio = _over(time_of(on["t_99"]), time_of(off["t_99"]))
            ratios += [] if ratio is None else [ratio]
            rows.append({"seed": str(seed), "on": on["t_99"], "off": off["t_99"], "ratio": told_of(ratio)})
    whole: Row = {"seed": "median", "judged": len(ratios) == PAIRED_SEEDS}
    return [*rows, {**whole, **_paired(ratios)}] if ratios else rows


def _division(figures: Outcomes) -> list[Row]:
    """Teams with and without division, and one robot alone, a row a size of the team; all seeds are judged, or none.

    A seed counts where the ratios tell something: where the team with division, or both of the others, reached 99 %.
    """
    rows = []
    for robots in (2, 3, 5):
        took, ratios = [], []  # of each seed: with division, without, and of one robot; of the first to the others
        for seed in range(PAIRED_SEEDS):
            names = [f"undivided/{robots}/{seed}", *(f"alone/{seed}/{start}" for start in range(3))]
            runs = [_divided(figures, robots, seed), *map(figures.get, names)]
            found = [time_of(run["team"]) for run in runs if run is not None]
            if len(found) == len(runs):
                with_, without, one = found[0], found[1], fmean(found[2:])
                to_one, to_without = _over(with_, one), _over(with_, without)
                if to_one is not None and to_without is not None:
                    took.append((with_, without, one))
                    ratios.append((to_one, to_without))
        if took:
            row: Row = {"robots": robots, "seeds": len(took), "judged": len(took) == PAIRED_SEEDS}
            for which, some in zip(("divided", "undivided", "alone"), zip(*took, strict=True), strict=True):
                row[which] = told_of(median(some))
            of_one, of_without = zip(*ratios, strict=True)
            rows.append({**row, **_paired(of_one), "sooner": told_of(median(of_without))})
    return rows


RANGE = columns(
    "range: radio range m; runs count; t_99 median: every robot 99 % s; team: team 99 % s; bytes: bytes sent; "
    "accepted total; false total <= 0",
    bytes=lambda runs, key: median(run[key] for run in runs),
    team=times(of_runs, lambda run: run["team"]),
)


def _range(figures: Outcomes) -> list[Row]:
    """Three robots, a row a radio range; that of the default is among the runs with division."""
    rows = []
    for range_m in RANGES:
        names = [f"range/{range_m:g}/{seed}" for seed in range(RANGE_SEEDS)]
        default = [_divided(figures, 3, seed) for seed in range(RANGE_SEEDS)]
        found = default if range_m == DEFAULT_RANGE_M else [figures.get(name) for name in names]
        if runs := [run for run in found if run is not None]:
            rows.append(row_of(RANGE, runs, {"range": range_m}))
    return rows


TABLES = [
    Table(
        "accepted",
        "3 robots, starts from the seed: accepted alignments",
        "live/{world}/*",
        columns(
            "world; runs count; accepted total; false total <= 0; worst_m; worst_deg; proposed total; rejected total; "
            "unmerged total",
            worst_m=_worst("error_m"),
            worst_deg=_worst("error_deg"),
        ),
        total="all",
        note="False: more than 0.25 m or 5 degrees off at the origin of the peer's frame, also if undone later. "
        "Worst m: in the middle of its map.",
    ),
    Table(
        "merged",
        "Robot and peer in contact with overlap >= 30 % and 120 s left: merged by the end",
        "live/{world}/*",
        columns(
            "world; pairs total; merged total; share >= 0.8; interval: 95 %",
            share=over("merged", "pairs"),
            interval=lambda runs, _: "{:.2f} to {:.2f}".format(*wilson(total(runs, "merged"), total(runs, "pairs"))),
        ),
        total="all",
        judged=lambda row: row["world"] == "all",
    ),
    Table("left", "Why the rest is not", _left, "reason: last word; pairs"),
    Table(
        "maps",
        "Every robot's map with sharing, worst of 10 seeds",
        "live/{world}/[0-9]",
        "world; maps total; wall_recall least >= 0.97: recall; wall_precision least >= 0.97: precision; "
        "rtf median: real-time factor",
        judged=lambda row: row["world"] == "maze-15",
    ),
    Table(
        "sharing",
        _titled(": time until every robot has 99 %"),
        _sharing,
        "seed; on: sharing s; off: without s; ratio <= 0.5; spread: quarters",
        judged=lambda row: row["seed"] == "median",
        note="Judged with a ratio of every seed: infinite where with sharing it is not reached, 0 where without.",
    ),
    Table(
        "division",
        _titled(": team coverage of 99 %, medians of the seeds"),
        _division,
        "robots; seeds; divided: with division s; undivided: without s; alone: one robot s; "
        "ratio <= 0.45: to one robot; spread: quarters; sooner <= 1: to without",
        judged=lambda row: row["robots"] == 3,
        note="Seeds: of which each ratio has a time that was reached; judged with all of them.",
        drawn=draw_division,
    ),
    Table("range", _titled(", 3 robots, by radio range"), _range, RANGE, drawn=draw_range),
]
