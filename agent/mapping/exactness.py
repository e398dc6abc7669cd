"""How exact a map is in its frame, by what the joint estimate knows of its walls (ours)."""

import math

import numpy as np

from agent.mapping.edges import is_published
from agent.mapping.joint import has_rows, row_of
from protocol.arrays import Floats, Records


def map_sd_m(walls: Records, joint: Floats) -> float:
    """Root mean square of how far walls (n,) of a particle may be off across their lines, metres, in the map's frame.

    joint: (m, m) the particle's covariance. 0 where it knows of no error.
    """
    rows = [row_of(e) for e in range(min(len(walls), has_rows(joint))) if is_published(walls[e])]
    return math.sqrt(float(np.mean(joint.diagonal()[rows]))) if rows else 0.0
