"""Do two maps agree wall by wall where a transform puts them? Agreement and conflict in metres of wall (ours).

Agreement: a wall of one map lies on a wall of the other that faces the same way. Conflict: it runs through the free
strip before a wall of the other, which has nothing there itself. The opposite face of a thin wall is neither.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agent.alignment.config import AlignmentConfig
from agent.geometry.transform import inverse
from agent.kernels import kernel
from protocol.arrays import Bools, Floats, Ints

MAX_CELLS = 200_000
"""Of one index; walls far apart get larger cells instead of more."""
LENGTH = 4
"""Column of a sample's length."""
MAX_SAMPLES = 20_000
"""Of one map: 2 km of wall at the default distance."""


@dataclass(frozen=True)
class Walls:
    """A map's walls, indexed by place, and samples along them. Metres, the map's own frame."""

    segments: Floats
    """(m, 4) x1, y1, x2, y2, free space on the left."""
    samples: Floats
    """(k, 5) x, y, unit direction, and metres of wall that the sample stands for."""
    origin: Floats
    """(3,) lower left corner of the index and size of its square cells."""
    first: Ints
    """(columns, rows + 1) where a cell's walls begin in `members`."""
    members: Ints
    """Walls that come near each cell."""
    free: Floats
    """(m, 2) metres along each wall between which the ground before it is free."""
    ways: Floats
    """(m, 3) unit direction of each wall, and its length."""


def index_walls(segments: Floats, juts: Bools, config: AlignmentConfig) -> Walls:
    """Index of walls (m, 4), none of zero length. juts: (m, 2) whether each end is a corner that sticks out.

    Around such a corner the ground is free on both its walls' sides, and so also beyond the end of each.
    """
    along = segments[:, 2:] - segments[:, :2]
    length = np.hypot(along[:, 0], along[:, 1])
    step = max(config.sample_m, float(length.sum()) / MAX_SAMPLES)
    count = np.ceil(length / step).astype(np.intp)
    wall = np.repeat(np.arange(len(count)), count)
    share = (np.arange(len(wall)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[wall]
    places = segments[wall, :2] + share[:, None] * along[wall]
    samples = np.column_stack([places, (along / length[:, None])[wall], (length / count)[wall]])
    reach = max(config.strip_far_m, config.agree_m)
    corners = segments.reshape(-1, 2)
    low, high = corners.min(0) - reach, corners.max(0) + reach
    cell = max(2.0 * reach, math.sqrt(float((high - low).prod()) / MAX_CELLS), float((high - low).max()) / MAX_CELLS)
    columns, rows = (np.floor((high - low) / cell).astype(int) + 1).tolist()
    first, members = _fill(segments, low[0], low[1], cell, columns, rows, reach)
    begin = np.where(juts[:, 0], -config.strip_far_m, config.strip_end_m)
    end = length + np.where(juts[:, 1], config.strip_far_m, -config.strip_end_m)
    free = np.column_stack([begin, end])
    ways = np.column_stack([along / length[:, None], length])
    return Walls(segments, samples, np.array([low[0], low[1], cell]), first, members, free, ways)


@kernel
def _fill(
    segments: Floats, x0: float, y0: float, cell: float, columns: int, rows: int, reach: float
) -> tuple[Ints, Ints]:
    """Walls by cell: every wall that comes within reach of a cell is in it (by the cell's circumcircle)."""
    counts = np.zeros((columns, rows + 1), np.int64)
    members = np.zeros(0, np.int64)
    radius = reach + 0.7072 * cell
    for fill in range(2):
        if fill == 1:
            total = 0
            for i in range(columns):
                for j in range(rows):
                    here = counts[i, j]
                    counts[i, j] = total
                    total += here
                counts[i, rows] = total
            members = np.empty(total, np.int64)
        at = counts.copy()
        for e in range(segments.shape[0]):
            ax, ay, bx, by = segments[e]
            length = math.hypot(bx - ax, by - ay)
            ux, uy = (bx - ax) / length, (by - ay) / length
            i0, i1 = int((min(ax, bx) - reach - x0) // cell), int((max(ax, bx) + reach - x0) // cell)
            j0, j1 = int((min(ay, by) - reach - y0) // cell), int((max(ay, by) + reach - y0) // cell)
            for i in range(max(i0, 0), min(i1, columns - 1) + 1):
                for j in range(max(j0, 0), min(j1, rows - 1) + 1):
                    cx, cy = x0 + (i + 0.5) * cell - ax, y0 + (j + 0.5) * cell - ay
                    t = min(max(cx * ux + cy * uy, 0.0), length)
                    if (cx - t * ux) ** 2 + (cy - t * uy) ** 2 > radius * radius:
                        continue
                    if fill == 0:
                        counts[i, j] += 1
                    else:
                        members[at[i, j]] = e
                        at[i, j] += 1
    return counts, members


NEITHER, AGREES, CONFLICTS = 0, 1, 2
"""What one map says of a sample of the other."""


def agreement(mine: Walls, theirs: Walls, transform: Floats, config: AlignmentConfig) -> tuple[float, float]:
    """Metres of wall that agree, the mean of both ways, and that are in conflict, the sum.

    transform (3,) takes their frame into mine.
    """
    agreed = conflict = 0.0
    for samples, into, walls in (
        (theirs.samples, transform, mine),
        (mine.samples, inverse(np.asarray(transform, np.float64)), theirs),
    ):
        said = verdicts(samples, into, walls, config)
        agreed += 0.5 * float(samples[said == AGREES, LENGTH].sum())
        conflict += float(samples[said == CONFLICTS, LENGTH].sum())
    return agreed, conflict


def verdicts(samples: Floats, transform: Floats, walls: Walls, config: AlignmentConfig) -> NDArray[np.uint8]:
    """(k,) what the walls say of samples (k, 5) of another map that transform (3,) takes into theirs."""
    said: NDArray[np.uint8] = _verdicts(
        samples,
        np.asarray(transform, np.float64),
        walls.segments,
        walls.origin,
        walls.first,
        walls.members,
        walls.free,
        walls.ways,
        (config.agree_m, math.cos(math.radians(config.alike_deg)), config.strip_near_m, config.strip_far_m),
    )
    return said


@kernel
def _verdicts(
    samples: Floats,
    t: Floats,
    segments: Floats,
    origin: Floats,
    first: Ints,
    members: Ints,
    free: Floats,
    ways: Floats,
    rules: tuple[float, float, float, float],
) -> NDArray[np.uint8]:
    agree_m, alike, near, far = rules
    reach = max(agree_m, near, far)
    c, s = math.cos(t[2]), math.sin(t[2])
    columns, rows = first.shape[0], first.shape[1] - 1
    out = np.zeros(samples.shape[0], np.uint8)
    for k in range(samples.shape[0]):
        x, y = t[0] + c * samples[k, 0] - s * samples[k, 1], t[1] + s * samples[k, 0] + c * samples[k, 1]
        i, j = math.floor((x - origin[0]) / origin[2]), math.floor((y - origin[1]) / origin[2])
        if i < 0 or j < 0 or i >= columns or j >= rows:
            continue
        ux, uy = c * samples[k, 2] - s * samples[k, 3], s * samples[k, 2] + c * samples[k, 3]
        touches = blocked = False
        for n in range(first[i, j], first[i, j + 1]):
            e = members[n]
            dx, dy = x - segments[e, 0], y - segments[e, 1]
            vx, vy, length = ways[e, 0], ways[e, 1], ways[e, 2]
            off = dy * vx - dx * vy
            if abs(off) > reach:
                continue
            along = dx * vx + dy * vy
            beyond = max(-along, along - length, 0.0)
            if beyond * beyond + off * off < near * near:
                touches = True
                if beyond < agree_m and abs(off) < agree_m and ux * vx + uy * vy > alike:
                    out[k] = AGREES
                    break
            elif near <= off <= far and free[e, 0] < along < free[e, 1]:
                blocked = True
        if out[k] != AGREES and blocked and not touches:
            out[k] = CONFLICTS
    return out
