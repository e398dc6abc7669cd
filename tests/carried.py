"""A lidar that is carried along a way through walls: its scans, and an odometry that drifts."""

import math

import numpy as np

from protocol.arrays import Floats
from protocol.geometry import Pose
from protocol.messages import LidarSpec, Observation, OdometrySpec
from world.lidar import Lidar
from world.odometry import Odometry

Point = tuple[float, float]

HALF_TURN = LidarSpec(beams=180, field_of_view_deg=180.0, first_beam_deg=-90.0, range_max_m=10.0)
DRIFT = OdometrySpec(noisy=True, distance_sd=0.03, heading_sd_deg=1.5, turn_sd=0.03, wheel_sd=0.0, axle_sd=0.0)
"""As the logs in /work/shared/logs were made."""


def outline(*points: Point) -> list[tuple[float, float, float, float]]:
    """Walls of a closed outline; free space on the left."""
    return [(*a, *b) for a, b in zip(points, (*points[1:], points[0]), strict=True)]


def ring_corridor(side: float, width: float, niches: bool = True) -> Floats:
    """(n, 4) walls of a corridor around a square block; with a niche of its own in each of the outer sides."""
    corners, outer = [(0.0, 0.0), (side, 0.0), (side, side), (0.0, side)], []
    for k, (a, b) in enumerate(zip(corners, (*corners[1:], corners[0]), strict=True)):
        outer.append(a)
        ux, uy = (b[0] - a[0]) / side, (b[1] - a[1]) / side
        if niches:
            at, wide, deep = side * (0.25 + 0.15 * k), 0.8 + 0.4 * k, 0.6 + 0.3 * k
            for t, out in ((at, 0.0), (at, deep), (at + wide, deep), (at + wide, 0.0)):
                outer.append((a[0] + t * ux + out * uy, a[1] + t * uy - out * ux))
    inner = [(width, width), (width, side - width), (side - width, side - width), (side - width, width)]
    return np.array(outline(*outer) + outline(*inner))


def laps(side: float, width: float, count: float, step: float = 0.25) -> Floats:
    """(n, 3) poses counter-clockwise along the middle of that corridor, `count` times around, turning at corners."""
    near, far = 0.5 * width, side - 0.5 * width
    stops = [(near, near), (far, near), (far, far), (near, far)]
    out: list[Pose] = []
    for k in range(round(4 * count)):
        a, b = stops[k % 4], stops[(k + 1) % 4]
        heading = 0.5 * math.pi * (k % 4)
        n = round(math.dist(a, b) / step)
        out += [(a[0] + (b[0] - a[0]) * j / n, a[1] + (b[1] - a[1]) * j / n, heading) for j in range(n)]
        out += [(*b, heading + 0.5 * math.pi * j / 4) for j in range(4)]
    return np.array(out)


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
