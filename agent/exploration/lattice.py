"""Samples of an area on a square lattice: which lie inside a polygon, and which are seen from somewhere (ours).

A crowd has thousands of viewpoints, and a building of 40 m has 160,000 samples 0.1 m apart. So an eye looks at the
samples around it alone, and not at those of tiles in which all have been seen.
"""

import math
from typing import NamedTuple

import numpy as np
import shapely

from agent.geometry.clearance import to_wall2, walls_near
from agent.geometry.visibility import hidden_by
from agent.kernels import kernel
from protocol.arrays import Bools, Floats, Ints

TILE = 8  # samples a side of the squares whose unseen samples are counted: an eye's radius is three of them
ON_EDGE_M = 1e-9  # a sample this near to a polygon's edge is on it, and so not inside


class Lattice(NamedTuple):
    """Samples at all multiples of a step between two corners."""

    xs: Floats  # (c,) of the columns, metres
    ys: Floats  # (r,) of the rows
    step: float  # metres

    def points(self, chosen: Bools) -> Floats:
        """(n, 2) the chosen samples (r, c), in the order of y."""
        row, column = np.nonzero(chosen)
        return np.stack((self.xs[column], self.ys[row]), 1)

    def places(self, points: Floats) -> tuple[Ints, Ints]:
        """Rows and columns of those of its samples that are among points (n, 2), samples of the same step."""
        if not self.xs.size or not self.ys.size:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        column, row = np.rint((points - (self.xs[0], self.ys[0])) / self.step).astype(np.int64).T
        held = (column >= 0) & (column < len(self.xs)) & (row >= 0) & (row < len(self.ys))
        return row[held], column[held]


def lattice_between(low: Floats, high: Floats, step: float) -> Lattice:
    """The lattice between two corners (2,)."""
    xs, ys = (np.arange(math.ceil(a / step), math.floor(b / step) + 1) * step for a, b in zip(low, high, strict=True))
    return Lattice(xs, ys, step)


def marked(points: Floats, step: float) -> tuple[Lattice, Bools]:
    """The lattice of this step around some of its samples (n, 2), and which (r, c) they are."""
    if not len(points):
        return Lattice(np.zeros(0), np.zeros(0), step), np.zeros((0, 0), np.bool_)
    lattice = lattice_between(points.min(0) - 0.5 * step, points.max(0) + 0.5 * step, step)
    chosen = np.zeros((len(lattice.ys), len(lattice.xs)), np.bool_)
    chosen[lattice.places(points)] = True
    return lattice, chosen


def inside(lattice: Lattice, area: shapely.Geometry) -> Bools:
    """Which samples (r, c) lie inside a polygon or several that do not overlap.

    As `shapely.contains_xy` says, which takes 49 ms for a maze of 40 m instead of 0.6.
    """
    rings = shapely.get_rings(shapely.get_parts(area))
    corners, ring = shapely.get_coordinates(rings, return_index=True)
    one = ring[1:] == ring[:-1]
    return np.asarray(_inside(lattice, np.hstack((corners[:-1][one], corners[1:][one]))))


@kernel
def _column_after(x: float, lattice: Lattice) -> int:
    """The first column beyond x."""
    xs = lattice.xs
    at = min(max(int((x - xs[0]) / lattice.step), 0), len(xs))
    while at < len(xs) and xs[at] <= x:
        at += 1
    while at > 0 and xs[at - 1] > x:
        at -= 1
    return at


@kernel
def _inside(lattice: Lattice, sides: Floats) -> Bools:
    """Which samples (r, c) an odd number of sides (s, 4) lie to the left of, without those on a side."""
    xs, ys, _ = lattice
    out, on_side = np.zeros((len(ys), len(xs)), np.bool_), np.zeros((len(ys), len(xs)), np.bool_)
    if out.size == 0:
        return out
    for k in range(len(sides)):
        ax, ay, bx, by = sides[k]
        if ay > by:
            ax, ay, bx, by = bx, by, ax, ay
        for row in range(np.searchsorted(ys, ay - ON_EDGE_M), len(ys)):
            y = ys[row]
            if y > by + ON_EDGE_M:
                break
            level = by - ay <= ON_EDGE_M
            x = ax if level else ax + (min(max(y, ay), by) - ay) * (bx - ax) / (by - ay)
            low, high = (min(ax, bx), max(ax, bx)) if level else (x, x)
            for column in range(_column_after(low - ON_EDGE_M, lattice), _column_after(high + ON_EDGE_M, lattice)):
                on_side[row, column] = True
            if ay <= y < by:
                column = _column_after(x, lattice)
                if column < len(xs):
                    out[row, column] = not out[row, column]
    for row in range(len(ys)):
        odd = False
        for column in range(len(xs)):
            odd ^= out[row, column]
            out[row, column] = odd and not on_side[row, column]
    return out


@kernel
def take_beside(left: Bools, lattice: Lattice, walls: Floats, off_m: float) -> None:
    """Take out of `left` (r, c) the samples that are nearer than off_m to any of walls (m, 4)."""
    xs, ys, _ = lattice
    for k in range(len(walls)):
        ax, ay, bx, by = walls[k]
        first, end = np.searchsorted(ys, np.array((min(ay, by) - off_m, max(ay, by) + off_m)))
        begin, stop = np.searchsorted(xs, np.array((min(ax, bx) - off_m, max(ax, bx) + off_m)))
        for row in range(first, end):
            for column in range(begin, stop):
                if left[row, column] and to_wall2(xs[column], ys[row], ax, ay, bx, by) < off_m * off_m:
                    left[row, column] = False


@kernel
def unseen_in_tiles(left: Bools) -> Ints:
    """How many of the samples (r, c) are left in each square of TILE by TILE."""
    counts = np.zeros((left.shape[0] // TILE + 1, left.shape[1] // TILE + 1), np.int64)
    for row in range(left.shape[0]):
        for column in range(left.shape[1]):
            counts[row // TILE, column // TILE] += left[row, column]
    return counts


@kernel
def take_seen(left: Bools, lattice: Lattice, eyes: Floats, walls: Floats, radius: float, beyond: float) -> None:
    """Take out of `left` (r, c) the samples that are seen from any of eyes (k, 2) within the radius, past walls (m, 4).

    beyond: metres; samples nearer to an eye than this are not asked, as an earlier call took out all of these that are
    seen.
    """
    counts, hid_by = unseen_in_tiles(left), np.full(left.shape, -1)
    numbered = np.empty((len(walls), 5))
    for k in range(len(walls)):
        numbered[k, :4], numbered[k, 4] = walls[k], k
    for e in range(len(eyes)):
        _take_seen_from(eyes[e, 0], eyes[e, 1], left, counts, hid_by, lattice, numbered, radius, beyond)


@kernel
def _take_seen_from(
    x: float, y: float, left: Bools, counts: Ints, hid_by: Ints, lattice: Lattice, walls: Floats, radius: float,
    beyond: float,
) -> None:  # fmt: skip
    """The same from one eye. walls (m, 5): with their rows.

    Kept up are counts, of `unseen_in_tiles`, and hid_by (r, c), the wall that hid each sample last, or -1: it hides the
    sample from most other eyes, too.
    """
    xs, ys, _ = lattice
    first, end = int(np.searchsorted(ys, y - radius)), int(np.searchsorted(ys, y + radius, "right"))
    begin, stop = int(np.searchsorted(xs, x - radius)), int(np.searchsorted(xs, x + radius, "right"))
    near, asked = walls[:0], False
    for i in range(first // TILE, (end + TILE - 1) // TILE):
        for j in range(begin // TILE, (stop + TILE - 1) // TILE):
            if counts[i, j] == 0:
                continue
            rows = max(first, i * TILE), min(end, (i + 1) * TILE)
            columns = max(begin, j * TILE), min(stop, (j + 1) * TILE)
            between, filtered = near, False
            for row in range(rows[0], rows[1]):
                for column in range(columns[0], columns[1]):
                    px, py, last = xs[column], ys[row], hid_by[row, column]
                    away2 = (px - x) ** 2 + (py - y) ** 2
                    if not left[row, column] or away2 > radius * radius or 0.0 < away2 <= beyond * beyond:
                        continue
                    if last >= 0 and hidden_by(x, y, px, py, walls[last : last + 1]) >= 0:
                        continue
                    if not asked:
                        near, asked = walls_near(walls, x, y, radius), True
                    if not filtered:
                        low, high = (xs[columns[0]], ys[rows[0]]), (xs[columns[1] - 1], ys[rows[1] - 1])
                        between = _reaching(near, min(x, low[0]), min(y, low[1]), max(x, high[0]), max(y, high[1]))
                        filtered = True
                    by = hidden_by(x, y, px, py, between)
                    if by >= 0:
                        hid_by[row, column] = int(between[by, 4])
                    else:
                        left[row, column] = False
                        counts[i, j] -= 1


@kernel
def _reaching(walls: Floats, low_x: float, low_y: float, high_x: float, high_y: float) -> Floats:
    """Those of walls (m, 5) whose bounding boxes reach into this one: no other hides anything in it from within."""
    found, m = np.empty(walls.shape), 0
    for k in range(len(walls)):
        ax, ay, bx, by = walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3]
        if min(ax, bx) <= high_x and max(ax, bx) >= low_x and min(ay, by) <= high_y and max(ay, by) >= low_y:
            found[m] = walls[k]
            m += 1
    return found[:m]
