"""A lidar that is carried along a way through walls: its scans, and an odometry that drifts."""

import numpy as np

from deploy.bench.rings import Point, ring
from protocol.arrays import Floats
from protocol.messages import LidarSpec, Observation, OdometrySpec
from tests.ideal import ideal_lidar
from world.lidar.lidar import Lidar
from world.odometry import Odometry

HALF_TURN = ideal_lidar(beams=180, field_of_view_deg=180.0, first_beam_deg=-90.0, range_max_m=10.0)
DRIFT = OdometrySpec(noisy=True, distance_sd=0.03, heading_sd_deg=1.5, turn_sd=0.03, wheel_sd=0.0, axle_sd=0.0)
"""As the logs in /work/shared/logs were made."""


Wall = tuple[float, float, float, float]


def outline(*points: Point) -> list[Wall]:
    """Walls of a closed outline; free space on the left."""
    return [(*a, *b) for a, b in zip(points, (*points[1:], points[0]), strict=True)]


def ring_corridor(side: float, width: float) -> Floats:
    """(n, 4) walls of a ring."""
    outer, inner = ring(side, width)
    return np.array(outline(*outer) + outline(*inner))


def observations(walls: Floats, way: Floats, lidar: LidarSpec, drift: OdometrySpec, seed: int) -> list[Observation]:
    """What is observed at each pose of a way (n, 3) in the frame of the walls (m, 4)."""
    rng, cast = np.random.default_rng(seed), Lidar(walls, lidar)
    ranges = cast.measured(cast.cast(way), [rng] * len(way))
    believed = Odometry(way[0], drift, rng).update(way)
    return [
        Observation(tick=k, ranges=scan.astype("<f4").tobytes(), odometry=tuple(pose))
        for k, (scan, pose) in enumerate(zip(ranges, believed.tolist(), strict=True))
    ]


def path_error(found: Floats, true: Floats) -> float:
    """Root mean square distance, metres, of places (n, 2) from true ones after the best rigid fit (Horn 1987)."""
    a, b = found[:, :2] - found[:, :2].mean(0), true[:, :2] - true[:, :2].mean(0)
    u, _, vt = np.linalg.svd(a.T @ b)
    turn = u @ np.diag((1.0, np.linalg.det(u @ vt))) @ vt
    return float(np.sqrt(((a @ turn - b) ** 2).sum(1).mean()))
