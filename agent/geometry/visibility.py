"""What is seen from where, given the walls of a map: (m, 4) x1, y1, x2, y2 in metres."""

import math

import numpy as np

from agent.geometry.clearance import crosses, walls_near
from agent.kernels import kernel
from protocol.arrays import Floats

VIEW_STEP_M = 0.3  # distance between the places on a robot's path from which its views are drawn
VIEW_RAYS = 90  # directions of a view, beside those past the ends of walls
_BESIDE_RAD = 1e-4  # rays beside a wall's end see the wall itself, and what lies behind it; 0.35 mm at 3.5 m


@kernel
def hidden_by(ax: float, ay: float, bx: float, by: float, walls: Floats) -> int:
    """Row of a wall that cuts the line of sight a-b, -1 if none does."""
    for k in range(walls.shape[0]):
        if crosses(ax, ay, bx, by, walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3]):
            return k
    return -1


@kernel
def visible_ring(x: float, y: float, walls: Floats, radius: float, rays: int) -> Floats:
    """Ring (k, 2), counter-clockwise, around what is seen from (x, y) within the radius in metres.

    Besides the given number of evenly spread rays, two go past each end of a wall in range.
    """
    near = walls_near(walls, x, y, radius) - np.array([x, y, x, y])
    m = len(near)
    angles = np.empty(rays + 4 * m)
    for k in range(rays):
        angles[k] = -math.pi + 2.0 * math.pi * k / rays
    n = rays
    for k in range(m):
        for end in range(0, 4, 2):
            if near[k, end] ** 2 + near[k, end + 1] ** 2 <= radius * radius:
                angle = math.atan2(near[k, end + 1], near[k, end])
                angles[n], angles[n + 1] = angle - _BESIDE_RAD, angle + _BESIDE_RAD
                n += 2
    angles = np.sort((angles[:n] + math.pi) % (2.0 * math.pi))
    ring = np.empty((n, 2))
    for i in range(n):
        c, s = -math.cos(angles[i]), -math.sin(angles[i])
        reach = radius
        for k in range(m):
            ax, ay, bx, by = near[k, 0], near[k, 1], near[k, 2], near[k, 3]
            dx, dy = bx - ax, by - ay
            d = c * dy - s * dx
            if d == 0.0:
                continue
            u = (ax * s - ay * c) / d
            if u < 0.0 or u > 1.0:
                continue
            r = (ax * dy - ay * dx) / d
            if 0.0 <= r < reach:
                reach = r
        ring[i, 0], ring[i, 1] = x + reach * c, y + reach * s
    return ring
