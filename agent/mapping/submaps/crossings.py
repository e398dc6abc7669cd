"""Where walls end: at those that they run into, at corners, and where a partition stands on them (ours).

Hits on one wall scatter along the next, and submaps take a wall to reach as far as any scan has shown it. A lidar whose
ranges err by 6 cm draws walls up to 0.3 m too long. Where a partition stands on a wall no scan has seen that, and
submaps take it to go on there.
"""

import numpy as np

from agent.corner_scan import noise_at
from agent.geometry.lines import Record, above, along, meet
from agent.geometry.wall_tiles import boxes_at
from agent.kernels import kernel
from agent.mapping.edges import MIN_WALL_M
from agent.mapping.submaps.segments import tips_of
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

    overrun_m: as of `overrun_of`. An end takes half of its wall at most; parts that are no walls are left away.
    """
    at, by = _ends(walls, overrun_m)
    out = walls.copy()
    out["low"], out["high"] = at.T
    behind, gaps = _partitions(out, by)
    parts = out[behind]
    for k in range(len(gaps) - 1, -1, -1):  # from each wall's head to its tail
        parts["low"][k], parts["high"][k] = gaps[k, 1], out["high"][behind[k]]
        out["high"][behind[k]] = gaps[k, 0]
    out = np.concatenate((out, parts))
    long_enough: Records = out[out["high"] - out["low"] >= MIN_WALL_M]
    return long_enough


def _partitions(walls: Records, by: Ints) -> tuple[Ints, Floats]:
    """Where partitions stand on walls (n,): (k,) the wall, and (k, 2) from where to where along it, in order; metres.

    by: (n, 2) the wall that ends each tail and head, or -1. Along a wall, a partition is a face that leaves it,
    and next one that comes back. Thin boards whose faces noise has swapped are none.
    """
    ends, side = np.nonzero(by >= 0)
    of, places = by[ends, side], tips_of(walls)[ends, side]
    wall = walls[of]
    t = (places[:, 0] - wall["x"]) * wall["ux"] + (places[:, 1] - wall["y"]) * wall["uy"]
    order = np.lexsort((t, of))
    of, t, comes = of[order], t[order], side[order] == 1
    pair = (of[1:] == of[:-1]) & ~comes[:-1] & comes[1:] & (np.diff(t) <= THICK_M)
    leave = np.flatnonzero(pair)
    return of[leave], np.column_stack((t[leave], t[leave + 1]))


@kernel
def _ends(walls: Records, overrun_m: float) -> tuple[Floats, Ints]:
    """(n, 2) where walls (n,) end, metres along each from its centroid, and (n, 2) the wall that ends it, or -1."""
    at, by = np.empty((len(walls), 2)), np.full((len(walls), 2), -1)
    near = max(overrun_m, CORNER_M)  # of an end: all crossings that may be it; from there as far to where a wall begins
    tiles = tiled(walls, 2.0 * near).tiles
    for a in range(len(walls)):
        e = walls[a]
        at[a, 0], at[a, 1] = e.low, e.high
        for side in range(2):
            outward, end, most = 2.0 * side - 1.0, at[a, side], min(overrun_m, 0.5 * (at[a, 1] - at[a, 0]))
            x, y, over = e.x + end * e.ux, e.y + end * e.uy, -CORNER_M
            for b in boxes_at(tiles, x, y):
                if abs(above(walls[b], x, y)) > near:
                    continue
                sine, crossing = meet(e, walls[b])
                passed = outward * (end - crossing)
                if over < passed <= most and _ends_there(e, walls[b], outward * sine, crossing, outward, overrun_m):
                    over, at[a, side], by[a, side] = passed, crossing, b
    return at, by


@kernel
def _ends_there(e: Record, f: Record, turn: float, crossing: float, outward: float, overrun_m: float) -> bool:
    """Whether wall f ends wall e where both cross, `crossing` metres along e; outward: 1 at its head, -1 at its tail.

    turn: the sine of the turn at that corner, positive towards the free space, which is on the left of both walls. A
    face that turns towards it hides what is behind, at a corner as in the middle of f, if there is more of it before e
    than it may run on itself. One that turns away is a corner, or else stands behind e: it must begin there, and
    that of the room behind begins a partition of 0.1 m farther off.
    """
    if abs(turn) < LEAST_SINE:
        return False
    t = along(f, e.x + crossing * e.ux, e.y + crossing * e.uy)
    since, left = (t - f.low, f.high - t) if outward > 0.0 else (f.high - t, t - f.low)  # of f, as it comes from e
    if turn > 0.0:
        return bool(since >= -CORNER_M and left > overrun_m)
    return bool(-0.5 * CORNER_M <= since <= overrun_m and left > 0.0)
