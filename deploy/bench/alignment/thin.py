"""One robot among thin walls, posts and slots: corners that are found, metres of small faces that are mapped."""

from typing import Any

import numpy as np

from deploy.bench import made
from deploy.bench.cases import Case, Figures, each
from deploy.bench.explored import explore
from deploy.bench.layouts import written
from deploy.bench.tables import Table, columns, completed_at, median, times, total
from deploy.metrics import NEAR_M, Truth, distance_to
from protocol.arrays import Floats
from protocol.geometry import apply
from protocol.walls import directions, lengths

THICK_MM = (10, 20, 40)
SEEDS = 3
SMALL_M = 0.06  # faces up to this length; those of posts in `made.posts` are shorter, too
LIMIT_S = 1500.0


def cases(quick: bool) -> list[Case]:
    """Mazes of thin walls, and rooms with plywood and posts."""
    seeds = range(1 if quick else SEEDS)
    mazes = each("thin/{thick_mm} mm/{seed}", measure, thick_mm=THICK_MM[:1] if quick else THICK_MM, seed=seeds)
    return mazes + each("thin/posts/{seed}", measure, {"thick_mm": 0}, seed=seeds)


def measure(thick_mm: int, seed: int) -> Figures:
    """One run to its end, in a maze of walls of that thickness, or among posts where it is 0."""
    world: dict[str, Any] = made.thin(seed, thick_mm / 1000) if thick_mm else made.posts(seed)
    settings = {"world": written(world), "robots": 1, "seed": seed, "starts": "random", "max_time_s": LIMIT_S}
    run = explore(settings, {})
    wireframe = run.robots["r1"].wireframe
    mapped, small = _small_faces(apply(run.frame(), wireframe.points)[wireframe.edges].reshape(-1, 4), run.truth())
    return run.figures() | run.told() | {"small_m": small, "mapped_m": mapped}


def _small_faces(segments: Floats, truth: Truth) -> tuple[float, float]:
    """Metres of small faces of the truth that a map of these walls (m, 4) has, world frame, and of all."""
    size = lengths(truth.outline)
    faces = truth.outline[(size > 1e-3) & (size <= SMALL_M)]
    middles = 0.5 * (faces[:, :2] + faces[:, 2:])
    near = distance_to(middles, directions(faces), segments) < NEAR_M
    return float(lengths(faces)[near].sum()), float(np.sum(lengths(faces)))


TABLES = [
    Table(
        "thin",
        "One robot among thin walls, faces up to 6 cm and posts of 4 cm",
        "thin/{world}/*",
        columns(
            "world; runs count; corner_recall least >= 0.97: corner recall; corner_rmse_m most <= 0.005: rmse m; "
            "share >= 0.9: small faces mapped; wall_precision least: precision; unreachable total: given up; "
            "t_99 median; ended_at: complete s",
            ended_at=times(median, completed_at),
            share=lambda runs, _: total(runs, "mapped_m") / total(runs, "small_m"),
        ),
    )
]
