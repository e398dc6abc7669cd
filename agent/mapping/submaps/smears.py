"""Lines that are no walls of their own: drawn once more, before the wall that they are of, or across it (ours).

Far scans show a wall turned by some degrees, and beams at the tip of a partition read ranges between its two faces.
"""

import math

import numpy as np

from agent.geometry.clearance import crosses
from agent.geometry.lines import ALIKE_COSINE, above, along
from agent.geometry.wall_tiles import boxes_at
from agent.kernels import kernel
from agent.mapping.submaps.matching import share_beside, tiles_of
from agent.mapping.submaps.segments import samples_along, tips_of
from agent.mapping.submaps.tiles import tiled
from protocol.arrays import Bools, Floats, Records

TWICE_M = 0.07  # a wall that lies so near beside longer ones that face the same way is drawn already
TWICE_SHARE = 0.6  # of its length
BEFORE_M = 0.3  # that a wall may stand before one that it would hide: far scans show such, turned by some degrees
BEFORE_TIMES = 20.0
"""Times that each metre of that other wall must have been seen more often. In `office` such walls were seen twice to
four times, in 60 to 120 scans that showed the wall behind them; without them 0.92 of the map is wall, before 0.90."""
ACROSS_TIMES = 4.0
"""The same of a wall that a line lies across. Of ten drives' maps 0.947 is wall in the mean, without this 0.915, and as
much of the walls is found."""
PAST_SHARE = 0.1  # of a line's length, at least, on either side of the wall: what is less may be a wall that runs on
SQUARE_SINE = math.sin(math.radians(70.0))  # of a turn, from which a line across is the face of a partition's tip


@kernel
def stand_once(walls: Records) -> Bools:
    """Which walls (n,), longest first, do not lie beside longer ones for the most part."""
    kept, out = walls.copy(), np.zeros(len(walls), np.bool_)
    tiles = tiles_of(kept)
    for k in range(len(walls)):
        kept[k].ux = kept[k].uy = 0.0  # so it faces no other one
    for k in range(len(walls)):
        if share_beside(tiles, walls[k : k + 1], TWICE_M) < TWICE_SHARE:
            kept[k] = walls[k]
            out[k] = True
    return out


@kernel
def stand_before(walls: Records) -> Bools:
    """Which walls (n,) stand for the most part before others that were seen far more often: they would hide those."""
    out = np.zeros(len(walls), np.bool_)
    tiles = tiled(walls, BEFORE_M).tiles
    for k in range(len(walls)):
        e, samples, before = walls[k], samples_along(walls[k : k + 1]), 0
        often = BEFORE_TIMES * e.hits / (e.high - e.low)
        for j in range(len(samples)):
            x, y = samples[j, 0], samples[j, 1]
            for b in boxes_at(tiles, x, y):
                f = walls[b]
                if f.hits < often * (f.high - f.low) or f.ux * e.ux + f.uy * e.uy < ALIKE_COSINE:
                    continue
                if -TWICE_M <= above(f, x, y) <= BEFORE_M and f.low <= along(f, x, y) <= f.high:
                    before += 1
                    break
        out[k] = before >= TWICE_SHARE * len(samples)
    return out


def lie_across(walls: Records, overrun_m: float) -> Bools:
    """Which walls (n,) lie obliquely across others that were seen more often: real walls do not cross.

    overrun_m: as of `overrun_of`; what noise draws from one face to the next is at most twice as long.
    """
    tips = tips_of(walls)
    return _lie_across(walls, tips[:, 0], tips[:, 1], overrun_m)


@kernel
def _lie_across(walls: Records, tails: Floats, heads: Floats, overrun_m: float) -> Bools:
    """`lie_across`, with tails and heads (n, 2)."""
    out = np.zeros(len(walls), np.bool_)
    tiles = tiled(walls, overrun_m).tiles
    for k in range(len(walls)):
        e, (ax, ay), (bx, by) = walls[k], tails[k], heads[k]
        if e.high - e.low > 2.0 * overrun_m:
            continue
        often = ACROSS_TIMES * e.hits / (e.high - e.low)
        for b in boxes_at(tiles, 0.5 * (ax + bx), 0.5 * (ay + by)):
            f, (cx, cy), (dx, dy) = walls[b], tails[b], heads[b]
            if f.hits < often * (f.high - f.low) or abs(e.ux * f.uy - e.uy * f.ux) > SQUARE_SINE:
                continue
            left, right = abs(above(f, ax, ay)), abs(above(f, bx, by))
            if min(left, right) >= PAST_SHARE * (left + right) and crosses(ax, ay, bx, by, cx, cy, dx, dy):
                out[k] = True
                break
    return out
