"""Walls that have come nearer than the lidar measures: they are in no scan any more, and still there (ours)."""

import numpy as np

from agent.corner_scan import NOISE_SIGMAS, range_noise
from agent.geometry.clearance import distances_to_walls, walls_near
from protocol.arrays import Floats
from protocol.messages import RobotSpec

SHOWN_M = 0.1  # a wall is shown where map or scan has one so near to its middle: five times what a scan's piece errs
MOST = 50  # walls kept: 1.6 kB


def blind_m(spec: RobotSpec) -> float:
    """Metres from the lidar within which what was measured in one scan may be too near to be in the next."""
    drive_m = spec.max_speed_mps / spec.lidar.rate_hz
    return spec.lidar.range_min_m + NOISE_SIGMAS * range_noise(spec.lidar) + drive_m


class CloseWalls:
    """Short memory of scans' walls beside the robot.

    In `hall` a robot crept up to a post of 0.1 m that is in no map. From 0.12 m on no scan showed it, and the robot
    drove on at full speed.
    """

    def __init__(self, spec: RobotSpec) -> None:
        self._blind_m = blind_m(spec)
        self._walls = np.zeros((0, 4))

    def hidden(self, x: float, y: float, seen: Floats, known: Floats) -> Floats:
        """(k, 4) walls of former scans beside a robot at (x, y) that nothing shows now.

        seen: (n, 4) walls of this scan. known: (m, 4) all walls, these included. Metres, frame of the map.
        """
        near = walls_near(self._walls, x, y, self._blind_m)
        hidden = near[distances_to_walls(0.5 * (near[:, :2] + near[:, 2:]), known) > SHOWN_M]
        self._walls = np.vstack((hidden, walls_near(seen, x, y, self._blind_m)))[-MOST:]
        return hidden
