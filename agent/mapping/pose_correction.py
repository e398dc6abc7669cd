"""Where the robot is, from the shift between a scan and the map (paper III, technique of its ref. 1; ours in detail).

Robust least squares on walls and their ends with the odometry as prior. Where walls are rectilinear, their common
axis holds the heading; where they are not, only the walls themselves do.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agent.geometry.matrix3 import inverse, times
from agent.kernels import kernel
from agent.mapping.association import Gates
from agent.mapping.edges import NOMINAL, OCCLUSION, Edges, along, line_sd, spread, tip_at
from protocol.arrays import Floats
from protocol.geometry import Pose, wrapped


@kernel
def motion_covariance(covariance: Floats, pose: Pose, by: Pose, noise: Floats) -> Floats:
    """(3, 3) covariance of `compose(pose, by)`. noise: sd in m per sqrt(m), rad per sqrt(m), rad per sqrt(rad)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = c * by[0] - s * by[1], s * by[0] + c * by[1]
    out = covariance.copy()
    # the heading's error swings the step: J C J' with J = 1 + (-dy, dx)' on the heading's column
    for i in range(3):
        out[0, i] -= dy * covariance[2, i]
        out[1, i] += dx * covariance[2, i]
    for i in range(3):
        column = out[i, 2]
        out[i, 0] -= dy * column
        out[i, 1] += dx * column
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
def _count(h: Floats, g: Floats, jx: float, jy: float, jt: float, off: float, sd: float) -> None:
    """Add one residual with Cauchy weight to the normal equations."""
    w = 1.0 / (sd * sd * (1.0 + (off / (2.0 * sd)) ** 2))
    h[0, 0] += w * jx * jx
    h[0, 1] += w * jx * jy
    h[0, 2] += w * jx * jt
    h[1, 1] += w * jy * jy
    h[1, 2] += w * jy * jt
    h[2, 2] += w * jt * jt
    g[0] -= w * jx * off
    g[1] -= w * jy * off
    g[2] -= w * jt * off


@kernel
def correct_pose(
    edges: Edges,
    raw: NDArray[np.void],
    walls: NDArray[np.int64],
    predicted: Pose,
    covariance: Floats,
    axis: float,
    axis_sd: float,
    floor_m: float,
    floor_rad: float,
    gates: Gates,
) -> tuple[Pose, Floats]:
    """Pose and its (3, 3) covariance from pieces (robot's frame), each associated with a wall or -1.

    axis, axis_sd: rad, common axis of the walls and how well they keep it; inf where they are not rectilinear.
    floor_m, floor_rad: what walls themselves are good for.
    """
    prior = inverse(covariance)
    pose = predicted
    h = prior.copy()
    for _ in range(3):
        h = prior.copy()
        d0, d1 = pose[0] - predicted[0], pose[1] - predicted[1]
        d2 = wrapped(pose[2] - predicted[2])
        g = -times(prior, np.array([d0, d1, d2]))
        c, s = math.cos(pose[2]), math.sin(pose[2])
        for k in range(len(raw)):
            p, e = raw[k], walls[k]
            direction = math.atan2(p.uy, p.ux) + pose[2]
            direction_sd = gates.noise / math.sqrt(p.spread)
            if math.isfinite(axis_sd):
                off = wrapped(direction - axis, 0.5 * math.pi)
                if abs(off) < 0.2:
                    _count(h, g, 0.0, 0.0, 1.0, off, math.hypot(direction_sd, axis_sd))
            if e < 0:
                continue
            w = edges[e]
            rx, ry = c * p.x - s * p.y, s * p.x + c * p.y
            x, y = pose[0] + rx, pose[1] + ry
            t = along(w, x, y)
            off = (y - w.y) * w.ux - (x - w.x) * w.uy
            sd = math.hypot(gates.noise / math.sqrt(p.hits), math.hypot(line_sd(w, t, gates.noise), floor_m))
            _count(h, g, -w.uy, w.ux, w.uy * ry + w.ux * rx, off, sd)
            turn = wrapped(direction - math.atan2(w.uy, w.ux))
            sd = math.hypot(direction_sd, math.hypot(gates.noise / math.sqrt(spread(w)), floor_rad))
            _count(h, g, 0.0, 0.0, 1.0, turn, sd)
            for side in range(2):  # ends hold the robot along a corridor
                if p.label[side] != OCCLUSION or w.label[side] not in (NOMINAL, OCCLUSION) or w.strength[side] < 2.0:
                    continue
                out = 1.0 if side == 1 else -1.0
                slack = 0.5 * (p.slack[side] + w.slack[side])
                off = t + p.end[side] - tip_at(w, side) + out * 0.5 * (p.slack[side] - w.slack[side])
                ex, ey = rx + p.end[side] * w.ux, ry + p.end[side] * w.uy
                sd = math.hypot(slack / math.sqrt(3.0), floor_m + gates.noise)
                _count(h, g, w.ux, w.uy, w.uy * ex - w.ux * ey, off, sd)
        h[1, 0], h[2, 0], h[2, 1] = h[0, 1], h[0, 2], h[1, 2]
        step = times(inverse(h), g)
        pose = (pose[0] + step[0], pose[1] + step[1], pose[2] + step[2])
    return (pose[0], pose[1], wrapped(pose[2])), inverse(h)
