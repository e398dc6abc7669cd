"""What an update of the filter costs, by particles and by the size of the map."""

import time

import numpy as np

from deploy.bench.cases import Case, Figures, each
from deploy.bench.filter.recording import record
from deploy.bench.layouts import present
from deploy.bench.speed import WARM, load
from deploy.bench.tables import Outcomes, Row, Table, by_label, whole

PARTICLES = (1, 5, 10, 30, 100)
BIN_VERTICES = 25  # updates are grouped by the size of the map, in bins of so many vertices


def measure_growth(world: str, particles: int | None, limit_s: float) -> Figures:
    """Milliseconds of a filter update over a recorded run, all in all and by vertices of the map."""
    run = record(world, 0, limit_s=limit_s)
    mind = run.new_filter(particles)
    times, vertices = np.empty(len(run.scans)), np.empty(len(run.scans), np.int64)
    for tick in range(len(run.scans)):
        begin = time.perf_counter()
        run.show(mind, tick)
        times[tick] = 1e3 * (time.perf_counter() - begin)
        vertices[tick] = len(mind.wireframe().points)
    times, vertices = times[WARM:], vertices[WARM:]
    bins = vertices // BIN_VERTICES
    by_size = {str(BIN_VERTICES * b): float(np.median(times[bins == b])) for b in np.unique(bins).tolist()}
    figures = {"particles": len(mind.edges), "median": np.median(times), "p99": np.percentile(times, 99)}
    return figures | {"by_vertices": by_size, "bytes": mind.nbytes, "load": load()}


def cases(quick: bool) -> list[Case]:
    """Alone each: their figures are times."""
    world, limit_s = ("apartment", 60.0) if quick else ("maze-15", 3600.0)
    worlds = ["apartment"] if quick else ["maze-15", *present(["gbeltramo_building", "pal_home_w"])]
    sizes = PARTICLES[: 3 if quick else None]
    fixed = {"world": world, "particles": None, "limit_s": limit_s}
    return [
        *each("cost/particles/{particles}", measure_growth, fixed, alone=True, particles=sizes),
        *each("cost/vertices/{world}", measure_growth, fixed, alone=True, world=worlds),
    ]


def _by_vertices(figures: Outcomes) -> list[Row]:
    return [
        {"world": world, "particles": found["particles"], "vertices": int(size), "median": median}
        for world, (found,) in by_label(figures, "cost/vertices/{world}").items()
        for size, median in found["by_vertices"].items()
    ]


TABLES = [
    Table(
        "particles",
        "Filter update by particles",
        whole("cost/particles/*"),
        "particles; median: median ms; p99: 99 % ms; bytes: filter bytes; load",
        note="Ideal sensing.",
        sensing="ideal",
    ),
    Table(
        "vertices",
        "Filter update by vertices of the map",
        _by_vertices,
        f"world; particles; vertices: vertices, from (to {BIN_VERTICES} more); median: median ms",
        note="Ideal sensing.",
        sensing="ideal",
    ),
]
