"""How exact a map is in its frame, by what the joint estimate knows of its walls (ours)."""

import math

from agent.kernels import kernel
from agent.mapping.edges import is_published
from agent.mapping.joint import has_rows, row_of
from protocol.arrays import Floats, Records


@kernel
def map_sd_m(walls: Records, joint: Floats) -> float:
    """Root mean square of how far walls (n,) of a particle may be off across their lines, metres, in the map's frame.

    joint: (m, m) the particle's covariance. 0 where it knows of no error.
    """
    total, number = 0.0, 0
    for e in range(min(len(walls), has_rows(joint))):
        if is_published(walls[e]):
            total += joint[row_of(e), row_of(e)]
            number += 1
    return math.sqrt(total / number) if number else 0.0
