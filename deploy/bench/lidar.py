"""`wireswarm bench lidar`: how many rays a second a lidar casts in each bundled world, at once and while it turns."""

import statistics
import time
from itertools import product

import numpy as np

from deploy.bench.cases import Case, Figures, each
from deploy.bench.tables import Table, whole
from protocol.arrays import Floats
from protocol.messages import LidarSpec, RobotSpec
from world.lidar.lidar import Lidar
from world.physics import STEP_S
from world.worldfile import bundled, load


def cases(quick: bool) -> list[Case]:
    """Every bundled world with some numbers of robots, alone each: their figures are times."""
    worlds, robots = (bundled()[:2], (1, 3)) if quick else (bundled(), (1, 3, 10, 30))
    fixed = {"places": 5 if quick else 20, "seconds": 0.2 if quick else 1.0}
    return each("lidar/{world}/{robots}", measure, fixed, alone=True, world=worlds, robots=robots)


def measure(world: str, robots: int, places: int, seconds: float) -> Figures:
    """Rays cast in `seconds` of CPU time, in turn from `places` sets of the robots' ways, by both lidars by turns.

    Times are medians of the rounds, because other processes disturb some.
    """
    place, radius_m, rng = load(world), RobotSpec().radius_m, np.random.default_rng(0)
    ways = [_driven(place.starts(robots, radius_m, rng, drawn=True), rng) for _ in range(places)]
    bodies = [np.concatenate([way[..., :2], np.full((*way.shape[:2], 1), radius_m)], 2) for way in ways]
    lidars = {turning: Lidar(place.segments, LidarSpec(turning=turning), one_sided=True) for turning in (False, True)}
    for lidar, (way, discs) in product(lidars.values(), zip(ways, bodies, strict=True)):  # fills caches
        lidar.trace(way, discs)
    took: dict[bool, list[float]] = {turning: [] for turning in lidars}
    while sum(took[False]) < seconds:
        for turning, lidar in lidars.items():
            began = time.process_time()  # a machine that others use, too, says nothing by the clock
            for way, discs in zip(ways, bodies, strict=True):
                lidar.trace(way, discs)
            took[turning].append(time.process_time() - began)
    at_once_s, turning_s = (statistics.median(took[turning]) / places / robots for turning in (False, True))
    return {
        "walls": len(place.segments),
        "robots": robots,
        "rays_per_s": round(LidarSpec().beams / at_once_s),
        "us_per_scan": round(1e6 * at_once_s, 1),
        "turning_us": round(1e6 * turning_s, 1),
        "turning_share": round(statistics.median(np.divide(took[True], took[False])), 3),
    }


def _driven(starts: Floats, rng: np.random.Generator) -> Floats:
    """(s, k, 3) ways of robots that drive arcs from their starts for a period, as `Lidar.trace` takes them."""
    spec, count = RobotSpec(), len(starts)
    steps = round(1 / spec.lidar.rate_hz / STEP_S)
    times = np.linspace(0, steps * STEP_S, steps + 1)[:, None]
    speed, turn = rng.uniform(0, spec.max_speed_mps, count), rng.uniform(-1, 1, count)  # rad/s, as on the way
    heading = starts[:, 2] + turn * times
    x = starts[:, 0] + speed * times * np.cos((starts[:, 2] + heading) / 2)
    y = starts[:, 1] + speed * times * np.sin((starts[:, 2] + heading) / 2)
    return np.stack([x, y, heading], 2)


HEADS = (
    "world; walls; robots; rays_per_s: rays / s; us_per_scan: us a scan; turning_us: turning us a scan; "
    "turning_share <= 1.5: to at once"
)
TABLES = [
    Table("lidar", "Rays a second, one core, all at once and while the lidar turns", whole("lidar/{world}/*"), HEADS)
]
