"""Teammates among the walls: a short wall that stands alone where a teammate is, is its front (ours).

Perception leaves out beams on a teammate's disc. But a teammate that stands silent shows before it is heard, and one
behind the end of a wall shows too little for a disc.
"""

import math
from typing import NamedTuple

import numpy as np

from agent.geometry.lines import Record
from agent.kernels import kernel
from protocol.arrays import Floats, Records
from protocol.geometry import Pose


class Bodies(NamedTuple):
    """Where teammates are, for kernels; metres."""

    seen: Floats  # (d, 2) centres of a scan's discs, robot's frame
    told: Floats  # (t, 3) where merged teammates say that they are, and by how much each may be off; frame of the map
    radius: float


NO_TEAMMATES = np.zeros((0, 3))


@kernel
def is_seen_front(edges: Records, e: int, bodies: Bodies, pose: Pose, margin: float) -> bool:
    """Whether a scan from a pose shows a teammate where wall e stands. margin: m, by which both may be off.

    Of each that says where it is, the nearest disc counts: others, where nobody is known to be, may be posts.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for t in range(len(bodies.told)):
        nearest, at = bodies.told[t, 2], (0.0, 0.0)
        for k in range(len(bodies.seen)):
            x, y = bodies.seen[k]
            place = pose[0] + c * x - s * y, pose[1] + s * x + c * y
            away = math.hypot(place[0] - bodies.told[t, 0], place[1] - bodies.told[t, 1])
            if away < nearest:
                nearest, at = away, place
        if nearest < bodies.told[t, 2] and _is_front(edges, e, at[0], at[1], bodies.radius + margin):
            return True
    return False


@kernel
def put_off(pieces: Records, dice: Floats, bodies: Bodies, margin: float) -> None:
    """Let no piece (k,) become a wall where a teammate may stand, by its own words: a wall is there when it has gone.

    pieces: in the map's frame. dice: (k,) as in `merge_scan`, changed in place. margin: m, by which a piece may be off.
    """
    for t in range(len(bodies.told)):
        x, y, slack = bodies.told[t]
        reach = bodies.radius + slack + margin
        for k in range(len(pieces)):
            p = pieces[k]
            short = p.end[1] - p.end[0] <= 2.0 * (bodies.radius + margin)
            if short and math.hypot(p.x - x, p.y - y) <= reach:
                dice[k] = 1.0


@kernel
def _is_front(edges: Records, e: int, x: float, y: float, reach: float) -> bool:
    """Whether wall e, and all with which it shares a corner, are within reach of a place."""
    inside = _is_within(edges[e], x, y, reach)
    for f in edges[e].link:
        inside = inside and (f < 0 or _is_within(edges[f], x, y, reach))
    return inside


@kernel
def _is_within(wall: Record, x: float, y: float, reach: float) -> bool:
    """Whether both ends of a wall are within reach of a place, metres."""
    tail, head = wall.tip[0], wall.tip[1]
    return math.hypot(tail[0] - x, tail[1] - y) <= reach and math.hypot(head[0] - x, head[1] - y) <= reach
