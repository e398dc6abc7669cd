"""Drive control: follow a path, touch nothing (ours)."""

import math
from typing import NamedTuple

import numpy as np

from agent.exploration.config import HORIZON_COMMANDS, DrivingConfig
from agent.geometry.clearance import distance_to_walls, keeps_clear
from agent.kernels import kernel
from protocol.arrays import Floats
from protocol.geometry import Pose
from protocol.messages import LidarSpec, RobotSpec

LOOKAHEAD_M = 0.6  # distance of the point steered for: a shorter one lets the robot weave, a longer one cuts corners
_LOOKAHEAD_STEPS = 10  # points of the lookahead that are tried, the farthest first
TURN_GAIN = 0.6  # share of the heading error corrected in a tick; 1 would overshoot at the slightest delay
BESIDE_TEAMMATE_M = 0.6  # a teammate whose centre is nearer is beside the robot, but see `beside_m`
TURN_BESIDE_RAD = 0.5
"""Heading error beyond which a robot turns on the spot beside a teammate; elsewhere a quarter turn. Both move, and in
an arc the robot cannot give way: without this, robots touched in one of five runs of five robots in maze-15."""
SLOW_AIR_M = 0.05  # a robot with less air than this to a wall drives slowly
SLOW_SHARE = 0.5  # share of full speed at which it then drives
_ARC_STEPS = 4  # least places on that motion that are checked
MEET_M = 1.2
"""A teammate in the way is passed on the right from here on, but see `_meet_m`: at full speed both have 2.7 s to move
over."""
PASS_AIR_M = 0.03  # air when passing, beyond what stops the robot
_ASIDE_TRIES = 100  # places beside a teammate that are tried at most; for a robot as large as ours 40 suffice
CLEAR_SIDE_M = 0.15  # a teammate so far to the right of the way is passed on the left, as it has the robot on its right


class Obstacles(NamedTuple):
    """What a motion must not touch, frame of the map."""

    walls: Floats  # (m, 4) x1, y1, x2, y2 in metres
    discs: Floats  # (j, 2) centres of teammates


class Limits(NamedTuple):
    """Distances in metres from the robot's centre that every motion keeps."""

    wall: float
    disc: float


class Motion(NamedTuple):
    """A command, and whether walls or teammates held it back."""

    speed_mps: float
    turn_rps: float
    held: bool


STOP = Motion(0.0, 0.0, False)


@kernel
def _steer_point(x: float, y: float, path: Floats, walls: Floats, clearance: float) -> tuple[float, float]:
    """Farthest point of the path (k, 2), at most the lookahead along it, that is reached straight and clear.

    Points are tried from the farthest back, a tenth of the lookahead apart; the nearest one is taken unasked.
    """
    steps = _LOOKAHEAD_STEPS
    best_x, best_y = path[0, 0], path[0, 1]
    best, piece, share = math.inf, 0, 0.0
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
        left = LOOKAHEAD_M * (i + 1) / steps
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
def _safe(pose: Pose, speed: float, turn: float, seconds: float, obstacles: Obstacles, limits: Limits) -> bool:
    """Whether the arc driven for so long keeps its limits, or at least does not come nearer where it cannot."""
    x, y, theta = pose
    walls, discs = obstacles.walls, obstacles.discs
    wall_last = distance_to_walls(x, y, walls)
    disc_last = np.empty(discs.shape[0])
    for k in range(discs.shape[0]):
        disc_last[k] = math.hypot(discs[k, 0] - x, discs[k, 1] - y)
    steps = max(_ARC_STEPS, math.ceil(speed * seconds / limits.wall))  # a fast robot steps over no wall
    dt = seconds / steps
    for _ in range(steps):
        middle = theta + 0.5 * turn * dt
        x += speed * dt * math.cos(middle)
        y += speed * dt * math.sin(middle)
        theta += turn * dt
        d = distance_to_walls(x, y, walls)
        if d < limits.wall and d < wall_last - 1e-6:
            return False
        wall_last = d
        for k in range(discs.shape[0]):
            d = math.hypot(discs[k, 0] - x, discs[k, 1] - y)
            if d < limits.disc and d < disc_last[k] - 1e-6:
                return False
            disc_last[k] = d
    return True


def horizon_m(spec: RobotSpec) -> float:
    """Metres that the robot drives at most within the commands for which a motion must be free."""
    return HORIZON_COMMANDS * spec.max_speed_mps / spec.lidar.rate_hz


def sees_m(lidar: LidarSpec) -> float:
    """Metres around the robot's middle that its lidar sees, however the robot stands; 0 where that is nothing."""
    return max(lidar.range_max_m - math.hypot(lidar.mount_x_m, lidar.mount_y_m), 0.0)


def limits_of(config: DrivingConfig, spec: RobotSpec) -> Limits:
    """How near a robot's centre may come to walls and teammates."""
    return Limits(spec.radius_m + config.wall_air_m, 2.0 * spec.radius_m + config.teammate_air_m)


def passing_m(limits: Limits) -> float:
    """Metres between the centres of two robots that pass each other."""
    return limits.disc + PASS_AIR_M


def ticks_to_drive(metres: float, spec: RobotSpec) -> int:
    """Ticks in which the robot drives so far at full speed; at least one."""
    return max(1, round(metres * spec.lidar.rate_hz / spec.max_speed_mps))


class Driver:
    """Turns a path and what is seen now into speed and turn rate; keeps nothing between ticks."""

    def __init__(self, config: DrivingConfig, spec: RobotSpec) -> None:
        self.config, self.spec = config, spec
        self.tick_s = 1.0 / spec.lidar.rate_hz
        self.limits = limits_of(config, spec)
        self._passing_m = passing_m(self.limits)
        self.close_m = max(BESIDE_TEAMMATE_M, self._passing_m)  # nearer, a teammate may hold the robot at any speed
        # from there two that drive towards each other are at their limit within the horizon
        self.beside_m = max(BESIDE_TEAMMATE_M, self.limits.disc + 2.0 * horizon_m(spec))
        # there they still have the way to the point that they steer for
        self._meet_m = max(MEET_M, self._passing_m + 2.0 * horizon_m(spec) + LOOKAHEAD_M)

    def follow(self, path: Floats, pose: Pose, obstacles: Obstacles, clearance_m: float) -> Motion:
        """Command for the next tick along path (k, 2), cutting its corners no closer than the clearance.

        The clearance is never less than the limit of every motion. All in the frame of the pose.
        """
        x, y, _ = pose
        if len(path) < 2:
            path = np.vstack((path, path))
        point = _steer_point(x, y, path, obstacles.walls, max(clearance_m, self.limits.wall))
        left_m = math.hypot(path[-1, 0] - x, path[-1, 1] - y)
        if len(obstacles.discs):
            point = self._aside(point, x, y, obstacles, left_m)
        return self.towards(point, pose, obstacles, left_m)

    def _aside(
        self, point: tuple[float, float], x: float, y: float, obstacles: Obstacles, left_m: float
    ) -> tuple[float, float]:
        """The point to steer for, or one to the right of it if a teammate is in the way: who meets passes on the right.

        A robot moves over as far as it must, or as the walls let it; the other one does the same. left_m: to the end of
        the path.
        """
        px, py = point
        way = math.hypot(px - x, py - y)
        if way < 1e-6:
            return point
        ux, uy = (px - x) / way, (py - y) / way
        need = self._passing_m
        meet_m = max(MEET_M, min(self._meet_m, left_m + need))  # who stands farther behind the end is not passed
        nearest, left_of_way = meet_m, math.inf
        for dx, dy in (obstacles.discs - (x, y)).tolist():
            ahead, left = ux * dx + uy * dy, ux * dy - uy * dx
            if 0.0 < ahead < nearest and abs(left) < need and math.hypot(dx, dy) > 1e-6:
                nearest, left_of_way = ahead, left
        if nearest >= meet_m:
            return point
        # one that is clearly on the right is passed on the left, which is its own right if it comes towards us
        side = -1.0 if left_of_way > -CLEAR_SIDE_M else 1.0
        forward = min(max(nearest - need, 0.0), LOOKAHEAD_M)
        shift = need + side * left_of_way
        step = max(self.config.wall_air_m, shift / _ASIDE_TRIES)
        while shift > 0.0:
            qx, qy = x + forward * ux - side * shift * uy, y + forward * uy + side * shift * ux
            if keeps_clear(x, y, qx, qy, obstacles.walls, self.limits.wall):
                return qx, qy
            shift -= step
        return point

    def towards(self, point: tuple[float, float], pose: Pose, obstacles: Obstacles, left_m: float) -> Motion:
        """Command for the next tick towards a point, with left_m to go at most."""
        spec, (x, y, theta), (px, py) = self.spec, pose, point
        if math.hypot(px - x, py - y) < 1e-6:
            return STOP
        bearing = math.atan2(py - y, px - x) - theta
        error = math.atan2(math.sin(bearing), math.cos(bearing))
        turn = max(-spec.max_turn_rps, min(spec.max_turn_rps, TURN_GAIN * error / self.tick_s))
        beside = len(obstacles.discs) > 0 and np.hypot(*(obstacles.discs - (x, y)).T).min() < self.beside_m
        if abs(error) > (TURN_BESIDE_RAD if beside else 0.5 * math.pi):
            return Motion(0.0, turn, False)
        # full speed along the way, and no faster than the tightest arc to the point allows
        speed = spec.max_speed_mps * math.cos(error - 0.5 * turn * self.tick_s)
        if error:
            speed = min(speed, 0.5 * spec.max_turn_rps * math.hypot(px - x, py - y) / math.sin(abs(error)))
        speed = min(speed, left_m / self.tick_s)
        if distance_to_walls(x, y, obstacles.walls) < spec.radius_m + SLOW_AIR_M:
            speed = min(speed, SLOW_SHARE * spec.max_speed_mps)
        return self.safely(speed, turn, pose, obstacles)

    def safely(self, speed: float, turn: float, pose: Pose, obstacles: Obstacles) -> Motion:
        """The fastest share of the command whose predicted motion touches nothing; turning on the spot always is."""
        seconds = HORIZON_COMMANDS * self.tick_s
        for share in (1.0, 0.5, 0.25):
            if _safe(pose, share * speed, turn, seconds, obstacles, self.limits):
                return Motion(share * speed, turn, share < 1.0)
        return Motion(0.0, turn, True)
