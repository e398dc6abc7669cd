"""Drive control: follow a path, touch nothing (ours)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agent.exploration.config import DrivingConfig
from agent.geometry.clearance import distance_to_walls, keeps_clear
from agent.kernels import kernel
from protocol.arrays import Floats
from protocol.geometry import Pose
from protocol.messages import RobotSpec


class Motion(NamedTuple):
    """A command, and whether walls or teammates held it back."""

    speed_mps: float
    turn_rps: float
    held: bool


@kernel
def _steer_point(
    x: float, y: float, path: Floats, walls: Floats, lookahead: float, clearance: float
) -> tuple[float, float]:
    """Farthest point of the path (k, 2), at most the lookahead along it, that is reached straight and clear.

    Walked backwards in steps of a tenth of the lookahead; the nearest one is taken unasked.
    """
    steps = 10
    best_x, best_y = path[0, 0], path[0, 1]
    best = math.inf
    piece, share = 0, 0.0
    for k in range(path.shape[0] - 1):
        ax, ay = path[k, 0], path[k, 1]
        dx, dy = path[k + 1, 0] - ax, path[k + 1, 1] - ay
        length2 = dx * dx + dy * dy
        t = min(1.0, max(0.0, ((x - ax) * dx + (y - ay) * dy) / length2)) if length2 > 0.0 else 0.0
        d = math.hypot(ax + t * dx - x, ay + t * dy - y)
        if d < best - 1e-9:
            best, piece, share = d, k, t
            best_x, best_y = ax + t * dx, ay + t * dy
    ahead = np.empty((steps, 2))
    for i in range(steps):
        left = lookahead * (i + 1) / steps
        k, t = piece, share
        px, py = best_x, best_y
        while k < path.shape[0] - 1:
            rest = math.hypot(path[k + 1, 0] - px, path[k + 1, 1] - py)
            if rest >= left:
                px += (path[k + 1, 0] - px) * left / rest
                py += (path[k + 1, 1] - py) * left / rest
                break
            left -= rest
            k += 1
            px, py = path[k, 0], path[k, 1]
        ahead[i, 0], ahead[i, 1] = px, py
    for i in range(steps - 1, 0, -1):
        if keeps_clear(x, y, ahead[i, 0], ahead[i, 1], walls, clearance):
            return ahead[i, 0], ahead[i, 1]
    return ahead[0, 0], ahead[0, 1]


@kernel
def _safe(
    x: float, y: float, theta: float, speed: float, turn: float, walls: Floats, discs: Floats,
    wall_limit: float, disc_limit: float, seconds: float,
) -> bool:  # fmt: skip
    """Whether the arc driven for so long keeps its limits, or at least does not come nearer where it cannot."""
    steps = 4
    wall_last = distance_to_walls(x, y, walls)
    disc_last = np.empty(discs.shape[0])
    for k in range(discs.shape[0]):
        disc_last[k] = math.hypot(discs[k, 0] - x, discs[k, 1] - y)
    dt = seconds / steps
    for _ in range(steps):
        middle = theta + 0.5 * turn * dt
        x += speed * dt * math.cos(middle)
        y += speed * dt * math.sin(middle)
        theta += turn * dt
        d = distance_to_walls(x, y, walls)
        if d < wall_limit and d < wall_last - 1e-6:
            return False
        wall_last = d
        for k in range(discs.shape[0]):
            d = math.hypot(discs[k, 0] - x, discs[k, 1] - y)
            if d < disc_limit and d < disc_last[k] - 1e-6:
                return False
            disc_last[k] = d
    return True


class Driver:
    """Turns a path and what is seen now into speed and turn rate; keeps nothing between ticks."""

    def __init__(self, config: DrivingConfig, spec: RobotSpec) -> None:
        self.config = config
        self.spec = spec
        self.wall_limit = spec.radius_m + config.wall_margin_m
        self.disc_limit = 2.0 * spec.radius_m + config.teammate_margin_m

    def follow(self, path: Floats, pose: Pose, walls: Floats, discs: Floats, clearance_m: float) -> Motion:
        """Command for the next tick along path (k, 2), cutting its corners no closer than the clearance.

        walls (m, 4), discs (j, 2) of teammates: all in the frame of the pose.
        """
        x, y, _ = pose
        if len(path) < 2:
            path = np.vstack((path, path))
        px, py = _steer_point(x, y, path, walls, self.config.lookahead_m, clearance_m)
        if len(discs):
            px, py = self._aside(px, py, x, y, walls, discs)
        left = math.hypot(path[-1, 0] - x, path[-1, 1] - y)
        return self.towards(px, py, pose, walls, discs, left)

    def _aside(self, px: float, py: float, x: float, y: float, walls: Floats, discs: Floats) -> tuple[float, float]:
        """The point to steer for, or one to the right of it if a teammate is in the way: who meets passes on the right.

        A robot moves over as far as it must, or as the walls let it; the other one does the same.
        """
        c = self.config
        way = math.hypot(px - x, py - y)
        if way < 1e-6:
            return px, py
        ux, uy = (px - x) / way, (py - y) / way
        need = self.disc_limit + c.pass_margin_m
        nearest = c.meet_m
        left_of_way = math.inf
        for dx, dy in (discs - (x, y)).tolist():
            ahead, left = ux * dx + uy * dy, ux * dy - uy * dx
            if 0.0 < ahead < nearest and abs(left) < need and math.hypot(dx, dy) > 1e-6:
                nearest, left_of_way = ahead, left
        if nearest >= c.meet_m:
            return px, py
        # one that is clearly on the right is passed on the left, which is its own right if it comes towards us
        side = -1.0 if left_of_way > -c.clear_side_m else 1.0
        forward = min(max(nearest - need, 0.0), c.lookahead_m)
        shift = need + side * left_of_way
        while shift > 0.0:
            qx, qy = x + forward * ux - side * shift * uy, y + forward * uy + side * shift * ux
            if keeps_clear(x, y, qx, qy, walls, self.wall_limit):
                return qx, qy
            shift -= c.wall_margin_m
        return px, py

    def towards(self, px: float, py: float, pose: Pose, walls: Floats, discs: Floats, left_m: float) -> Motion:
        """Command for the next tick towards a point, with left_m to go at most."""
        c, spec = self.config, self.spec
        x, y, theta = pose
        if math.hypot(px - x, py - y) < 1e-6:
            return Motion(0.0, 0.0, False)
        bearing = math.atan2(py - y, px - x) - theta
        error = math.atan2(math.sin(bearing), math.cos(bearing))
        turn = max(-spec.max_turn_rps, min(spec.max_turn_rps, c.turn_gain * error / c.tick_s))
        if abs(error) > c.turn_in_place_rad:
            return Motion(0.0, turn, False)
        speed = spec.max_speed_mps * (1.0 - 0.5 * abs(error) / c.turn_in_place_rad)
        speed = min(speed, left_m / c.tick_s)
        if distance_to_walls(x, y, walls) < spec.radius_m + c.slow_margin_m:
            speed = min(speed, c.slow_share * spec.max_speed_mps)
        return self.safely(speed, turn, pose, walls, discs)

    def safely(self, speed: float, turn: float, pose: Pose, walls: Floats, discs: Floats) -> Motion:
        """The fastest share of the command whose predicted motion touches nothing; turning on the spot always is."""
        c = self.config
        seconds = c.horizon_ticks * c.tick_s
        for share in (1.0, 0.5, 0.25):
            if _safe(*pose, share * speed, turn, walls, discs, self.wall_limit, self.disc_limit, seconds):
                return Motion(share * speed, turn, share < 1.0)
        return Motion(0.0, turn, True)
