"""Bends of a map: corners that stick out, and ends, around which a way may lead (ours)."""

import math

from agent.kernels import kernel, shared_kernel
from protocol.arrays import Floats, Ints
from protocol.geometry import wrapped

_STRAIGHT_RAD = 0.05  # a corner that sticks out less bends no way
_TWO_NODES_RAD = 0.5 * math.pi + 0.1  # a way around a sharper corner bends twice, so that it stays short


@kernel
def bend(points: Floats, into: Ints, out_of: Ints, v: int) -> tuple[float, float, int]:
    """Of a vertex: direction of the wall before it, turn (radians, right < 0), and how often a way bends around it.

    points: (n, 2) metres. into, out_of: (n,) the vertex before and after, or -1. Free space is on the left of every
    edge. A chain's end, and a wall that goes back along itself, is walked around as the tip of a thin wall.
    """
    a, b = into[v], out_of[v]
    if a < 0 and b < 0:
        return 0.0, 0.0, 0
    x, y = points[v]
    turn = -math.pi
    if a >= 0:
        first = math.atan2(y - points[a, 1], x - points[a, 0])
    else:
        first = math.atan2(points[b, 1] - y, points[b, 0] - x) + math.pi
    if a >= 0 and b >= 0:
        turn = -wrapped(first - math.atan2(points[b, 1] - y, points[b, 0] - x))
        if turn > math.pi - 1e-6:
            turn = -math.pi
    if turn > -_STRAIGHT_RAD:
        return first, turn, 0
    return first, turn, 1 if turn > -_TWO_NODES_RAD else 2


@shared_kernel
def count_bends(points: Floats, into: Ints, out_of: Ints) -> int:
    """How often ways may bend around all vertices (n, 2); into, out_of: as of `bend`."""
    count = 0
    for v in range(points.shape[0]):
        count += bend(points, into, out_of, v)[2]
    return count
