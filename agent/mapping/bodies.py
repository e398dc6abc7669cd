"""Teammates among the walls: a short wall that stands alone where a teammate is, is its front (ours).

Perception leaves out beams on a teammate's disc. But a teammate that stands silent shows before it is heard, and one
behind the end of a wall shows too little for a disc.
"""

import math
from typing import NamedTuple

import numpy as np

from agent.geometry.lines import Record
from agent.kernels import kernel
from agent.mapping.scan_merge import NEVER
from protocol.arrays import Floats, Records
from protocol.geometry import Pose


class Bodies(NamedTuple):
    """Where teammates are, for kernels; metres."""

    seen: Floats  # (d, 2) centres of a scan's discs, robot's frame
    told: Floats  # (t, 3) where merged teammates say that they are, and by how much each may be off; frame of the map
    radius: float


NO_TEAMMATES = np.zeros((0, 3))


@kernel
def seen_teammates(bodies: Bodies, pose: Pose) -> Floats:
    """Centres (n, 2) of those discs of a scan from a pose that are teammates, in the map's frame.

    Of each that says where it is, the nearest disc counts: others, where nobody is known to be, may be posts.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    found, n = np.empty((len(bodies.told), 2)), 0
    for x, y, slack in bodies.told:
        nearest = slack
        for k in range(len(bodies.seen)):
            at_x = pose[0] + c * bodies.seen[k, 0] - s * bodies.seen[k, 1]
            at_y = pose[1] + s * bodies.seen[k, 0] + c * bodies.seen[k, 1]
            away = math.hypot(at_x - x, at_y - y)
            if away < nearest:
                nearest = away
                found[n, 0], found[n, 1] = at_x, at_y
        if nearest < slack:
            n += 1
    return found[:n]


@kernel
def is_front(edges: Records, e: int, teammates: Floats, reach: float) -> bool:
    """Whether wall e, and all with which it shares a corner, are within reach, metres, of one of (n, 2) teammates."""
    for k in range(len(teammates)):
        x, y = teammates[k]
        inside = _is_within(edges[e], x, y, reach)
        for f in edges[e].link:
            inside = inside and (f < 0 or _is_within(edges[f], x, y, reach))
        if inside:
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
                dice[k] = NEVER


@kernel
def _is_within(wall: Record, x: float, y: float, reach: float) -> bool:
    """Whether both ends of a wall are within reach of a place, metres."""
    tail, head = wall.tip[0], wall.tip[1]
    return math.hypot(tail[0] - x, tail[1] - y) <= reach and math.hypot(head[0] - x, head[1] - y) <= reach
