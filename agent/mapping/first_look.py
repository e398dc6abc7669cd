"""What a robot sees before it first moves becomes walls as it leaves (ours).

Its pose is exact there, so these walls alone say how its frame lies. In a hall they are far faces that a few noisy
beams each have met, and are tentative still after ten seconds. A tentative wall is forgotten once it is out of reach,
and the heading of the frame with it.
"""

from agent.corner_scan import FRONTIER
from agent.kernels import kernel
from agent.mapping.edges import TENTATIVE, WALL, set_end
from agent.mapping.tentative import is_steady
from protocol.arrays import Ints, Records

LEAST_SCANS = 10.0  # scans that must have hit a wall of the first look: mixed readings at edges show in one or two


@kernel
def keep_first_look(edges: Records, counts: Ints, noise: float) -> None:
    """Let tentative walls that were seen steadily be walls of every particle: edges (p, e), counts (p,).

    The joint estimate knows them already (`joint.know_walls`). They end as far as they were seen; nearer views will
    tell where. noise: m, standard deviation of a range.
    """
    for p in range(len(counts)):
        for e in range(counts[p]):
            w = edges[p, e]
            if w.alive != TENTATIVE or w.seen < LEAST_SCANS or not is_steady(w, noise):
                continue
            w.alive, w.own, w.misses, w.through = WALL, 1, 0.0, 0.0
            for side in range(2):
                set_end(w, side, FRONTIER, 0.0, 0.0)
