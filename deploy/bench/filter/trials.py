"""How soon a filter mends discrete faults: injected in mid-run, then the same scans as before, there and back.

A scan sees the place of a fault if all of the place is within the lidar's range and in line of sight in the truth, and
every wall that is judged there is seen no flatter than at the scorer's 8 degrees. A fault is gone at the first of ten
such scans in a row after each of which the map agrees with the truth at the place.
"""

import copy
import math
from collections.abc import Iterable, Sequence
from itertools import product

import numpy as np

from agent.geometry.wall_tiles import WallTiles, all_in_view, wall_tiles
from agent.mapping.particle_filter import WireframeFilter
from deploy.bench.cases import Case, Figures
from deploy.bench.filter.faults import KINDS, Fault
from deploy.bench.filter.recording import ScanRecording, record
from deploy.bench.filter.runs import BUNDLED
from deploy.bench.tables import Outcomes, Row, Runs, Table, runs_of
from protocol.arrays import Bools, Floats
from world.coverage import GRAZING_RAD

SCOPES = ("all", "half with the best", "half without the best")
WITHIN = 50  # scans that see the place, within which a fault must go
STAYS = 10  # scans that see the place for which the map must stay right
SOON = 300  # scans in which the place must first be seen: one simulated minute, so that trials are not all waiting
NO_WALL = np.zeros(2)  # the normal of a place that lies beside no wall
DRAWS = 4000  # places drawn for one trial before it is given up


def measure_faults(
    world: str, trials: int, particles: int | None, scopes: Sequence[str], limit_s: float, real: bool = False
) -> Figures:
    """Scans until each fault was gone (None: not within WITHIN), by kind and scope. real: with real sensing."""
    run = record(world, 0, limit_s=limit_s, real=real)
    rng = np.random.default_rng(np.random.SeedSequence([0, len(run.scans)]))
    ticks = len(run.scans)
    starts = np.sort(rng.integers(round(0.4 * ticks), ticks, trials)).tolist()
    way_back = range(ticks, 2 * ticks, SOON)  # for trials that found no place until the end
    found: dict[str, dict[str, list[int | None]]] = {kind: {} for kind in KINDS}
    mind = run.new_filter(particles)
    if len(mind.edges) == 1:
        scopes = SCOPES[:1]  # there is no half of one
    tick, owed = 0, dict.fromkeys(KINDS, 0)
    for number, start in enumerate([*starts, *way_back]):
        if number >= trials and not any(owed.values()):
            break
        while tick <= start:
            run.show(mind, tick)
            tick += 1
        for kind in KINDS:
            owed[kind] += number < trials
            while owed[kind] and (drawn := _draw_seen(kind, mind, run, tick, rng)) is not None:
                owed[kind] -= 1  # where there was no such place, the next start has one trial more
                fault, views = drawn
                for scope in scopes:
                    spoiled = _spoiled(mind, fault, _chosen(mind, scope, np.random.default_rng(start)))
                    found[kind].setdefault(scope, []).append(_scans_until_gone(spoiled, fault, views, run, tick))
    return {"found": found, "particles": len(mind.edges), "ticks": ticks}


def _draw_seen(
    kind: str, mind: WireframeFilter, run: ScanRecording, tick: int, rng: np.random.Generator
) -> tuple[Fault, Bools] | None:
    """A fault where the map is right and the run sees it often enough, and (t,) which scans see it."""
    right, walls = mind.wireframe(), wall_tiles(run.truth.outline)
    edges, count = mind.edges[mind.best], int(mind.counts[mind.best])
    ahead = np.array([run.at(later) for later in range(tick, tick + SOON)])
    for _ in range(DRAWS):
        near = np.array(run.poses[int(rng.choice(ahead))][:2])
        fault = KINDS[kind](edges[:count], run.truth, near, rng)
        if fault is None or not fault.gone(right):
            continue
        views = np.ones(len(run.scans), np.bool_)
        for point, normal in zip((fault.place, *fault.samples), (NO_WALL, *fault.normals), strict=True):
            views &= _sees(point, normal, run, walls)
            if views.sum() < WITHIN + STAYS or not views[ahead].any():
                break
        else:
            if not fault.gone(_spoiled(mind, fault, [mind.best]).wireframe()):  # else it changes nothing
                return fault, views
    return None


def _sees(point: Floats, normal: Floats, run: ScanRecording, walls: WallTiles) -> Bools:
    """(t,) scans that see a point in free space, beside a wall with this normal; zero: beside none."""
    eyes = np.array(run.poses)[:, :2]
    away = eyes - point
    distance = np.hypot(away[:, 0], away[:, 1])
    near = distance < run.spec.lidar.range_max_m
    if normal.any():
        near &= away @ normal > math.sin(GRAZING_RAD) * distance
    out = np.zeros(len(eyes), np.bool_)
    out[near] = all_in_view(eyes[near], np.repeat(point[None], int(near.sum()), 0), walls)
    return out


def _chosen(mind: WireframeFilter, scope: str, rng: np.random.Generator) -> list[int]:
    """Particles of one of SCOPES."""
    others = [p for p in rng.permutation(len(mind.edges)).tolist() if p != mind.best]
    half = len(mind.edges) // 2
    parts = [mind.best, *others], [mind.best, *others[: half - 1]], others[:half]
    return dict(zip(SCOPES, parts, strict=True))[scope]


def _spoiled(mind: WireframeFilter, fault: Fault, particles: Sequence[int]) -> WireframeFilter:
    """A copy of the filter with the fault in these particles, as far as they have such a wall."""
    spoiled = copy.deepcopy(mind)
    for p in particles:
        count = fault.inject(spoiled.edges[p], int(spoiled.counts[p]))
        if count is not None:
            spoiled.counts[p] = count
    return spoiled


def _scans_until_gone(mind: WireframeFilter, fault: Fault, views: Bools, run: ScanRecording, tick: int) -> int | None:
    """Replay from this tick on, to and fro; None if the fault is not gone within WITHIN scans that see it."""
    seen, since = 0, 0
    while True:
        run.show(mind, tick)
        tick += 1
        if not views[run.at(tick - 1)]:
            continue
        seen += 1
        if not fault.gone(mind.wireframe()):
            since = seen
            if seen >= WITHIN:
                return None
        elif seen - since >= STAYS:
            return since + 1


FILTERS = {"default": None, "some": 10, "one": 1}
"""Particles: of the default filter, of one of which half can be spoiled, and one hypothesis alone."""


def cases(quick: bool) -> list[Case]:
    """Every size of filter in every world."""
    worlds, trials, limit_s = (["apartment"], 3, 120.0) if quick else (BUNDLED, 25, 1200.0)
    fixed = {"scopes": list(SCOPES), "trials": trials, "limit_s": limit_s}
    return [
        Case(f"faults/{world}/{which}", measure_faults, {**fixed, "world": world, "particles": FILTERS[which]})
        for world, which in product(worlds, list(FILTERS)[: 2 if quick else None])
    ]


def counts_of(runs: Runs, kinds: Iterable[str], scope: str) -> list[int | None]:
    """Scans until gone of all trials of some kinds in one scope."""
    return [count for run in runs for kind in kinds for count in run["found"][kind].get(scope, [])]


def gone_percent(counts: Sequence[int | None]) -> float | None:
    """Faults that were gone within WITHIN scans; None without trials."""
    return 100.0 * sum(count is not None for count in counts) / len(counts) if counts else None


def _rows(figures: Outcomes) -> list[Row]:
    """One row per size of filter, fault and scope, all worlds together."""
    rows = []
    for which in FILTERS:
        runs = runs_of(figures, f"faults/*/{which}")
        for kind, scope in product(KINDS, SCOPES):
            if counts := counts_of(runs, [kind], scope):
                row = {"fault": kind, "scope": scope, "particles": runs[0]["particles"], "trials": len(counts)}
                row |= {"gone": gone_percent(counts), "median": _rank(counts, 0.5), "p90": _rank(counts, 0.9)}
                rows.append(row | {"judged": which != "one"})
    return rows


def _rank(counts: Sequence[int | None], share: float) -> int | None:
    ranked = sorted(math.inf if count is None else count for count in counts)
    value = ranked[min(len(ranked) - 1, math.floor(share * len(ranked)))]
    return int(value) if math.isfinite(value) else None


TABLES = [
    Table(
        "faults",
        "Discrete faults injected in mid-run",
        _rows,
        "fault; scope: in which particles; particles; trials; gone >= 95: gone in 50 scans %; median: median scans; "
        "p90: 90 % scans",
        note="Median and 90 % of the scans that saw the place until it was right again; - : more than 50. "
        "Ideal sensing.",
        sensing="ideal",
    )
]
