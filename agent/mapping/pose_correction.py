"""Where the robot is, from the shift between a scan and the map (paper III, technique of its ref. 1; ours in detail).

Robust least squares on walls and their ends with the odometry as prior. Where walls are rectilinear, their common
axis holds the heading; where they are not, only the walls themselves do.
"""

import math
from typing import NamedTuple

import numpy as np

from agent.corner_scan import NOISE_FLOOR_M, NOMINAL, OCCLUSION
from agent.geometry.lines import Record, above, along
from agent.geometry.matrix3 import inverse, times
from agent.kernels import kernel
from agent.mapping.candidates import main_axis
from agent.mapping.edges import WALL, line_sd, spread, tip_at
from protocol.arrays import Floats, Ints, Records
from protocol.geometry import Pose, wrapped

AXIS_FLOOR = math.radians(0.1)  # least sd of walls about their axis, beside what is seen of it
HEADING_TRUST = 0.95  # agreement of the walls' directions above which their axis holds the heading
AXIS_PIECE_SD = math.radians(1.0)
"""Least precise direction of a piece that may lie on the axis: that of a face of 0.3 m is known to 2 degrees, and posts
turned by 10 degrees would turn the robot by 0.4 degrees a second."""
MAX_OFF_AXIS = 0.2  # rad, a piece that is more oblique belongs to no wall on the axis
WALL_FLOOR = math.radians(0.2)  # least sd of a wall's direction, beside its covariance: walls are not straight
MIN_VIEWS = 2.0  # views that must have confirmed an end before it holds the robot
ROUNDS = 3  # Gauss-Newton steps: weights and directions depend on the pose, which is near to the prediction


class Axis(NamedTuple):
    """Common axis of rectilinear walls."""

    angle: float  # rad, modulo a right angle
    sd: float  # rad, how well walls keep it; inf where they are not rectilinear


@kernel
def axis_of(edges: Records, count: int, noise: float) -> Axis:
    """The axis of a particle's walls, as those along it have it. noise: m, standard deviation of a range.

    A wall weighs by how well its direction is known, so those that a robot saw from where it began hold its frame.
    """
    angle, trust = main_axis(edges, count)
    if trust < HEADING_TRUST:
        return Axis(angle, math.inf)
    total, mean, square = 0.0, 0.0, 0.0
    for k in range(count):
        off = wrapped(math.atan2(edges[k].uy, edges[k].ux) - angle, 0.5 * math.pi)
        if edges[k].alive == WALL and abs(off) < MAX_OFF_AXIS:
            weight = 1.0 / (noise**2 / spread(edges[k]) + AXIS_FLOOR**2)
            total += weight
            mean += weight * off
            square += weight * off * off
    mean /= total
    return Axis(angle + mean, math.hypot(AXIS_FLOOR, math.sqrt(max(square / total - mean * mean, 0.0))))


@kernel
def pose_at(predicted: Pose, pose: Pose, moment: float, new: Floats) -> Pose:
    """Where the robot was at a moment of the turn (0 to 1, its stamp), in terms of the stamp's frame.

    The scan is unrolled by odometry. If its pose turns out otherwise than predicted, that error grew during the turn,
    but for what was there before. new: (2,) which part of the variance of place and heading the turn has added.
    """
    place, heading = 1.0 - (1.0 - moment) * new[0], 1.0 - (1.0 - moment) * new[1]
    return (
        predicted[0] + place * (pose[0] - predicted[0]),
        predicted[1] + place * (pose[1] - predicted[1]),
        predicted[2] + heading * wrapped(pose[2] - predicted[2]),
    )


@kernel
def _add_residual(h: Floats, g: Floats, prior: Floats, jx: float, jy: float, jt: float, off: float, sd: float) -> None:
    """Add one residual with Cauchy weight to the normal equations.

    The weight falls where the residual is large beside what noise and the prior covariance (3, 3) of the pose explain:
    a robot that comes back from a long drive along one wall may be off by many times the noise of a scan.
    """
    j, expected = (jx, jy, jt), sd * sd
    for row in range(3):
        for column in range(3):
            expected += j[row] * prior[row, column] * j[column]
    w = 1.0 / (sd * sd * (1.0 + off * off / (4.0 * expected)))
    for row in range(3):
        g[row] -= w * j[row] * off
        for column in range(row, 3):
            h[row, column] += w * j[row] * j[column]


@kernel
def correct_pose(
    edges: Records,
    pieces: Records,
    walls: Ints,
    predicted: Pose,
    covariance: Floats,
    new: Floats,
    axis: Axis,
    noise: float,
) -> tuple[Pose, Floats]:
    """Pose and its (3, 3) covariance from pieces (robot's frame), each associated with a wall or -1.

    predicted, covariance: by odometry. new: as of `pose_at`. noise: m, standard deviation of a range.
    """
    prior, pose = inverse(covariance), predicted
    h = prior
    for _ in range(ROUNDS):
        h = prior.copy()
        moved = (pose[0] - predicted[0], pose[1] - predicted[1], wrapped(pose[2] - predicted[2]))
        g = -times(prior, np.array(moved))
        for k in range(len(pieces)):
            p = pieces[k]
            then = pose_at(predicted, pose, p.moment, new)
            place, heading = 1.0 - (1.0 - p.moment) * new[0], 1.0 - (1.0 - p.moment) * new[1]
            off = wrapped(math.atan2(p.uy, p.ux) + then[2] - axis.angle, 0.5 * math.pi)
            sd = noise / math.sqrt(p.spread)
            if sd < AXIS_PIECE_SD and off * off < 9.0 * (sd * sd + axis.sd**2 + covariance[2, 2]):
                _add_residual(h, g, covariance, 0.0, 0.0, heading, off, math.hypot(sd, axis.sd))
            if walls[k] >= 0:
                _add_wall(h, g, covariance, p, edges[walls[k]], then, place, heading, noise)
        h[1, 0], h[2, 0], h[2, 1] = h[0, 1], h[0, 2], h[1, 2]
        step = times(inverse(h), g)
        pose = (pose[0] + step[0], pose[1] + step[1], pose[2] + step[2])
    return (pose[0], pose[1], wrapped(pose[2])), inverse(h)


@kernel
def _add_wall(
    h: Floats, g: Floats, prior: Floats, p: Record, w: Record, pose: Pose, place: float, heading: float, noise: float
) -> None:
    """Add the residuals of a piece to its wall: distance, direction, and ends, which hold the robot in a corridor.

    pose: at the piece's moment. place, heading: by how much it moves with the pose at the stamp.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    rx, ry = c * p.x - s * p.y, s * p.x + c * p.y
    x, y = pose[0] + rx, pose[1] + ry
    t = along(w, x, y)
    sd = math.hypot(noise / math.sqrt(p.hits), math.hypot(line_sd(w, t, noise), NOISE_FLOOR_M))
    _add_residual(h, g, prior, -place * w.uy, place * w.ux, heading * (w.uy * ry + w.ux * rx), above(w, x, y), sd)
    turn = wrapped(math.atan2(p.uy, p.ux) + pose[2] - math.atan2(w.uy, w.ux))
    sd = math.hypot(noise / math.sqrt(p.spread), math.hypot(noise / math.sqrt(spread(w)), WALL_FLOOR))
    _add_residual(h, g, prior, 0.0, 0.0, heading, turn, sd)
    for side in range(2):
        if p.label[side] != OCCLUSION or w.label[side] not in (NOMINAL, OCCLUSION) or w.strength[side] < MIN_VIEWS:
            continue
        outward = 1.0 if side == 1 else -1.0
        slack = 0.5 * (p.slack[side] + w.slack[side])
        off = t + p.end[side] - tip_at(w, side) + outward * 0.5 * (p.slack[side] - w.slack[side])
        ex, ey = rx + p.end[side] * w.ux, ry + p.end[side] * w.uy
        sd = math.hypot(slack / math.sqrt(3.0), NOISE_FLOOR_M + noise)
        _add_residual(h, g, prior, place * w.ux, place * w.uy, heading * (w.uy * ex - w.ux * ey), off, sd)
