"""The faces at the tips of boards, which are too thin for their two sides to be told apart at a corner (ours).

The ends of both sides lie within the reach of a corner. Were they one corner, the drawn sides would lean towards each
other: a drive among boards of 0.1 m had recall 0.80 so, and has 0.99.
"""

import numpy as np

from agent.geometry.lines import ALIKE_COSINE
from agent.mapping.edges import MIN_WALL_M
from agent.mapping.submaps.segments import SEGMENT
from protocol.arrays import Floats, Ints, Records

BACK_TO_BACK = -ALIKE_COSINE  # cosine of the turn from one side of a board to the other, at most


def with_tips(walls: Records, tips: Floats, following: Ints) -> tuple[Records, Floats, Ints]:
    """Walls (n,) with the faces at the tips of boards, each between two walls back to back whose ends are one corner.

    Sides nearer to each other than any wall is long keep that corner: between them noise drew faces of micrometres.
    tips: (n, 2, 2), of which those that share a face are moved to stand square to it. following: (n,).
    """
    directions = np.column_stack((walls["ux"], walls["uy"]))
    first = np.flatnonzero((following >= 0) & ((directions * directions[following]).sum(1) < BACK_TO_BACK))
    second, u = following[first], directions[first]
    apart = ((tips[second, 0] - tips[first, 1]) * u).sum(1)[:, None] * u
    tips = tips.copy()
    tips[first, 1] += 0.5 * apart
    tips[second, 0] -= 0.5 * apart
    across = tips[second, 0] - tips[first, 1]
    size = np.hypot(*across.T)
    wide = size >= MIN_WALL_M
    first, second, across, size = first[wide], second[wide], across[wide], size[wide]
    faces = np.zeros(len(first), SEGMENT)
    faces["ux"], faces["uy"] = (across / size[:, None]).T
    faces["x"], faces["y"] = (0.5 * (tips[second, 0] + tips[first, 1])).T
    faces["low"], faces["high"], faces["hits"] = -0.5 * size, 0.5 * size, size
    faces["seen"] = np.minimum(walls["seen"][first], walls["seen"][second])
    following = np.concatenate((following, second))
    following[first] = len(walls) + np.arange(len(first))
    ends = np.stack((tips[first, 1], tips[second, 0]), 1)
    return np.concatenate((walls, faces)), np.concatenate((tips, ends)), following
