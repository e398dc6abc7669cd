"""How many rays a second the lidar casts in each bundled world."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from protocol.messages import LidarSpec, RobotSpec
from world.lidar import Lidar
from world.worldfile import bundled, load


def measure(quick: bool) -> list[dict[str, Any]]:
    """One row per world and number of robots; every cast is at new poses."""
    spec, radius_m = LidarSpec(), RobotSpec().radius_m
    rows = []
    for name in bundled()[: 2 if quick else None]:
        world = load(name)
        for robots in (1, 3) if quick else (1, 3, 10):
            rng = np.random.default_rng(0)
            poses = [world.starts(robots, radius_m, rng, drawn=True) for _ in range(5 if quick else 20)]
            lidar = Lidar(world.segments, spec, one_sided=True)
            for pose in poses:  # fills the cache of candidates
                lidar.trace(pose, _discs(pose, radius_m))
            casts, began = 0, time.perf_counter()
            while (took := time.perf_counter() - began) < (0.2 if quick else 1.0):
                pose = poses[casts % len(poses)]
                lidar.trace(pose, _discs(pose, radius_m))
                casts += 1
            rows.append(
                {
                    "world": name,
                    "walls": len(world.segments),
                    "robots": robots,
                    "rays_per_s": round(casts * robots * spec.beams / took),
                    "us_per_scan": round(1e6 * took / (casts * robots), 1),
                }
            )
    return rows


def _discs(poses: np.ndarray[Any, np.dtype[np.float64]], radius_m: float) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.hstack([poses[:, :2], np.full((len(poses), 1), radius_m)])
