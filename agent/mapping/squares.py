"""Short walls stand square to longer ones that they share corners with, as far as their direction is unsure (ours).

Of the beams at a corner some count for the wrong wall. On a face of 11 cm they turn the fitted line by up to 17
degrees, however many scans have seen it, while the hits' scatter promises one degree. Nearly all walls are square.
"""

import math

import numpy as np

from agent.geometry.lines import Record
from agent.kernels import kernel
from agent.mapping.edges import WALL, length, settle_corner
from protocol.arrays import Ints, Records

MISTAKEN = 18.0
"""The hits within 3 standard deviations of a range from both corners of a wall lie beside its line by one standard
deviation s, for all that is known. They turn a wall of length l by 18 (s / l)^2 rad: 8 degrees at 11 cm, 0.1 at 1 m."""
SQUARE_SD = math.radians(1.0)  # by which neighbouring walls of a building miss being square
GATE_SIGMAS = 3.0
OBLIQUE = math.radians(20.0)  # a wall that is farther from square is oblique, however short


@kernel
def square_short_walls(edges: Records, shown: Ints, noise: float) -> None:
    """Turn short walls about their hits' centroids towards square to their neighbours, and move corners along.

    shown: (n,) not negative for walls that are published. noise: m, standard deviation of a range.
    """
    turns = np.zeros(len(edges))
    for e in range(len(edges)):
        if edges[e].kind == WALL and shown[e] >= 0:
            turns[e] = _turn(edges, shown, e, noise)
    for e in range(len(edges)):
        if turns[e] != 0.0:
            w, c, s = edges[e], math.cos(turns[e]), math.sin(turns[e])
            w.ux, w.uy = c * w.ux - s * w.uy, s * w.ux + c * w.uy
            _turn_tips(w, c, s)
    for e in range(len(edges)):
        f = edges[e].link[1]
        if edges[e].kind == WALL and f >= 0 and (turns[e] != 0.0 or turns[f] != 0.0):
            settle_corner(edges, e)


@kernel
def _turn(edges: Records, shown: Ints, e: int, noise: float) -> float:
    """By how much to turn wall e, rad: the mean of what it and its neighbours say, by their precision."""
    own = _direction_sd(edges[e], noise)
    total, weight = 0.0, 1.0 / own**2
    for side in range(2):
        f = edges[e].link[side]
        if f < 0 or shown[f] < 0:
            continue
        sd = math.hypot(_direction_sd(edges[f], noise), SQUARE_SD)
        off = _off_square(edges[e], edges[f])
        if abs(off) < min(GATE_SIGMAS * math.hypot(own, sd), OBLIQUE):
            total += off / sd**2
            weight += 1.0 / sd**2
    return total / weight


@kernel
def _direction_sd(e: Record, noise: float) -> float:
    """Standard deviation of a wall's direction by the beams that its corners mislead, rad."""
    return MISTAKEN * (noise / max(length(e), noise)) ** 2


@kernel
def _off_square(e: Record, f: Record) -> float:
    """Least turn that makes wall e square to wall f, rad. Parallel to it, it could share no corner with it."""
    angle = math.atan2(e.ux * f.uy - e.uy * f.ux, e.ux * f.ux + e.uy * f.uy)
    return angle - math.copysign(0.5 * math.pi, angle)


@kernel
def _turn_tips(w: Record, c: float, s: float) -> None:
    """Turn the ends of a wall about its centroid."""
    for side in range(2):
        x, y = w.tip[side, 0] - w.x, w.tip[side, 1] - w.y
        w.tip[side, 0], w.tip[side, 1] = w.x + c * x - s * y, w.y + s * x + c * y
