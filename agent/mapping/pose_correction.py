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
from agent.mapping.edges import line_sd, spread, tip_at
from protocol.arrays import Floats, Ints, Records
from protocol.geometry import Pose, wrapped

AXIS_SD = math.radians(0.5)  # of rectilinear walls about their axis; outer walls of eight real layouts: 0.3 degrees
HEADING_TRUST = 0.95  # agreement of the walls' directions above which their axis holds the heading
MAX_OFF_AXIS = 0.2  # rad, a piece that is more oblique belongs to no wall on the axis
WALL_FLOOR = math.radians(0.2)  # least sd of a wall's direction, beside its covariance: walls are not straight
MIN_VIEWS = 2.0  # views that must have confirmed an end before it holds the robot
ROUNDS = 3  # Gauss-Newton steps: weights and directions depend on the pose, which is near to the prediction


class Axis(NamedTuple):
    """Common axis of rectilinear walls."""

    angle: float  # rad, modulo a right angle
    sd: float  # rad, how well walls keep it; inf where they are not rectilinear


@kernel
def motion_covariance(covariance: Floats, pose: Pose, by: Pose, noise: Floats) -> Floats:
    """(3, 3) covariance of `compose(pose, by)`. noise: sd in m per sqrt(m), rad per sqrt(m), rad per sqrt(rad)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = c * by[0] - s * by[1], s * by[0] + c * by[1]
    out = covariance.copy()
    # the heading's error swings the step: J C J' with J = 1 + (-dy, dx)' on the heading's column
    out[0] -= dy * covariance[2]
    out[1] += dx * covariance[2]
    for i in range(3):
        out[i, 0] -= dy * out[i, 2]
        out[i, 1] += dx * out[i, 2]
    distance = math.hypot(dx, dy)
    if distance > 1e-9:
        ux, uy = dx / distance, dy / distance
        v = noise[0] ** 2 * distance
        out[0, 0] += v * ux * ux
        out[0, 1] += v * ux * uy
        out[1, 0] += v * ux * uy
        out[1, 1] += v * uy * uy
    out[2, 2] += noise[1] ** 2 * distance + noise[2] ** 2 * abs(by[2])
    return out


@kernel
def _add_residual(h: Floats, g: Floats, jx: float, jy: float, jt: float, off: float, sd: float) -> None:
    """Add one residual with Cauchy weight to the normal equations."""
    w = 1.0 / (sd * sd * (1.0 + (off / (2.0 * sd)) ** 2))
    j = (jx, jy, jt)
    for row in range(3):
        g[row] -= w * j[row] * off
        for column in range(row, 3):
            h[row, column] += w * j[row] * j[column]


@kernel
def correct_pose(
    edges: Records, pieces: Records, walls: Ints, predicted: Pose, covariance: Floats, axis: Axis, noise: float
) -> tuple[Pose, Floats]:
    """Pose and its (3, 3) covariance from pieces (robot's frame), each associated with a wall or -1.

    predicted, covariance: by odometry. noise: m, standard deviation of a range.
    """
    prior, pose = inverse(covariance), predicted
    h = prior
    for _ in range(ROUNDS):
        h = prior.copy()
        moved = (pose[0] - predicted[0], pose[1] - predicted[1], wrapped(pose[2] - predicted[2]))
        g = -times(prior, np.array(moved))
        for k in range(len(pieces)):
            p = pieces[k]
            off = wrapped(math.atan2(p.uy, p.ux) + pose[2] - axis.angle, 0.5 * math.pi)
            if math.isfinite(axis.sd) and abs(off) < MAX_OFF_AXIS:
                _add_residual(h, g, 0.0, 0.0, 1.0, off, math.hypot(noise / math.sqrt(p.spread), axis.sd))
            if walls[k] >= 0:
                _add_wall(h, g, p, edges[walls[k]], pose, noise)
        h[1, 0], h[2, 0], h[2, 1] = h[0, 1], h[0, 2], h[1, 2]
        step = times(inverse(h), g)
        pose = (pose[0] + step[0], pose[1] + step[1], pose[2] + step[2])
    return (pose[0], pose[1], wrapped(pose[2])), inverse(h)


@kernel
def _add_wall(h: Floats, g: Floats, p: Record, w: Record, pose: Pose, noise: float) -> None:
    """Add the residuals of a piece to its wall: distance, direction, and ends, which hold the robot in a corridor."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    rx, ry = c * p.x - s * p.y, s * p.x + c * p.y
    x, y = pose[0] + rx, pose[1] + ry
    t = along(w, x, y)
    sd = math.hypot(noise / math.sqrt(p.hits), math.hypot(line_sd(w, t, noise), NOISE_FLOOR_M))
    _add_residual(h, g, -w.uy, w.ux, w.uy * ry + w.ux * rx, above(w, x, y), sd)
    turn = wrapped(math.atan2(p.uy, p.ux) + pose[2] - math.atan2(w.uy, w.ux))
    sd = math.hypot(noise / math.sqrt(p.spread), math.hypot(noise / math.sqrt(spread(w)), WALL_FLOOR))
    _add_residual(h, g, 0.0, 0.0, 1.0, turn, sd)
    for side in range(2):
        if p.label[side] != OCCLUSION or w.label[side] not in (NOMINAL, OCCLUSION) or w.strength[side] < MIN_VIEWS:
            continue
        outward = 1.0 if side == 1 else -1.0
        slack = 0.5 * (p.slack[side] + w.slack[side])
        off = t + p.end[side] - tip_at(w, side) + outward * 0.5 * (p.slack[side] - w.slack[side])
        ex, ey = rx + p.end[side] * w.ux, ry + p.end[side] * w.uy
        sd = math.hypot(slack / math.sqrt(3.0), NOISE_FLOOR_M + noise)
        _add_residual(h, g, w.ux, w.uy, w.uy * ex - w.ux * ey, off, sd)
