"""How large a peer's map may be: nobody's word weighs much more than what the robot has seen itself (ours).

Planning takes time with the walls of a map, and with the square of its bends, the places that a way may lead around:
each pair of them is looked at, past all walls. An honest map has few bends, as no way bends at the inner corners of
rooms; one that is strewn with short walls has four to a wall. So a robot that comes late takes the map of a whole
building at once, and a hostile one waits. In a crowd every map holds those of many: it may weigh as much beyond what
another merged peer has told, too.
"""

import numpy as np

from protocol.walls import neighbours
from protocol.wireframe import Wireframe

STRANGE_WALLS, STRANGE_BENDS = 70, 280
"""What a map may weigh beyond the own one: as much as so many short walls, strewn about, with four bends each. They
make a robot's steps take 1.7 times as long as else (measured)."""
COMPARED_WALLS = 500
"""Walls that it may have more in any case, as aligning two maps takes time with their square: 14 ms at 500, 50 ms at
1000."""


def is_too_large(theirs: Wireframe, own: Wireframe) -> bool:
    """Whether a map weighs too much for a robot that has mapped so much itself."""
    walls, own_walls = len(theirs.edges), len(own.edges)
    budget = (own_walls + STRANGE_WALLS) * (bends(own) + STRANGE_BENDS) ** 2
    return walls > own_walls + COMPARED_WALLS or walls * bends(theirs) ** 2 > budget


def bends(wireframe: Wireframe) -> int:
    """Places that a way may lead around: one at each corner that sticks out, two at each end of a wall."""
    into, out_of = (np.asarray(one) for one in neighbours(wireframe.edges, len(wireframe.points)))
    inner = (into >= 0) & (out_of >= 0)
    ends = (into >= 0) ^ (out_of >= 0)
    to, on = wireframe.points - wireframe.points[into], wireframe.points[out_of] - wireframe.points
    out = inner & (to[:, 0] * on[:, 1] - to[:, 1] * on[:, 0] < 0)  # free space is on the left: it bends to the right
    return int(out.sum() + 2 * ends.sum())
