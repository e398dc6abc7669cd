"""How a robot moved by its wheels: dead reckoning, its covariance, and what is wrong with these wheels (ours).

Wheels err at random, and by constants of each robot: their size, how much they differ, and the length of the axle
(Borenstein and Feng, "Measurement and correction of systematic odometry errors in mobile robots", 1996). Where they
differ by 1 %, a robot that means to drive straight turns by 4 degrees a metre. The constants are part of a particle's
state: what a scan says of the pose says as much of them as they are correlated with it (`joint.py`).
"""

import math
from itertools import pairwise

import numpy as np

from agent.kernels import kernel
from agent.mapping.joint import BEGIN
from protocol.arrays import Floats
from protocol.geometry import Pose, compose, pose_of, relative
from protocol.messages import OdometrySpec

FLOOR = 1e-8  # m2 and rad2 added to the pose's covariance in each step, so that it is never singular
FORGET_M = 2000.0
"""Metres of way in which a constant becomes as uncertain again as at first: its estimate leans on poses in the robot's
own map, which are less independent than their covariance says."""
STEADY_S = 2.0
"""Seconds of one speed over which the length of moves is averaged. A move as it is told errs by 10 % at 5 Hz, and a
regression on numbers that err is diluted: the wheels' size came out 0.4 to 0.9 % too large."""
SAME_SPEED_SIGMAS = 3.0  # a move that is told to be longer or shorter by more is of another speed
TELLING_TURN_SIGMAS = 10.0
"""Deviations of its own error that a turn must have to tell of the axle. What is told on a straight way is error alone,
from which the axle was learned as 2 % too short in 20 m."""
SLIP_M, SLIP_RAD = 0.05, math.radians(10.0)
"""Metres and radians of error per square root of a second in which the robot touches something. Its wheels turn on
where its body is held, and who pushes it turns it: by up to 7 degrees and 40 mm in 0.2 s between two robots."""


def moves_of(way: Floats) -> list[Pose]:
    """Each step of a way (k + 1, 3) as the next pose in the frame of the one before."""
    return [relative(a, b) for a, b in pairwise(map(pose_of, way))]


def way_from(stamp: Pose, poses: Floats) -> Floats:
    """(k + 1, 3) a pose and the k that follow it, (k, 3), in its frame."""
    return np.array([relative(stamp, pose) for pose in (stamp, *map(pose_of, poses))])


class Wheels:
    """What each particle knows of its wheels' constants, and how a motion makes its pose uncertain."""

    def __init__(self, spec: OdometrySpec, particles: int, scans_hz: float) -> None:
        """Begin with wheels as they should be. scans_hz: moves a second."""
        self._spec, self._most = spec, STEADY_S * scans_hz
        self._slip = np.array((SLIP_M, SLIP_M, SLIP_RAD)) ** 2 / scans_hz
        self.steady = np.zeros(2)
        """(2,) metres ahead, as the mean of the last moves of one speed, and how many those are."""
        first = np.array((spec.wheel_sd / math.sqrt(2), spec.wheel_sd * math.sqrt(2) / spec.axle_m, spec.axle_sd))
        self._forget = np.diag(first**2) / FORGET_M
        self.constants = np.tile((1.0, 0.0, 1.0), (particles, 1))
        """(p, 3) size of the wheels as a share of what it should be, their difference in rad a metre, the axle's length
        as a share."""
        self.first = np.zeros((6, 6))
        """Covariance of pose and constants at first: the pose is exact."""
        self.first[3:, 3:] = np.diag(first**2)

    def way(self, told: list[Pose], particle: int) -> list[Pose]:
        """Poses, from zero, along which the wheels of a particle rolled when they told of these moves."""
        size, bend, axle = self.constants[particle].tolist()
        lever = bend * self._spec.axle_m**2 / 4
        way: list[Pose] = [(0.0, 0.0, 0.0)]
        for dx, dy, turn_told in told:
            ahead_told = dx * math.cos(turn_told / 2) + dy * math.sin(turn_told / 2)
            ahead = (ahead_told - lever * axle * turn_told / size) / (size - lever * bend / size)
            turn = (axle * turn_told - bend * ahead) / size
            scale = ahead / ahead_told if abs(ahead_told) > 1e-9 else 1.0
            c, s = scale * math.cos((turn - turn_told) / 2), scale * math.sin((turn - turn_told) / 2)
            way.append(compose(way[-1], (c * dx - s * dy, s * dx + c * dy, turn)))
        return way

    def move(self, poses: Floats, joint: Floats, told: list[Pose], slips: bool = False) -> Floats:
        """Move particles' poses (p, 3) and joint covariances (p, m, m) in place; the last pose begins the revolution.

        slips: whether the robot may touch something. Returns (p, 2): by how much the variance of place and heading
        grew.
        """
        spec = self._spec
        length = sum(math.hypot(dx, dy) for dx, dy, _ in told)
        ahead = self._steadied(sum(math.copysign(math.hypot(dx, dy), dx) for dx, dy, _ in told), length)
        turned = sum(abs(turn) for _, _, turn in told)
        spin = math.radians(spec.heading_sd_deg) ** 2 * length + spec.turn_sd**2 * turned
        grown = np.zeros((len(poses), 2))
        for p, row in enumerate(poses):
            x, y, theta = row.tolist()
            by = self.way(told, p)[-1]
            poses[p] = compose((x, y, theta), by)
            dx, dy = poses[p, 0] - x, poses[p, 1] - y
            turn = by[2] if by[2] ** 2 > TELLING_TURN_SIGMAS**2 * spin else 0.0
            heading = np.array((math.cos(theta + by[2] / 2), math.sin(theta + by[2] / 2)))
            noise = np.zeros((6, 6))
            noise[:2, :2] = spec.distance_sd**2 * abs(ahead) * np.outer(heading, heading)
            noise[2, 2] = spin
            noise[[0, 1, 2], [0, 1, 2]] += self._slip + FLOOR if slips else FLOOR
            noise[3:, 3:] = length * self._forget
            before = joint[p, [0, 1, 2], [0, 1, 2]]
            _carry(joint[p], (dx, dy), ahead, heading, turn, noise)
            after = joint[p, [0, 1, 2], [0, 1, 2]]
            grown[p] = after[0] + after[1] - before[0] - before[1], after[2] - before[2]
        return np.maximum(grown, 0.0)

    def _steadied(self, ahead: float, length: float) -> float:
        """Metres ahead in a move that is told as `ahead` on a way of `length`: the mean of the last of its speed."""
        mean, moves = self.steady.tolist()
        sd = self._spec.distance_sd * math.sqrt(length * (1.0 + 1.0 / max(moves, 1.0)))
        if abs(ahead - mean) > SAME_SPEED_SIGMAS * sd:
            moves = 0.0
        moves = min(moves + 1.0, self._most)
        mean += (ahead - mean) / moves
        self.steady[:] = mean, moves
        return float(mean)


@kernel
def _carry(joint: Floats, by: tuple[float, float], ahead: float, heading: Floats, turn: float, noise: Floats) -> None:
    """Carry a joint covariance (m, m) along a motion, in place; its old pose becomes that of the revolution's begin.

    by: metres in the map's frame. ahead: metres that the wheels drove, on the heading (2,). turn: radians that tell of
    the axle. noise: (6, 6) what the motion adds to pose and constants.
    """
    (dx, dy), ahead_x, ahead_y = by, ahead * heading[0], ahead * heading[1]
    size = joint.shape[0]
    for k in range(size):  # the begin's error in terms of the stamp's frame (`pose_correction.pose_at`)
        joint[BEGIN, k] = joint[0, k] - dy * joint[2, k]
        joint[BEGIN + 1, k] = joint[1, k] + dx * joint[2, k]
        joint[BEGIN + 2, k] = joint[2, k]
    for k in range(size):
        joint[k, BEGIN] = joint[k, 0] - dy * joint[k, 2]
        joint[k, BEGIN + 1] = joint[k, 1] + dx * joint[k, 2]
        joint[k, BEGIN + 2] = joint[k, 2]
    step = np.eye(6)
    step[0, 2], step[1, 2] = -dy, dx  # the heading's error swings the step
    step[0, 3], step[1, 3], step[2, 3] = -ahead_x, -ahead_y, -turn
    step[0, 4], step[1, 4], step[2, 4] = 0.5 * ahead * ahead_y, -0.5 * ahead * ahead_x, -ahead
    step[0, 5], step[1, 5], step[2, 5] = -0.5 * turn * ahead_y, 0.5 * turn * ahead_x, turn
    old = np.empty(6)
    for k in range(size):
        old[:] = joint[:6, k]
        for i in range(3):
            joint[i, k] = (step[i] * old).sum()
    for k in range(6):
        old[:] = joint[k, :6]
        for i in range(3):
            joint[k, i] = (step[i] * old).sum()
    joint[:6, :6] += noise
    joint[:6, :6] = 0.5 * (joint[:6, :6] + joint[:6, :6].T)
    joint[6:, :6] = joint[:6, 6:].T
