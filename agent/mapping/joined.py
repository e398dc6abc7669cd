"""Walls that turn out to be parts of one: what was known of each line is known of all (ours).

Behind a post or a column a long wall shows in parts, each of a direction known to a tenth to a third of a degree. Their
places are known to millimetres, metres apart, so together they tell the direction several times better. That is most of
what a first look tells of how the frame lies, and it was lost when parts were joined and only one kept its rows.
"""

import math

import numpy as np

from agent.corner_scan import NOISE_FLOOR_M
from agent.geometry.lines import above, along
from agent.kernels import kernel
from agent.mapping.edges import FREE, WALL, related
from agent.mapping.ends import f_ends_both
from agent.mapping.joint import PER_WALL, forget, has_rows, row_of
from agent.mapping.kalman import observe
from protocol.arrays import Floats, Records


@kernel
def hold_joined(edges: Records, before: Records, joint: Floats, shift: Floats) -> bool:
    """Let walls that a scan has joined into others lie on their lines: joint (m, m) and shift (m,) in place.

    before: (k,) the walls before the scan was merged. Returns whether there are any. The directions of parts, known so
    much worse than their places tell, are left out. What was known of an end that lies within the joint wall goes.
    """
    rows, slopes, found = np.zeros(3, np.int64), np.array((1.0, -1.0, 0.0)), False
    known = min(len(before), has_rows(joint))
    for f in range(known):
        e = edges[f].twin - 1
        if edges[f].kind != FREE or before[f].kind != WALL or e < 0 or e >= known:
            continue
        for side in range(2):
            if f_ends_both(before, e, f, side):
                forget(joint, row_of(e) + 2 + side)
        part, wall = before[f], before[e]
        if not (related(part) and related(wall) and joint[row_of(f), row_of(f)] > 0.0):
            continue
        t = along(wall, part.x, part.y)
        rows[0], rows[1], rows[2], slopes[2] = row_of(f), row_of(e), row_of(e) + 1, -t
        observe(joint, shift, rows, slopes, -above(wall, part.x, part.y), NOISE_FLOOR_M**2, math.inf)
        found = True
    for f in range(known):  # when all are told: a part may itself be what another was joined into
        if edges[f].kind == FREE:
            shift[row_of(f) : row_of(f) + PER_WALL] = 0.0
    return found
