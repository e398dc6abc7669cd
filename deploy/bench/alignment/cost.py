"""Time of one alignment of two maps of the same part of a maze, of 150 vertices each."""

import time
from dataclasses import replace
from statistics import median

import numpy as np

from agent.alignment.align import align_prepared
from agent.alignment.config import AlignmentConfig
from agent.alignment.prepared import prepare
from deploy.bench.alignment.baselines import METHODS
from deploy.bench.alignment.pairs import moved, random_pose
from deploy.bench.alignment.recordings import whole_map
from deploy.bench.cases import Case, Figures, each
from deploy.bench.tables import Table, columns
from protocol.wireframe import certain

VERTICES = 150
NOISE_M = 0.005  # of the corners; that of the filter's maps
MAZE = "generated-18x18-9"
REPEATS = 15


def cases(quick: bool) -> list[Case]:
    """One case a method."""
    return each("cost/{method}", measure, {"repeats": 3 if quick else REPEATS}, alone=True, method=tuple(METHODS))


def measure(method: str, repeats: int) -> Figures:
    """Milliseconds of each of some alignments, making both maps ready included."""
    rng = np.random.default_rng(0)
    whole = whole_map(MAZE)
    part = certain(whole.points[:VERTICES], whole.edges[(whole.edges < VERTICES).all(1)])
    config, times = AlignmentConfig(), []
    for _ in range(repeats + 1):
        noisy = [replace(part, points=part.points + rng.normal(0.0, NOISE_M, part.points.shape)) for _ in range(2)]
        theirs = moved(noisy[1], random_pose(rng))
        begin = time.perf_counter()
        maps = prepare(noisy[0], config), prepare(theirs, config)
        align_prepared(*maps, config, rng, method=METHODS[method])
        times.append((time.perf_counter() - begin) * 1e3)
    return {"ms": times[1:], "vertices": VERTICES}  # the first one compiles


COLUMNS = columns(
    "method; vertices: vertices each; ms <= 50: ms median; most: ms at most",
    ms=lambda runs, _: median(runs[0]["ms"]),
    most=lambda runs, _: max(runs[0]["ms"]),
)
TABLES = [
    Table("cost", "Time of one alignment", "cost/{method}", COLUMNS, judged=lambda row: row["method"] == "features")
]
