"""What stands beside the robot and is no wall of its scan: too near to be measured, or neither wall nor disc (ours)."""

import numpy as np

from agent.corner_scan import NOISE_SIGMAS, range_noise
from agent.geometry.clearance import distances_to_walls, walls_near
from protocol.arrays import Floats
from protocol.geometry import Pose, apply
from protocol.messages import RobotSpec

SHOWN_M = 0.05
"""A wall is shown where map or scan has one so near to its point nearest to the robot: three times what a scan's piece
errs. Asked of its middle, a post's other faces showed the one that a robot drove into (`hall`, posts of 0.2 m)."""
_FRONTS = 4  # straight pieces that stand for what is close in one sector
MOST = 50  # walls kept: 1.6 kB


def blind_m(spec: RobotSpec) -> float:
    """Metres from the lidar within which what was measured in one scan may be too near to be in the next."""
    drive_m = spec.max_speed_mps / spec.lidar.rate_hz
    return spec.lidar.range_min_m + NOISE_SIGMAS * range_noise(spec.lidar) + drive_m


class CloseWalls:
    """Short memory of what scans have shown beside the robot. It forgets what the robot drives away from.

    In `hall` a robot crept up to a post of 0.1 m that is in no map. From 0.12 m on no scan showed it, and the robot
    drove on at full speed.
    """

    def __init__(self, spec: RobotSpec) -> None:
        self._blind_m = blind_m(spec)
        self._walls = np.zeros((0, 4))

    def move(self, by: Pose) -> None:
        """Have what is remembered elsewhere in the frame of the map."""
        self._walls = apply(by, self._walls.reshape(-1, 2)).reshape(-1, 4)

    def hidden(self, x: float, y: float, seen: Floats, known: Floats, close: Floats) -> Floats:
        """(k, 4) walls beside a robot at (x, y) that are not known: those of former scans, and what is close now.

        seen: (n, 4) walls of this scan. known: (m, 4) all walls, these included. close: (c, 4) `fronts` of this scan.
        Metres, frame of the map.
        """
        near = walls_near(self._walls, x, y, self._blind_m)
        kept = _not_shown(near, x, y, np.vstack((known, close)))
        hidden = np.vstack((kept, _not_shown(close, x, y, known)))
        self._walls = np.vstack((hidden, walls_near(seen, x, y, self._blind_m)))[-MOST:]
        return hidden


def _not_shown(walls: Floats, x: float, y: float, by: Floats) -> Floats:
    """Those of walls (k, 4) whose point nearest to (x, y) is on none of the others (m, 4)."""
    return walls[distances_to_walls(_nearest_points(walls, x, y), by) > SHOWN_M] if len(walls) else walls


def fronts(close: Floats, pose: Pose) -> Floats:
    """(4 c, 4) walls, frame of the pose's map, for sectors (c, 3) of what is close, as of Situation.

    In `hall` a post and a teammate beside it were one shape, neither wall nor disc: the robot drove into the post.
    """
    if not len(close):  # in 499 of 500 ticks
        return np.zeros((0, 4))
    shares = np.linspace(0.0, 1.0, _FRONTS + 1)
    bearings = close[:, :1] + shares * (close[:, 1:2] - close[:, :1])
    points = apply(pose, (close[:, 2:, None] * np.stack((np.cos(bearings), np.sin(bearings)), 2)).reshape(-1, 2))
    points = points.reshape(len(close), _FRONTS + 1, 2)
    return np.concatenate((points[:, :-1], points[:, 1:]), 2).reshape(-1, 4)


def _nearest_points(walls: Floats, x: float, y: float) -> Floats:
    """(m, 2) the point of each wall (m, 4) that is nearest to (x, y)."""
    tails, ways = walls[:, :2], walls[:, 2:] - walls[:, :2]
    shares = ((np.array((x, y)) - tails) * ways).sum(1) / np.maximum((ways**2).sum(1), 1e-12)
    nearest: Floats = tails + np.clip(shares, 0.0, 1.0)[:, None] * ways
    return nearest
