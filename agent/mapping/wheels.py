"""How a robot moved by its wheels: dead reckoning, its covariance, and what is wrong with these wheels (ours).

Wheels err at random, and by constants of each robot: their size, how much they differ, and the length of the axle
(Borenstein and Feng, "Measurement and correction of systematic odometry errors in mobile robots", 1996). Where they
differ by 1 %, a robot that means to drive straight turns by 4 degrees a metre. The constants are part of a particle's
state: what a scan says of the pose says as much of them as they are correlated with it (`joint.py`).
"""

import math

import numpy as np

from agent.kernels import kernel
from agent.mapping.joint import BEGIN
from protocol.arrays import Floats
from protocol.geometry import Pose, compose, relative
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


@kernel
def moves_of(way: Floats) -> Floats:
    """(k, 3) each step of a way (k + 1, 3): the next pose in the frame of the one before."""
    moves = np.empty((len(way) - 1, 3))
    for k in range(len(moves)):
        moves[k, 0], moves[k, 1], moves[k, 2] = relative(_pose(way, k), _pose(way, k + 1))
    return moves


@kernel
def way_from(stamp: Pose, poses: Floats) -> Floats:
    """(k + 1, 3) a pose and the k that follow it, (k, 3), in its frame."""
    way = np.zeros((len(poses) + 1, 3))
    for k in range(len(poses)):
        way[k + 1, 0], way[k + 1, 1], way[k + 1, 2] = relative(stamp, _pose(poses, k))
    return way


@kernel
def _pose(rows: Floats, k: int) -> Pose:
    """A row of poses (n, 3)."""
    return rows[k, 0], rows[k, 1], rows[k, 2]


LEAST, MOST = (0.25, -1.6, 0.25), (4.0, 1.6, 4.0)
"""Bounds of the constants in a checkpoint as shares, the difference times the axle: over three deviations of the worst
wheels that settings allow, and off zero, as moves are divided by the size."""


class Wheels:
    """What each particle knows of its wheels' constants, and how a motion makes its pose uncertain."""

    def __init__(self, spec: OdometrySpec, particles: int, scans_hz: float) -> None:
        """Begin with wheels as they should be. scans_hz: moves a second."""
        self._spec, self._most = spec, max(STEADY_S * scans_hz, 1.0)
        self._slip = np.array((SLIP_M, SLIP_M, SLIP_RAD)) ** 2 / scans_hz
        self.steady = np.zeros(2)
        """(2,) metres ahead, as the mean of the last moves of one speed, and how many those are."""
        first = np.array((spec.wheel_sd / math.sqrt(2), spec.wheel_sd * math.sqrt(2) / spec.axle_m, spec.axle_sd))
        self._forget = first**2 / FORGET_M
        self.constants = np.tile((1.0, 0.0, 1.0), (particles, 1))
        """(p, 3) size of the wheels as a share of what it should be, their difference in rad a metre, the axle's length
        as a share."""
        self.first = np.zeros((6, 6))
        """Covariance of pose and constants at first: the pose is exact."""
        self.first[3:, 3:] = np.diag(first**2)

    def are_possible(self, constants: Floats) -> bool:
        """Whether constants (p, 3) may be those of any wheels."""
        shares = constants * (1.0, self._spec.axle_m, 1.0)
        return bool(((shares >= LEAST) & (shares <= MOST)).all())

    def way(self, told: Floats, particle: int) -> Floats:
        """(k + 1, 3) poses, from zero, along which a particle's wheels rolled when they told of these moves (k, 3)."""
        return _rolled(told, self.constants[particle], self._spec.axle_m)

    def move(self, poses: Floats, joint: Floats, told: Floats, slips: bool = False) -> Floats:
        """Move particles' poses (p, 3) and joint covariances (p, m, m) in place; the last pose begins the revolution.

        told: (k, 3) moves. slips: whether the robot may touch something. Returns (p, 2): by how much the variance of
        place and heading grew.
        """
        spec, sizes = self._spec, np.hypot(told[:, 0], told[:, 1])
        length = float(sizes.sum())
        ahead = self._steadied(float(np.copysign(sizes, told[:, 0]).sum()), length)
        spin = math.radians(spec.heading_sd_deg) ** 2 * length + spec.turn_sd**2 * float(np.abs(told[:, 2]).sum())
        noise = np.concatenate((self._slip + FLOOR if slips else np.full(3, FLOOR), length * self._forget))
        noise[2] += spin
        along = spec.distance_sd**2 * abs(ahead)
        return _move(poses, joint, told, self.constants, spec.axle_m, ahead, spin, along, noise)

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
def _rolled(told: Floats, constants: Floats, axle_m: float) -> Floats:
    """`Wheels.way` by a particle's constants (3,)."""
    size, bend, axle = constants[0], constants[1], constants[2]
    lever = bend * axle_m**2 / 4
    way = np.zeros((len(told) + 1, 3))
    for k in range(len(told)):
        dx, dy, turn_told = told[k, 0], told[k, 1], told[k, 2]
        ahead_told = dx * math.cos(turn_told / 2) + dy * math.sin(turn_told / 2)
        ahead = (ahead_told - lever * axle * turn_told / size) / (size - lever * bend / size)
        turn = (axle * turn_told - bend * ahead) / size
        c, s = math.cos((turn - turn_told) / 2), math.sin((turn - turn_told) / 2)
        more = ahead - ahead_told  # on the chord alone: wheels tell nothing of what a robot does sideways
        x, y = c * dx - s * dy + more * math.cos(turn / 2), s * dx + c * dy + more * math.sin(turn / 2)
        next_pose = compose(_pose(way, k), (x, y, turn))
        way[k + 1, 0], way[k + 1, 1], way[k + 1, 2] = next_pose
    return way


@kernel
def _move(
    poses: Floats,
    joints: Floats,
    told: Floats,
    constants: Floats,
    axle_m: float,
    ahead: float,
    spin: float,
    along: float,
    noise: Floats,
) -> Floats:
    """`Wheels.move` by constants (p, 3).

    ahead: metres that the wheels drove, as steadied. spin: variance of the turn. along: variance of the way along it.
    noise: (6,) variances that the motion adds to pose and constants.
    """
    grown = np.empty((len(poses), 2))
    for p in range(len(poses)):
        joint, before = joints[p], _pose(poses, p)
        by = _pose(_rolled(told, constants[p], axle_m), len(told))
        after = compose(before, by)
        poses[p, 0], poses[p, 1], poses[p, 2] = after
        place, heading = joint[0, 0] + joint[1, 1], joint[2, 2]
        turn = by[2] if by[2] ** 2 > TELLING_TURN_SIGMAS**2 * spin else 0.0
        c, s = math.cos(before[2] + by[2] / 2), math.sin(before[2] + by[2] / 2)
        _carry(joint, (after[0] - before[0], after[1] - before[1]), (ahead * c, ahead * s), ahead, turn)
        joint[0, 0] += along * c * c
        joint[0, 1] += along * c * s
        joint[1, 0] += along * c * s
        joint[1, 1] += along * s * s
        for k in range(6):
            joint[k, k] += noise[k]
        grown[p, 0] = max(joint[0, 0] + joint[1, 1] - place, 0.0)
        grown[p, 1] = max(joint[2, 2] - heading, 0.0)
    return grown


@kernel
def _carry(joint: Floats, by: tuple[float, float], rolled: tuple[float, float], ahead: float, turn: float) -> None:
    """Carry a joint covariance (m, m) along a motion, in place; its old pose becomes that of the revolution's begin.

    by: metres in the map's frame. rolled: the metres that the wheels drove `ahead`, in that frame. turn: radians that
    tell of the axle.
    """
    size = len(joint)
    _begin_at(joint, by)
    _begin_at(joint.T, by)
    _swing(joint, by, rolled, ahead, turn)
    _swing(joint[:6].T, by, rolled, ahead, turn)  # of further rows, columns are copies, below
    for i in range(3):
        for k in range(i + 1, size):
            if k < 6:
                joint[i, k] = 0.5 * (joint[i, k] + joint[k, i])
            joint[k, i] = joint[i, k]


@kernel
def _begin_at(rows: Floats, by: tuple[float, float]) -> None:
    """Set rows of the begin to those of the old pose, in terms of the stamp's frame (`pose_correction.pose_at`)."""
    dx, dy = by
    for k in range(rows.shape[1]):
        rows[BEGIN, k] = rows[0, k] - dy * rows[2, k]
        rows[BEGIN + 1, k] = rows[1, k] + dx * rows[2, k]
        rows[BEGIN + 2, k] = rows[2, k]


@kernel
def _swing(rows: Floats, by: tuple[float, float], rolled: tuple[float, float], ahead: float, turn: float) -> None:
    """Move rows of the pose on: the heading's error swings the step, and the constants' errors bend it."""
    (dx, dy), (x, y) = by, rolled
    for k in range(rows.shape[1]):
        heading, wheel, bend, axle = rows[2, k], rows[3, k], rows[4, k], rows[5, k]
        rows[0, k] += -dy * heading - x * wheel + 0.5 * ahead * y * bend - 0.5 * turn * y * axle
        rows[1, k] += dx * heading - y * wheel - 0.5 * ahead * x * bend + 0.5 * turn * x * axle
        rows[2, k] += turn * (axle - wheel) - ahead * bend
