"""`wireswarm bench lidar`: how many rays a second the lidar casts in each bundled world."""

import time

import numpy as np

from deploy.bench.cases import Case, Figures, each
from deploy.bench.tables import Table, whole
from protocol.messages import LidarSpec, RobotSpec
from world.lidar import Lidar
from world.worldfile import bundled, load


def cases(quick: bool) -> list[Case]:
    """Every bundled world with some numbers of robots, alone each: their figures are times."""
    worlds, robots = (bundled()[:2], (1, 3)) if quick else (bundled(), (1, 3, 10))
    fixed = {"places": 5 if quick else 20, "seconds": 0.2 if quick else 1.0}
    return each("lidar/{world}/{robots}", measure, fixed, alone=True, world=worlds, robots=robots)


def measure(world: str, robots: int, places: int, seconds: float) -> Figures:
    """Rays cast in `seconds` of wall-clock time, in turn from `places` sets of the robots' poses."""
    spec, radius_m, place, rng = LidarSpec(), RobotSpec().radius_m, load(world), np.random.default_rng(0)
    poses = [place.starts(robots, radius_m, rng, drawn=True) for _ in range(places)]
    scenes = [(pose, np.hstack([pose[:, :2], np.full((robots, 1), radius_m)])) for pose in poses]
    lidar = Lidar(place.segments, spec, one_sided=True)
    for pose, discs in scenes:  # fills the cache of candidates
        lidar.trace(pose, discs)
    casts, began = 0, time.perf_counter()
    while (took := time.perf_counter() - began) < seconds:
        lidar.trace(*scenes[casts % places])
        casts += 1
    rays_per_s, us_per_scan = round(casts * robots * spec.beams / took), round(1e6 * took / (casts * robots), 1)
    return {"walls": len(place.segments), "robots": robots, "rays_per_s": rays_per_s, "us_per_scan": us_per_scan}


HEADS = "world; walls; robots; rays_per_s: rays / s; us_per_scan: us a scan"
TABLES = [Table("lidar", "Rays a second, one core", whole("lidar/{world}/*"), HEADS)]
