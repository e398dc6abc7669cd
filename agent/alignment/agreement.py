"""Agreement and conflict of two maps under a transform, in metres of wall (ours).

A wall agrees where it lies on a wall of the other map that faces the same way. It is in conflict where it runs through
the free strip before a wall of the other map. The opposite face of a thin wall does neither.
"""

import math
from typing import NamedTuple

import numpy as np

from agent.alignment.config import AlignmentConfig
from agent.geometry.lines import ALIKE_COSINE
from agent.geometry.transform import inverse
from agent.kernels import kernel
from protocol.arrays import Bools, Floats, Ints, Labels
from protocol.walls import directions, lengths, points_along

AGREEMENT_SAMPLE_M = 0.1  # distance of the samples at which walls are compared
MAX_SAMPLES = 20_000  # samples of one map: 2 km of wall at that distance. With more wall they lie farther apart
MAX_CELLS = 200_000  # cells of one index. A map that would need more gets larger ones
AGREE_M = 0.08  # a wall this near to one that faces the same way is the same wall: two corners' errors of 3 sigma
EXACT_M = 0.03  # the same under a transform that is fitted on all walls: 3 sigma of a wall, in either map
BENT_M = 0.05
"""The same where odometry errs and maps are bent as a whole: by 7 mm rms in the median in `hall`, by 28 at most. Of 118
right pairs of maps there 15 had a tenth of their common wall beside itself by 0.03 m, 2 by this."""
STRIP_NEAR_M = 0.15  # free ground before a wall begins here: what is nearer may be noise, or a thin wall's other face
STRIP_FAR_M = 0.5  # free ground before a wall ends here (measured): a map need not have looked farther away
STRIP_END_M = 0.1  # before so much of a wall's end the ground does not count as free, as other walls may begin there
REACH_M = max(AGREE_M, STRIP_NEAR_M, STRIP_FAR_M)


class Walls(NamedTuple):
    """A map's walls, indexed by place, and samples along them. Metres, the map's own frame."""

    segments: Floats  # (m, 4) x1, y1, x2, y2, free space on the left
    samples: Floats  # (k, 5) x, y, unit direction, and metres of wall that the sample stands for
    origin: Floats  # (3,) lower left corner of the index and size of its square cells
    shape: tuple[int, int]  # columns and rows of the index
    begins: Ints  # (columns * rows + 1,) where the walls of a cell, column by column, begin in `members`
    members: Ints  # walls that come near each cell
    free: Floats  # (m, 2) metres along each wall between which the ground before it is free
    ways: Floats  # (m, 3) unit direction of each wall, and its length

    @property
    def length_m(self) -> float:
        """Of all walls."""
        return float(lengths(self.segments).sum())


def index_walls(segments: Floats, juts: Bools) -> Walls:
    """Index of walls (m, 4), none of zero length. juts: (m, 2) whether each end is a corner that sticks out.

    Around such a corner the ground is free on both its walls' sides, and so also beyond the end of each.
    """
    length, direction = lengths(segments), directions(segments)
    step = max(AGREEMENT_SAMPLE_M, float(length.sum()) / MAX_SAMPLES)
    count = np.ceil(length / step).astype(np.int64)
    places, wall = points_along(segments, count)
    samples = np.column_stack([places, direction[wall], (length / count)[wall]])
    corners = segments.reshape(-1, 2) if len(segments) else np.zeros((1, 2))
    low, high = corners.min(0) - REACH_M, corners.max(0) + REACH_M
    cell = max(2.0 * REACH_M, math.sqrt(float((high - low).prod()) / MAX_CELLS), float((high - low).max()) / MAX_CELLS)
    columns, rows = (np.floor((high - low) / cell).astype(int) + 1).tolist()
    cells, members = _walls_by_cell(segments, low[0], low[1], cell, columns, rows)
    order = np.argsort(cells, kind="stable")
    begins = np.searchsorted(cells[order], np.arange(columns * rows + 1))
    begin = np.where(juts[:, 0], -STRIP_FAR_M, STRIP_END_M)
    end = length + np.where(juts[:, 1], STRIP_FAR_M, -STRIP_END_M)
    free, ways = np.column_stack([begin, end]), np.column_stack([direction, length])
    origin = np.array([low[0], low[1], cell])
    return Walls(segments, samples, origin, (columns, rows), begins, members[order], free, ways)


@kernel
def _walls_by_cell(segments: Floats, x0: float, y0: float, cell: float, columns: int, rows: int) -> tuple[Ints, Ints]:
    """Each cell (k,) with each wall (k,) that comes within reach of its circumcircle."""
    cells, members = [0 for _ in range(0)], [0 for _ in range(0)]
    radius = REACH_M + 0.7072 * cell
    for e in range(segments.shape[0]):
        ax, ay, bx, by = segments[e]
        length = math.hypot(bx - ax, by - ay)
        ux, uy = (bx - ax) / length, (by - ay) / length
        i0, i1 = int((min(ax, bx) - REACH_M - x0) // cell), int((max(ax, bx) + REACH_M - x0) // cell)
        j0, j1 = int((min(ay, by) - REACH_M - y0) // cell), int((max(ay, by) + REACH_M - y0) // cell)
        for i in range(max(i0, 0), min(i1, columns - 1) + 1):
            for j in range(max(j0, 0), min(j1, rows - 1) + 1):
                cx, cy = x0 + (i + 0.5) * cell - ax, y0 + (j + 0.5) * cell - ay
                t = min(max(cx * ux + cy * uy, 0.0), length)
                if (cx - t * ux) ** 2 + (cy - t * uy) ** 2 <= radius * radius:
                    cells.append(i * rows + j)
                    members.append(e)
    return np.array(cells), np.array(members)


def overlap(agreed_m: float, mine: Walls, theirs: Walls) -> float:
    """Share of the smaller map's wall that agrees."""
    return agreed_m / min(mine.length_m, theirs.length_m)


NEITHER, AGREES, CONFLICTS = 0, 1, 2  # what one map says of a sample of the other


def agreement(mine: Walls, theirs: Walls, transform: Floats, agree_m: float = AGREE_M) -> tuple[float, float]:
    """Metres of wall in agreement, the mean of both ways, and in conflict, the sum. transform (3,): theirs in mine.

    agree_m: how far from each other two parts of the same wall may be, at most STRIP_NEAR_M.
    """
    agreed = conflict = 0.0
    for samples, into, walls in ((theirs.samples, transform, mine), (mine.samples, inverse(transform), theirs)):
        said = _verdicts(samples, into, walls, agree_m)
        agreed += 0.5 * float(samples[said == AGREES, 4].sum())
        conflict += float(samples[said == CONFLICTS, 4].sum())
    return agreed, conflict


def beside(mine: Walls, theirs: Walls, transform: Floats, on_m: float = EXACT_M) -> float:
    """Share of what both maps have under a transform (3,) fitted on all walls that lies beside its wall, not on it.

    Two maps of one place differ by their errors alone; maps of two places that are alike differ by centimetres
    somewhere. on_m: how far from each other two parts of the same wall may be.
    """
    on, near = (agreement(mine, theirs, transform, limit)[0] for limit in (on_m, STRIP_NEAR_M))
    return 1.0 - on / near if near > 0.0 else 0.0


@kernel
def _verdicts(samples: Floats, t: Floats, walls: Walls, agree_m: float) -> Labels:
    """(k,) what the walls say of samples (k, 5) of another map that the transform t (3,) takes into their frame."""
    segments, origin, free, ways = walls.segments, walls.origin, walls.free, walls.ways
    columns, rows = walls.shape
    c, s = math.cos(t[2]), math.sin(t[2])
    out = np.full(samples.shape[0], NEITHER, np.uint8)
    for k in range(samples.shape[0]):
        x, y = t[0] + c * samples[k, 0] - s * samples[k, 1], t[1] + s * samples[k, 0] + c * samples[k, 1]
        i, j = math.floor((x - origin[0]) / origin[2]), math.floor((y - origin[1]) / origin[2])
        if i < 0 or j < 0 or i >= columns or j >= rows:
            continue
        ux, uy = c * samples[k, 2] - s * samples[k, 3], s * samples[k, 2] + c * samples[k, 3]
        touches = blocked = False
        for n in range(walls.begins[i * rows + j], walls.begins[i * rows + j + 1]):
            e = walls.members[n]
            dx, dy = x - segments[e, 0], y - segments[e, 1]
            vx, vy, length = ways[e, 0], ways[e, 1], ways[e, 2]
            off = dy * vx - dx * vy
            if abs(off) > REACH_M:
                continue
            along = dx * vx + dy * vy
            beyond = max(-along, along - length, 0.0)
            if beyond * beyond + off * off < STRIP_NEAR_M * STRIP_NEAR_M:
                touches = True
                if beyond < AGREE_M and abs(off) < agree_m and ux * vx + uy * vy > ALIKE_COSINE:
                    out[k] = AGREES
                    break
            elif STRIP_NEAR_M <= off <= STRIP_FAR_M and free[e, 0] < along < free[e, 1]:
                blocked = True
        if out[k] != AGREES and blocked and not touches:
            out[k] = CONFLICTS
    return out


def contradict(agreed_m: float, conflict_m: float, config: AlignmentConfig) -> bool:
    """Whether metres of wall in conflict are too many for those that agree; robots that share work have few."""
    return conflict_m > config.max_conflict * max(agreed_m, config.min_score_m)


def bear_out(agreed_m: float, conflict_m: float, config: AlignmentConfig) -> bool:
    """Whether enough metres of wall agree, and few for that are in conflict."""
    return agreed_m >= config.min_score_m and not contradict(agreed_m, conflict_m, config)
