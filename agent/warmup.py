"""A robot's first steps in a made-up room, so that none of its real ones waits for kernels to be loaded (ours).

Loading what numba keeps compiled takes half a second, which is two scans missed in real time.
"""

from __future__ import annotations

import math

import numpy as np

from agent.alignment import align_prepared, prepare
from agent.config import AgentConfig
from agent.robot import Robot
from protocol.arrays import Floats
from protocol.messages import Observation, RobotSpec

TICKS = 40
"""Enough to map some walls, choose a frontier, plan and drive."""

_ROOM = np.array(
    [(-1, -1, 5, -1), (5, -1, 5, 2), (5, 2, 2, 2), (2, 2, 2, 1), (2, 1, 1.8, 1), (1.8, 1, 1.8, 2), (1.8, 2, -1, 2),
     (-1, 2, -1, -1)], np.float64,
)  # fmt: skip

_rehearsed = False


def rehearse() -> None:
    """Let a robot map, drive and align once in this process; later calls, and those in its forks, do nothing."""
    global _rehearsed
    if _rehearsed:
        return
    _rehearsed = True
    spec, config = RobotSpec(), AgentConfig()
    robot = Robot("r1", spec, config, 0)
    x = y = theta = 0.0
    for tick in range(TICKS):
        ranges = _ranges(x, y, theta, spec).astype("<f4").tobytes()
        action = robot.step(Observation(tick=tick, ranges=ranges, odometry=(x, y, theta)), []).action
        ahead, turn = action.speed_mps / spec.lidar.rate_hz, action.turn_rps / spec.lidar.rate_hz
        x, y, theta = x + ahead * math.cos(theta), y + ahead * math.sin(theta), theta + turn
    mine = prepare(robot.own, config.alignment)
    align_prepared(mine, mine, config.alignment, np.random.default_rng(0))


def _ranges(x: float, y: float, theta: float, spec: RobotSpec) -> Floats:
    """(beams,) metres to the room's walls, inf beyond the lidar's range."""
    angles = theta + np.arange(spec.lidar.beams) * (2 * math.pi / spec.lidar.beams)
    c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
    from_x, from_y = _ROOM[:, 0] - x, _ROOM[:, 1] - y
    along_x, along_y = _ROOM[:, 2] - _ROOM[:, 0], _ROOM[:, 3] - _ROOM[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = c * along_y - s * along_x
        distance = (from_x * along_y - from_y * along_x) / cross
        share = (from_x * s - from_y * c) / cross
    met = (distance > 0) & (share >= 0) & (share <= 1)
    nearest = np.where(met, distance, np.inf).min(1)
    return np.where(nearest <= spec.lidar.range_max_m, nearest, np.inf)
