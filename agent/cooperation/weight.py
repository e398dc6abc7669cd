"""How large a peer's map may be: nobody's word weighs much more than what the robot has seen itself (ours).

Planning takes time with the walls of a map, and with the square of its bends, the places that a way may lead around:
each pair of them is looked at, past all walls. An honest map has few bends, as no way bends at the inner corners of
rooms; one that is strewn with short walls has four to a wall. So a robot that comes late takes the map of a whole
building at once, and a hostile one waits. In a crowd every map holds those of many: it may weigh as much beyond what
another merged peer has told, too.

What counts is the map as it would be laid: its walls whole. Cut into what its sender saw and what that heard, the map
of a building of 40 m has 408 bends instead of 304, and latecomers drove through all of it by themselves.
"""

from typing import NamedTuple

import numpy as np

from agent.geometry.bends import count_bends
from agent.mapping.uncut import uncut
from protocol.walls import neighbours
from protocol.wireframe import Wireframe

STRANGE_WALLS, STRANGE_BENDS = 70, 280
"""What a map may weigh beyond the own one: as much as so many short walls, strewn about, with four bends each. They
make a robot's steps take 1.7 times as long as else (measured)."""
COMPARED_WALLS = 500
"""Walls that it may have more in any case, as aligning two maps takes time with their square: 14 ms at 500, 50 ms at
1000."""


class Weight(NamedTuple):
    """What planning takes time with."""

    walls: int
    bends: int


NO_WEIGHT = Weight(0, 0)


def weigh(wireframe: Wireframe) -> Weight:
    """What a map weighs as it is laid."""
    edges, _ = uncut(wireframe.points, wireframe.labels, wireframe.edges.astype(np.int64), wireframe.own)
    into, out_of = neighbours(edges, len(wireframe.points))
    return Weight(len(edges), count_bends(wireframe.points, into, out_of))


def is_too_large(theirs: Weight, own: Weight) -> bool:
    """Whether a map weighs too much for a robot that has mapped so much itself."""
    budget = (own.walls + STRANGE_WALLS) * (own.bends + STRANGE_BENDS) ** 2
    return theirs.walls > own.walls + COMPARED_WALLS or theirs.walls * theirs.bends**2 > budget
