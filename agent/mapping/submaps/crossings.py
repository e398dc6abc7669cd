"""Where walls end: at those that they run into, at corners, and where a partition stands on them (ours).

Hits on one wall scatter along the next, and submaps take a wall to reach as far as any scan has shown it. A lidar whose
ranges err by 6 cm draws walls up to 0.3 m too long. Where a partition stands on a wall no scan has seen that, and
submaps take it to go on there.
"""

import numpy as np

from agent.corner_scan import noise_at
from agent.geometry.lines import Record, along, meet
from agent.kernels import kernel
from agent.mapping.submaps.tiles import tiled
from protocol.arrays import Floats, Ints, Records
from protocol.messages import LidarSpec

OVERRUN_SIGMAS = 5.0
"""Deviations of the lidar's farthest ranges by which a wall runs on past its end, at most. With 4, 5 and 6, 0.92 of the
maps of three drives is wall that is there, with 3 0.91. With 0.35 m for a SICK, whose ranges err by 1 cm, a map of
freiburg-079 lost a quarter of its walls to clutter that crosses them."""
MOST_OVERRUN_M = 0.35  # the same in metres, for lidars that reach farther: what is longer is wall
CORNER_M = 0.12  # ends this near to each other, or to a crossing, are there, so that cupboards are chains, not heaps
LEAST_SINE = 0.5  # of a turn: where two walls nearly on a line cross, noise moves the crossing far along them
THICK_M = 0.5  # of a partition, at most: faces farther apart may be of two, with a wall between them


def overrun_of(lidar: LidarSpec) -> float:
    """Metres by which walls that this lidar sees run on past where they end, at most."""
    return min(OVERRUN_SIGMAS * float(noise_at(lidar, np.array(lidar.range_max_m))), MOST_OVERRUN_M)


def ended(walls: Records, overrun_m: float) -> Records:
    """Walls (n,) of SEGMENT without what runs on past crossings, and in parts where partitions stand on them: (m,).

    overrun_m: as of `overrun_of`.
    """
    ends, by = _ends(walls, overrun_m)
    out = walls.copy()
    out["low"], out["high"] = ends.T
    parts = [out]
    for f in np.unique(by[by >= 0]):
        gaps = _partitions_on(out, f, by)
        if len(gaps):
            rest = np.repeat(out[f : f + 1], len(gaps))
            rest["low"], rest["high"] = gaps[:, 1], [*gaps[1:, 0], out["high"][f]]
            out["high"][f] = gaps[0, 0]
            parts.append(rest)
    return np.concatenate(parts)


def _partitions_on(walls: Records, f: int, by: Ints) -> Floats:
    """(k, 2) where partitions that stand on wall f of (n,) begin and end, metres along it from its centroid.

    by: (n, 2) the wall that ends each tail and head. Along f, a partition is a face that leaves f, and next one that
    comes back to it.
    """
    leave, come = (_places_on(walls[f], walls[by[:, side] == f], end) for side, end in enumerate(("low", "high")))
    before = np.searchsorted(leave, come) - 1
    first = np.diff(before, prepend=-1) > 0  # that comes back after a face that leaves
    gaps = np.column_stack((leave[before[first]], come[first]))
    return gaps[gaps[:, 1] - gaps[:, 0] <= THICK_M]


def _places_on(wall: Record, ending: Records, end: str) -> Floats:
    """(k,) where ends of walls (k,), `low` or `high`, are along a wall, in order."""
    x, y = ending["x"] + ending[end] * ending["ux"], ending["y"] + ending[end] * ending["uy"]
    return np.sort((x - wall["x"]) * wall["ux"] + (y - wall["y"]) * wall["uy"])


@kernel
def _ends(walls: Records, overrun_m: float) -> tuple[Floats, Ints]:
    """(n, 2) where walls (n,) end, metres along each from its centroid, and (n, 2) the wall that ends it, or -1."""
    at, by = np.empty((len(walls), 2)), np.full((len(walls), 2), -1)
    tiling, listed = tiled(walls, CORNER_M).tiles
    for a in range(len(walls)):
        e = walls[a]
        at[a, 0], at[a, 1] = e.low, e.high
        for side in range(2):
            outward, end, most = 2.0 * side - 1.0, at[a, side], min(overrun_m, 0.5 * (at[a, 1] - at[a, 0]))
            column = int((e.x + end * e.ux - tiling.x) * tiling.per_m)
            row = int((e.y + end * e.uy - tiling.y) * tiling.per_m)
            tile, over = row * tiling.columns + column, -CORNER_M
            for b in listed[listed[tile] : listed[tile + 1]]:
                crossing = meet(e, walls[b])[1]
                if over < outward * (end - crossing) <= most and _ends_there(e, walls[b], crossing, outward, overrun_m):
                    over = outward * (end - crossing)
                    at[a, side], by[a, side] = crossing, b
    return at, by


@kernel
def _ends_there(e: Record, f: Record, crossing: float, outward: float, overrun_m: float) -> bool:
    """Whether wall f ends wall e where both cross, `crossing` metres along e; outward: 1 at its head, -1 at its tail.

    Free space is on the left of both. A face that turns towards the free space before e hides what is behind it, at a
    corner as in the middle of f. One that turns away from it is a corner where f begins, and else stands behind e.
    """
    turn, t = meet(e, f)[0] * outward, along(f, e.x + crossing * e.ux, e.y + crossing * e.uy)
    if abs(turn) < LEAST_SINE:
        return False
    behind, before = (t - f.low, f.high - t) if outward > 0.0 else (f.high - t, t - f.low)  # of e, and on its free side
    if turn > 0.0:
        return bool(behind >= -CORNER_M and before > overrun_m)
    return bool(abs(behind) <= overrun_m)
