"""Rigid transforms of the plane as rows x, y, theta: metres, radians, counter-clockwise.

A transform is the pose of one frame in another, so it takes points of the first into the second. No scale, no mirror.
"""

import math

import numpy as np

from agent.kernels import shared_kernel
from protocol.arrays import Floats
from protocol.geometry import wrapped

DISTINCT_M = 0.5  # transforms farther apart at the map's centre contradict: twice the least error that counts as wrong
DISTINCT_RAD = math.radians(10.0)  # the same for their turn


def compose(a: Floats, b: Floats) -> Floats:
    """First b, then a: (..., 3) each, broadcast against each other."""
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    out = np.empty((*x.shape, 3))  # numpy is slow to stack so little
    out[..., 0], out[..., 1] = x, a[..., 1] + s * b[..., 0] + c * b[..., 1]
    out[..., 2] = wrapped(a[..., 2] + b[..., 2])
    return out


def inverse(a: Floats) -> Floats:
    """The way back of (..., 3)."""
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    return np.stack([-c * a[..., 0] - s * a[..., 1], s * a[..., 0] - c * a[..., 1], wrapped(-a[..., 2])], -1)


@shared_kernel
def move(t: Floats, x: float, y: float) -> tuple[float, float]:
    """One point moved by one transform (3,)."""
    c, s = math.cos(t[2]), math.sin(t[2])
    return t[0] + c * x - s * y, t[1] + s * x + c * y


@shared_kernel
def apart(a: Floats, b: Floats, centre: Floats, limit_m: float, limit_rad: float) -> bool:
    """Whether two transforms (3,) differ by more than the limits, metres and rad, at the map's centre (2,).

    At the origin of the map's frame a turn could look like a shift, as the map may lie far from it.
    """
    if abs(wrapped(a[2] - b[2])) > limit_rad:
        return True
    ax, ay = move(a, centre[0], centre[1])
    bx, by = move(b, centre[0], centre[1])
    return (ax - bx) ** 2 + (ay - by) ** 2 > limit_m**2


@shared_kernel
def fit_on_points(source: Floats, target: Floats, count: int) -> Floats:
    """Least-squares transform (3,) of the first `count` source points (n, 2) onto the targets (n, 2); count >= 1."""
    sx, sy = source[:count, 0].mean(), source[:count, 1].mean()
    tx, ty = target[:count, 0].mean(), target[:count, 1].mean()
    cosine = sine = 0.0
    for k in range(count):
        ax, ay = source[k, 0] - sx, source[k, 1] - sy
        bx, by = target[k, 0] - tx, target[k, 1] - ty
        cosine += ax * bx + ay * by
        sine += ax * by - ay * bx
    theta = math.atan2(sine, cosine)
    c, s = math.cos(theta), math.sin(theta)
    return np.array([tx - c * sx + s * sy, ty - s * sx - c * sy, theta])
