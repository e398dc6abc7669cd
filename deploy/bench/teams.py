"""Teams with a lidar that turns and wheels that err: do they merge, rightly, and are their maps whole."""

from deploy.bench.alignment import live
from deploy.bench.cases import Case, Figures, each
from deploy.bench.tables import Table, columns, most, over
from deploy.sensing import REAL

SEEDS = 20  # runs of each bundled world: 100 in all
LIMIT_S = 4000.0  # simulated seconds after which a run counts as not finished: where odometry errs, 600 are too few


def cases(quick: bool) -> list[Case]:
    """Three robots in the bundled worlds."""
    return each("team/{world}/{seed}", measure, seed=range(0 if quick else SEEDS), world=live.BUNDLED)


def measure(world: str, seed: int) -> Figures:
    """Three robots from drawn starts to their own end."""
    found = live.measure(world, seed, limit_s=LIMIT_S, spec=REAL)
    return found | {"wall_contacts": most(list(found["robots"].values()), "wall_contacts")}


TABLES = [
    Table(
        "team",
        "Three robots, real sensing, starts from the seed",
        "team/{world}/*",
        columns(
            "world; runs count; accepted total; false total <= 0; pairs total; merged total; share >= 0.9; "
            "wall_recall least >= 0.98: worst recall; wall_precision least: worst precision; wall_contacts most <= 0",
            share=over("merged", "pairs"),
        ),
        total="all",
        note="Share: of the pairs in contact with overlap >= 30 % and 120 s left, those that are merged by the end.",
        sensing="real",
    )
]
