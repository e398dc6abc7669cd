"""How far a point or a straight motion stays from walls. Walls are (m, 4) x1, y1, x2, y2 in metres."""

import math

import numpy as np

from agent.kernels import kernel, shared_kernel
from protocol.arrays import Floats


@kernel
def to_wall2(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Squared distance of a point to the segment a-b."""
    dx, dy = bx - ax, by - ay
    length2 = dx * dx + dy * dy
    t = 0.0
    if length2 > 0.0:
        t = min(1.0, max(0.0, ((px - ax) * dx + (py - ay) * dy) / length2))
    ex, ey = ax + t * dx - px, ay + t * dy - py
    return ex * ex + ey * ey


@shared_kernel
def distance_to_walls(x: float, y: float, walls: Floats) -> float:
    """Distance in metres of the point to the nearest wall; inf without walls."""
    best = math.inf
    for k in range(walls.shape[0]):
        best = min(best, to_wall2(x, y, walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3]))
    return math.sqrt(best)


@kernel
def distances_to_walls(points: Floats, walls: Floats) -> Floats:
    """Distance (n,) in metres of each of points (n, 2) to the nearest wall."""
    out = np.empty(points.shape[0])
    for k in range(points.shape[0]):
        out[k] = distance_to_walls(points[k, 0], points[k, 1], walls)
    return out


@kernel
def crosses(ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float) -> bool:
    """Whether the segments a-b and c-d meet; parallel ones do not."""
    rx, ry, sx, sy = bx - ax, by - ay, dx - cx, dy - cy
    d = rx * sy - ry * sx
    if d == 0.0:
        return False
    t, u = (cx - ax) * sy - (cy - ay) * sx, (cx - ax) * ry - (cy - ay) * rx  # times d, as division is slow
    return 0.0 <= t <= d and 0.0 <= u <= d if d > 0.0 else d <= t <= 0.0 and d <= u <= 0.0


@kernel
def bars(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float, clearance: float
) -> bool:
    """Whether the wall c-d is nearer than the clearance (metres) to the motion a-b."""
    left, right = min(ax, bx) - clearance, max(ax, bx) + clearance
    low, high = min(ay, by) - clearance, max(ay, by) + clearance
    if (cx < left and dx < left) or (cx > right and dx > right):
        return False
    if (cy < low and dy < low) or (cy > high and dy > high):
        return False
    along_x, along_y, limit2 = bx - ax, by - ay, clearance * clearance
    beyond2 = 1.000001 * limit2 * (along_x * along_x + along_y * along_y)
    # the wall lies on one side of the motion's line, beyond the clearance
    first, second = (cx - ax) * along_y - (cy - ay) * along_x, (dx - ax) * along_y - (dy - ay) * along_x
    if (first > 0.0) == (second > 0.0) and min(first * first, second * second) > beyond2:
        return False
    return bool(
        crosses(ax, ay, bx, by, cx, cy, dx, dy)
        or to_wall2(cx, cy, ax, ay, bx, by) < limit2
        or to_wall2(dx, dy, ax, ay, bx, by) < limit2
        or to_wall2(ax, ay, cx, cy, dx, dy) < limit2
        or to_wall2(bx, by, cx, cy, dx, dy) < limit2
    )


@shared_kernel
def keeps_clear(ax: float, ay: float, bx: float, by: float, walls: Floats, clearance: float) -> bool:
    """Whether the motion a-b stays at least the clearance (metres) away from every wall."""
    for k in range(walls.shape[0]):
        if bars(ax, ay, bx, by, walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3], clearance):
            return False
    return True


@kernel
def path_clear(path: Floats, walls: Floats, clearance: float) -> bool:
    """Whether the polyline (k, 2) stays at least the clearance (metres) away from every wall."""
    for k in range(path.shape[0] - 1):
        if not keeps_clear(path[k, 0], path[k, 1], path[k + 1, 0], path[k + 1, 1], walls, clearance):
            return False
    return True


@shared_kernel
def walls_near(walls: Floats, x: float, y: float, reach: float) -> Floats:
    """Those of walls (m, 4) whose bounding boxes meet the square around (x, y), reach metres to each side."""
    near, m = np.empty(walls.shape), 0
    for k in range(walls.shape[0]):
        if (
            min(walls[k, 0], walls[k, 2]) < x + reach
            and max(walls[k, 0], walls[k, 2]) > x - reach
            and min(walls[k, 1], walls[k, 3]) < y + reach
            and max(walls[k, 1], walls[k, 3]) > y - reach
        ):
            near[m] = walls[k]
            m += 1
    return near[:m]
