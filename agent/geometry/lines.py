"""Where a point lies by a straight line, and where two lines meet.

A line is any record with a point x, y on it, its centroid, and a unit direction ux, uy: a piece of a scan or a wall.
"""

import math
from typing import Any

from agent.kernels import kernel
from protocol.arrays import Floats
from protocol.geometry import Pose

Record = Any  # one element of a record array inside a kernel; numba reads its fields like attributes

MIN_CORNER_SINE = math.sin(math.radians(20.0))
"""Sine of the angle between two lines below which they form no corner: their intersection is too uncertain."""
ALIKE_COSINE = math.cos(math.radians(20.0))
"""Cosine of the same angle: walls of which one is turned by less against the other may be one, and others are two."""


@kernel
def along(line: Record, x: float, y: float) -> float:
    """Coordinate of a point along the line, metres from its centroid."""
    return (x - line.x) * line.ux + (y - line.y) * line.uy


@kernel
def above(line: Record, x: float, y: float) -> float:
    """Distance of a point from the line in metres, positive on its left, which is a wall's free side."""
    return (y - line.y) * line.ux - (x - line.x) * line.uy


@kernel
def placed(
    x: float, y: float, ux: float, uy: float, pose: Pose | Floats, c: float, s: float
) -> tuple[float, float, float, float]:
    """A point and a direction of a pose's frame, moved to where the pose lies. c, s: cosine and sine of its angle."""
    return pose[0] + c * x - s * y, pose[1] + s * x + c * y, c * ux - s * uy, s * ux + c * uy


@kernel
def pool(line: Record, hits: float, x: float, y: float, moments: tuple[float, float, float]) -> None:
    """Fit a line to more points: their number, their centroid, and their moments xx, xy, yy about it, m2, are added.

    The line is a record with `hits` and such moments of its own. Its direction turns by less than a right angle.
    """
    total, dx, dy = line.hits + hits, x - line.x, y - line.y
    w = line.hits * hits / total
    line.xx += moments[0] + w * dx * dx
    line.xy += moments[1] + w * dx * dy
    line.yy += moments[2] + w * dy * dy
    line.x += dx * hits / total
    line.y += dy * hits / total
    line.hits = total
    angle = 0.5 * math.atan2(2 * line.xy, line.xx - line.yy)
    ux, uy = math.cos(angle), math.sin(angle)
    if ux * line.ux + uy * line.uy < 0:
        ux, uy = -ux, -uy
    line.ux, line.uy = ux, uy


@kernel
def meet(a: Record, b: Record) -> tuple[float, float]:
    """Sine of the turn from a to b, and where they meet, metres along a from its centroid; 0, 0 where parallel."""
    sine = a.ux * b.uy - a.uy * b.ux
    if abs(sine) < 1e-6:
        return 0.0, 0.0
    return sine, ((b.x - a.x) * b.uy - (b.y - a.y) * b.ux) / sine
