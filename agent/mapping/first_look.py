"""What a robot sees before it first moves becomes walls as it leaves (ours).

Its pose is exact there, so these walls alone say how its frame lies. In a hall they are far faces by a few noisy beams
each: after ten seconds their directions tell the frame's to a degree, their places to 0.04 degrees. Left tentative they
held no robot: its wheels turned it by up to 13 degrees before it knew a wall, and its map stayed turned in its frame.
"""

from agent.corner_scan import FRONTIER
from agent.kernels import kernel
from agent.mapping.edges import TENTATIVE, WALL, set_end
from agent.mapping.joint import know_walls
from agent.mapping.tentative import main_axis, wall_probability
from protocol.arrays import Floats, Ints, Records

LEAST_SCANS = 10.0  # scans that must have hit a wall of the first look: mixed readings at edges show in one or two
STANDS = 1e-3  # m and rad by which the odometry of a robot that has not moved differs from zero at most


def stands(odometry: Floats) -> bool:
    """Whether a robot is where its frame begins, by odometry since then."""
    return all(abs(part) < STANDS for part in odometry)


@kernel
def keep_first_look(edges: Records, counts: Ints, poses: Floats, joint: Floats, noise: float) -> None:
    """Let tentative walls that were seen steadily be walls of every particle, with rows in its joint covariance.

    edges (p, e), counts (p,), poses (p, 3), joint (p, m, m), as in `update_particles`. They end as far as they were
    seen; what ends them nearer views will tell. noise: m, standard deviation of a range.
    """
    for p in range(len(counts)):
        axis, trust = main_axis(edges[p], counts[p])
        for e in range(counts[p]):
            w = edges[p, e]
            if w.alive != TENTATIVE or w.seen < LEAST_SCANS or wall_probability(w, axis, trust, noise) == 0.0:
                continue
            w.alive, w.own, w.misses, w.through = WALL, 1, 0.0, 0.0
            for side in range(2):
                set_end(w, side, FRONTIER, 0.0, 0.0)
        know_walls(edges[p], counts[p], joint[p], (poses[p, 0], poses[p, 1], poses[p, 2]), noise)
