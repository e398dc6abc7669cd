"""How a robot moved by its wheels: dead reckoning, its covariance, and what is wrong with these wheels (ours).

Wheels err at random, and by constants of each robot: their size, how much they differ, and the length of the axle
(Borenstein and Feng, "Measurement and correction of systematic odometry errors in mobile robots", 1996). Where they
differ by 1 %, a robot that means to drive straight turns by 4 degrees a metre. The constants are part of a particle's
state: what a scan says of the pose says as much of them as they are correlated with it (`joint.py`).
"""

import math
from itertools import pairwise

import numpy as np

from agent.mapping.joint import BEGIN
from protocol.arrays import Floats
from protocol.geometry import Pose, compose, pose_of, relative
from protocol.messages import OdometrySpec

FLOOR = 1e-8  # m2 and rad2 added to the pose's covariance in each step, so that it is never singular
FORGET_M = 2000.0
"""Metres of way in which a constant becomes as uncertain again as at first: its estimate leans on poses in the robot's
own map, which are less independent than their covariance says."""


def moves_of(way: Floats) -> list[Pose]:
    """Each step of a way (k + 1, 3) as the next pose in the frame of the one before."""
    return [relative(a, b) for a, b in pairwise(map(pose_of, way))]


def way_from(stamp: Pose, poses: Floats) -> Floats:
    """(k + 1, 3) a pose and the k that follow it, (k, 3), in its frame."""
    return np.array([relative(stamp, pose) for pose in (stamp, *map(pose_of, poses))])


class Wheels:
    """What each particle knows of its wheels' constants, and how a motion makes its pose uncertain."""

    def __init__(self, spec: OdometrySpec, particles: int) -> None:
        """Begin with wheels as they should be."""
        self._spec = spec
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

    def move(self, poses: Floats, joint: Floats, told: list[Pose]) -> Floats:
        """Move particles' poses (p, 3) and joint covariances (p, m, m) in place; the last pose begins the turn.

        Returns (p, 2): by how much the variance of place and heading grew.
        """
        spec = self._spec
        ahead = sum(math.hypot(dx, dy) for dx, dy, _ in told)
        turned = sum(abs(turn) for _, _, turn in told)
        spin = math.radians(spec.heading_sd_deg) ** 2 * ahead + spec.turn_sd**2 * turned
        grown = np.zeros((len(poses), 2))
        for p, row in enumerate(poses):
            x, y, theta = row.tolist()
            by = self.way(told, p)[-1]
            poses[p] = compose((x, y, theta), by)
            dx, dy = poses[p, 0] - x, poses[p, 1] - y
            driven = math.copysign(ahead, by[0])
            step = np.eye(6)
            step[0, 2], step[1, 2] = -dy, dx  # the heading's error swings the step
            step[:3, 3] = -dx, -dy, -by[2]
            step[:3, 4] = 0.5 * driven * dy, -0.5 * driven * dx, -driven
            step[:3, 5] = -0.5 * by[2] * dy, 0.5 * by[2] * dx, by[2]
            joint[p, BEGIN : BEGIN + 3] = joint[p, :3]
            joint[p, :, BEGIN : BEGIN + 3] = joint[p, :, :3]
            before = joint[p, :6, :6].copy()
            after = step @ before @ step.T
            length = math.hypot(dx, dy)
            if length > 1e-9:
                way = np.array((dx, dy)) / length
                after[:2, :2] += spec.distance_sd**2 * ahead * np.outer(way, way)
            after[2, 2] += spin
            after[[0, 1, 2], [0, 1, 2]] += FLOOR
            after[3:, 3:] += ahead * self._forget
            grown[p] = after[0, 0] + after[1, 1] - before[0, 0] - before[1, 1], after[2, 2] - before[2, 2]
            joint[p, :6, 6:] = step @ joint[p, :6, 6:]
            joint[p, 6:, :6] = joint[p, :6, 6:].T
            joint[p, :6, :6] = 0.5 * (after + after.T)
        return np.maximum(grown, 0.0)
