"""Generated mazes of 8 to 20 m: none may hold a robot for ever."""

import numpy as np

from deploy.bench.cases import Case, Figures, each
from deploy.bench.explored import measure_run
from deploy.bench.layouts import written
from deploy.bench.tables import Outcomes, Row, Table, columns, grouped, row_of, runs_of, share
from world.maze import generate

MAZES = 50
SIDES_M = (8.0, 20.0)  # larger ones take a robot of 0.22 m/s more than an hour
CEILING_S_M2 = 4.5  # simulated s that a m2 may take: 1000 s for 15 m x 15 m, where the median of `maze-15` may be 600 s


def measure_maze(seed: int) -> Figures:
    """One robot from a start drawn from the seed, in the maze of that seed."""
    rng = np.random.default_rng(seed)
    width, height = rng.uniform(*SIDES_M, 2).tolist()
    ceiling = CEILING_S_M2 * width * height
    found = measure_run(written(generate(width, height, rng)), seed, ceiling, "random")
    return found | {"width_m": width, "height_m": height, "ceiling_s": ceiling}


def cases(quick: bool) -> list[Case]:
    """Every maze once."""
    return each("mazes/{seed}", measure_maze, seed=range(1 if quick else MAZES))


COLUMNS = columns(
    "mazes; complete >= 1: complete in time; silent most <= 0: open, no reason; wall_recall least >= 0.99: recall; "
    "wall_contacts most <= 0; share <= 1: time of ceiling; stuck most",
    complete=share(lambda run: run["ended"] == "complete"),
    share=lambda runs, _: max(run["ended_at"] / run["ceiling_s"] for run in runs),
)


def _rows(figures: Outcomes) -> list[Row]:
    """All mazes in one row, and those that miss a bar by themselves."""
    rows = [row_of(COLUMNS, runs, labels) for labels, runs in grouped(figures, "mazes/{mazes}")]
    bad = [row for row in rows if any(column.misses(row[column.key]) for column in COLUMNS)]
    every = runs_of(figures, "mazes/*")
    return [row_of(COLUMNS, every, {"mazes": f"all {len(every)}"}), *bad] if every else []


TABLES = [Table("mazes", "Generated mazes of 8 to 20 m, worst figures; below, each that misses", _rows, COLUMNS)]
