"""What a robot sees before it first moves becomes walls as it leaves (ours).

Its pose is exact there, so these walls alone say how its frame lies. In a hall they are far faces that a few noisy
beams each have met, and are tentative still after ten seconds. A tentative wall is forgotten once it is out of reach,
and the heading of the frame with it.
"""

import math

import numpy as np

from agent.corner_scan import FRONTIER, NOISE_FLOOR_M, NOMINAL, OCCLUSION, TELLING_HITS
from agent.geometry.lines import Record, along
from agent.geometry.matrix3 import inverse
from agent.kernels import kernel
from agent.mapping.association import BEST, Gates, associate
from agent.mapping.edges import TENTATIVE, WALL, set_end, set_tip
from agent.mapping.joint import crosswise, has_rows, is_landmark, place_end, row_of
from agent.mapping.tentative import is_steady, tentative_of
from protocol.arrays import Floats, Ints, Records

SURE_FACE = 0.3
"""Share of an end's slack up to which hits on the next face may have lengthened its piece. Such an end seems too far
out by a fifth of the slack, as does the other one of the face, whose direction both tell."""
LEAST_SCANS = 10.0  # scans that must have hit a wall of the first look: mixed readings at edges show in one or two
UNKNOWN = 10.0  # m and rad, standard deviation of place and heading before any wall: whole buildings, and all ways


@kernel
def heading_sd(walls: Records, joint: Floats, noise: float) -> float:
    """How well walls (n,) tell the heading of who comes back to where they were seen from, rad; as they are kept.

    By their lines alone. joint: (m, m), of a robot whose pose is exact and the origin: walls err independently of each
    other.
    """
    info = np.eye(3) / UNKNOWN**2  # of x, y and heading
    for e in range(min(len(walls), has_rows(joint))):
        w, row = walls[e], row_of(e)
        offset, both, direction = joint[row, row], joint[row, row + 1], joint[row + 1, row + 1]
        regular = offset * direction - both * both
        if regular <= 0.0 or not (w.kind == WALL or _is_kept(w, noise)):
            continue
        same, grows = crosswise(w, (0.0, 0.0, 0.0))
        for i in range(3):
            for j in range(3):
                a, b, c, d = same[2 + i], grows[2 + i], same[2 + j], grows[2 + j]
                info[i, j] += (direction * a * c - both * (a * d + b * c) + offset * b * d) / regular
    return math.sqrt(inverse(info)[2, 2])


@kernel
def _is_kept(w: Record, noise: float) -> bool:
    """Whether a tentative wall becomes one as the robot leaves."""
    return bool(w.kind == TENTATIVE and w.seen >= LEAST_SCANS and is_steady(w, noise))


@kernel
def keep_first_look(edges: Records, counts: Ints, noise: float) -> None:
    """Let tentative walls that were seen steadily be walls of every particle: edges (p, e), counts (p,).

    The joint estimate knows them already (`joint.know_walls`). Where an end does not hold the robot, they end as far as
    they were seen, and nearer views will tell where. noise: m, standard deviation of a range.
    """
    for p in range(len(counts)):
        for e in range(counts[p]):
            w = edges[p, e]
            if not _is_kept(w, noise):
                continue
            w.kind, w.own, w.misses, w.through = WALL, 1, 0.0, 0.0
            for side in range(2):
                if not is_landmark(w, side):
                    set_end(w, side, FRONTIER, 0.0, 0.0)


@kernel
def hold_first_ends(edges: Records, counts: Ints, joint: Floats, pieces: Records, gates: Gates, views: float) -> None:
    """Let ends that the first look shows hold the robot: edges (p, e), counts (p,), joint (p, m, m), pieces (k,).

    The pose is exact, so they err by themselves alone: within their slack, of which the median of many scans has all
    places alike, and where two faces meet as the lines of both do. views: how many scans the pieces are of.
    """
    no_rows, no_slopes, dice = np.zeros(0, np.int64), np.zeros(0), np.full(len(pieces), BEST)
    for p in range(len(counts)):
        walls = associate(edges[p], counts[p], pieces, gates, dice)
        for k in range(len(pieces)):
            piece = pieces[k]
            e = walls[k] if walls[k] >= 0 else tentative_of(edges[p], counts[p], piece, gates)
            if e < 0 or e >= has_rows(joint[p]) or joint[p, row_of(e), row_of(e)] == 0.0 or piece.hits < TELLING_HITS:
                continue
            w = edges[p, e]
            for side in range(2):
                tip = along(w, piece.x, piece.y) + piece.end[side]
                sure = piece.label[side] == OCCLUSION and piece.face[side] <= SURE_FACE * piece.slack[side]
                if w.link[side] >= 0 or not (sure or piece.label[side] == NOMINAL):
                    continue
                set_tip(w, side, tip)
                set_end(w, side, OCCLUSION, piece.slack[side], views)
                of_lines = gates.noise if piece.label[side] == NOMINAL else 0.0
                sd = math.hypot(piece.slack[side] / math.sqrt(12.0), NOISE_FLOOR_M + of_lines)
                place_end(joint[p], row_of(e) + 2 + side, no_rows, no_slopes, sd * sd)
