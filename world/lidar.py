"""Exact lidar: each wall covers one interval of beams, and only those beams are intersected with it.

This gives the same ranges as testing every beam against every wall, at the cost of the pairs that do meet.
"""

import math
from collections.abc import Sequence

import numpy as np

from protocol.arrays import Floats, Ints
from protocol.messages import LidarSpec
from protocol.walls import lengths, repeated

CELL_M = 1.0  # the walls within range are looked up once for each cell of this size
CHUNK = 20  # robots whose scans are cast at once. Larger arrays were slower: their memory is paged in anew each time

NOTHING, DISC = -1, -2  # in place of a wall's index: the beam met nothing within range, or a teammate
_ROUNDING_BEAMS = 1e-9
"""Intervals are widened by this share of a beam, so that rounding leaves no gap between walls that share a corner."""
_TOUCHING_M = 1e-9  # a lidar nearer than this to a wall, or to its straight continuation, stands on it


class Lidar:
    """A scanning lidar among walls."""

    def __init__(self, segments: Floats, spec: LidarSpec, *, one_sided: bool = False) -> None:
        """Walls are (n, 4) x1, y1, x2, y2 in metres, world frame; those without length are dropped.

        `one_sided` promises that free space lies on the left of every wall and every lidar in free space, as in
        `World.segments`: half of the walls, those seen from behind, are never looked at.
        """
        segments = np.asarray(segments, np.float64).reshape(-1, 4)
        self.spec, self._one_sided = spec, one_sided
        self._index = np.flatnonzero(lengths(segments) > _TOUCHING_M)
        self._ends = segments[self._index]
        angles = np.arange(spec.beams) * (2 * math.pi / spec.beams)
        self._cos, self._sin = np.cos(angles), np.sin(angles)
        self._cells: dict[tuple[int, int], Ints] = {}

    def cast(self, poses: Floats, discs: Floats | None = None) -> Floats:
        """True ranges, (k, beams) metres; see `trace`."""
        return self.trace(poses, discs)[0]

    def trace(self, poses: Floats, discs: Floats | None = None) -> tuple[Floats, Ints]:
        """True ranges and what was met, both (k, beams).

        `poses` is (k, 3) x, y, theta; beam i points at theta + i * 2 pi / beams. `discs` is (m, 3) x, y,
        radius: teammates; one that a lidar stands in is its own robot. Ranges are metres from 0 to
        range_max_m, inf beyond; what was met is the index of a wall, NOTHING or DISC.
        """
        poses = np.asarray(poses, np.float64).reshape(-1, 3)
        nearness = np.zeros((len(poses), self.spec.beams))  # 1 / range, which is linear in a beam's direction
        met = np.full((len(poses), self.spec.beams), NOTHING, np.intp)
        for low in range(0, len(poses), CHUNK):
            part = slice(low, low + CHUNK)
            self._walls(poses[part], nearness[part].reshape(-1), met[part].reshape(-1))
            if discs is not None and len(discs):
                self._discs(poses[part], discs, nearness[part].reshape(-1), met[part].reshape(-1))
        with np.errstate(divide="ignore"):
            ranges = 1 / nearness
        beyond = ranges > self.spec.range_max_m
        ranges[beyond], met[beyond] = np.inf, NOTHING
        return ranges, met

    def measured(self, ranges: Floats, rngs: Sequence[np.random.Generator]) -> Floats:
        """True ranges (k, beams) as the sensor reports them, with one generator a robot.

        Noise is Gaussian; a beam that drops out, or whose range is less than range_min_m or more than
        range_max_m, reports nothing: inf.
        """
        spec = self.spec
        noise = np.stack([rng.standard_normal(spec.beams) for rng in rngs])
        chance = np.stack([rng.random(spec.beams) for rng in rngs])
        out = ranges + spec.noise_m * noise
        lost = (ranges < spec.range_min_m) | (out < spec.range_min_m) | (out > spec.range_max_m)
        out[lost | (chance < spec.dropout)] = np.inf
        return out

    def _near(self, x: float, y: float) -> Ints:
        """Rows of the walls that a lidar anywhere in the cell of this place may see."""
        cell = (math.floor(x / CELL_M), math.floor(y / CELL_M))
        if cell not in self._cells:
            middle = (np.array(cell) + 0.5) * CELL_M
            reach = self.spec.range_max_m + CELL_M * math.sqrt(0.5)
            nearest, _ = _nearest(self._ends[:, :2] - middle, self._ends[:, 2:] - middle)
            self._cells[cell] = np.flatnonzero(nearest <= reach)
        return self._cells[cell]

    def _walls(self, poses: Floats, nearness: Floats, met: Ints) -> None:
        near = [self._near(x, y) for x, y, _ in poses.tolist()]
        wall = np.concatenate(near)
        robot = np.repeat(np.arange(len(poses)), [len(rows) for rows in near])
        start, end = _seen_from(poses[robot], self._ends[wall].reshape(-1, 2, 2).swapaxes(0, 1))
        nearest, farthest = _nearest(start, end)
        turn = start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]  # positive where the lidar is on the left
        facing = nearest <= self.spec.range_max_m
        if self._one_sided:
            facing &= turn > -_TOUCHING_M
        wall, robot, start, end = wall[facing], robot[facing], start[facing], end[facing]
        nearest, farthest, turn = nearest[facing], farthest[facing], turn[facing]
        along = end - start
        sweep = np.arctan2(turn, (start * end).sum(1))
        first = np.where((sweep >= 0)[:, None], start, end)
        begin = np.arctan2(first[:, 1], first[:, 0]) % (2 * math.pi)
        on = nearest <= _TOUCHING_M  # then every beam starts on the wall
        begin[on], sweep[on], nearest[on] = 0.0, 2 * math.pi, 0.0

        # rounding must not carry a grazing hit beyond the ends of the wall
        with np.errstate(divide="ignore"):
            least, most = 1 / farthest, 1 / nearest
        # on the wall's straight continuation a beam along the wall returns its near end
        edge_on = np.abs(turn) <= _TOUCHING_M * np.hypot(along[:, 0], along[:, 1])
        least[edge_on] = most[edge_on]
        slope_x, slope_y = (along / np.where(edge_on, 1.0, turn)[:, None]).T

        pair, beam = self._interval(begin, np.abs(sweep))
        ray = robot[pair] * self.spec.beams + beam
        found = self._cos[beam] * slope_y[pair] - self._sin[beam] * slope_x[pair]
        found = np.minimum(np.maximum(found, least[pair]), most[pair])
        _keep_nearest(ray, found, self._index[wall][pair], nearness, met)

    def _discs(self, poses: Floats, discs: Floats, nearness: Floats, met: Ints) -> None:
        offset = discs[None, :, :2] - poses[:, None, :2]
        away = np.hypot(offset[..., 0], offset[..., 1])
        radius = np.broadcast_to(discs[:, 2], away.shape)
        robot, disc = np.nonzero((away > radius) & (away - radius <= self.spec.range_max_m))
        away, radius = away[robot, disc], radius[robot, disc]
        bearing = np.arctan2(offset[robot, disc, 1], offset[robot, disc, 0]) - poses[robot, 2]
        half = np.arcsin(radius / away)
        pair, beam = self._interval((bearing - half) % (2 * math.pi), 2 * half)
        off = beam * (2 * math.pi / self.spec.beams) - bearing[pair]
        chord = np.maximum(radius[pair] ** 2 - (away[pair] * np.sin(off)) ** 2, 0.0)
        distance = np.maximum(away[pair] * np.cos(off) - np.sqrt(chord), _TOUCHING_M)
        what = np.full(len(pair), DISC, np.intp)
        _keep_nearest(robot[pair] * self.spec.beams + beam, 1 / distance, what, nearness, met)

    def _interval(self, begin: Floats, sweep: Floats) -> tuple[Ints, Ints]:
        """All (row, beam) with the beam in [begin, begin + sweep], radians from the heading."""
        beams = self.spec.beams
        scale = beams / (2 * math.pi)
        low = np.ceil(begin * scale - _ROUNDING_BEAMS).astype(np.intp)
        high = np.floor((begin + sweep) * scale + _ROUNDING_BEAMS).astype(np.intp)
        count = np.clip(high - low + 1, 0, beams)
        row, nth = repeated(count)
        return row, (low[row] + nth) % beams


def _seen_from(poses: Floats, points: Floats) -> Floats:
    """Points (..., n, 2), each in the frame of its pose (n, 3)."""
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    dx, dy = points[..., 0] - poses[:, 0], points[..., 1] - poses[:, 1]
    return np.stack([cos * dx + sin * dy, cos * dy - sin * dx], -1)


def _nearest(start: Floats, end: Floats) -> tuple[Floats, Floats]:
    """Nearest and farthest distance of segments from the origin."""
    along = end - start
    share = np.clip(-(start * along).sum(1) / (along * along).sum(1), 0.0, 1.0)
    foot = start + share[:, None] * along
    farthest = np.maximum(np.hypot(start[:, 0], start[:, 1]), np.hypot(end[:, 0], end[:, 1]))
    return np.hypot(foot[:, 0], foot[:, 1]), farthest


def _keep_nearest(ray: Ints, found: Floats, what: Ints, nearness: Floats, met: Ints) -> None:
    """Raise `nearness` to the largest value found on each ray, and note in `met` what stood there."""
    np.maximum.at(nearness, ray, found)
    won = found == nearness[ray]
    met[ray[won]] = what[won]
