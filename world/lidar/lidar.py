"""Exact lidar: each wall covers one interval of beams, and only those beams are intersected with it.

This gives the same ranges as testing every beam against every wall, at the cost of the pairs that do meet. In here
beams are counted counter-clockwise, whichever way the lidar turns.
"""

import math
from collections.abc import Sequence

import numpy as np

from protocol.arrays import Bools, Floats, Ints
from protocol.messages import LidarSpec
from protocol.walls import directions, lengths
from world.lidar.beams import beams_within, keep_nearest
from world.lidar.readings import readings
from world.lidar.turning import Scans, Turning
from world.way import interpolated

CELL_M = 1.0  # the walls within range are looked up once for each cell of this size
STRIDE_M = 0.05  # ... and for each multiple of this that a lidar moves in half a scan
CHUNK = 100  # robots whose scans are cast at once: fewer take more calls, more do not fit into the processor's caches
_KEPT_BYTES = 1 << 24
"""Size of an array that is made and freed once, so that glibc keeps freed arrays up to twice this size rather than give
them back to the system. To page them in again took half of the time of 30 scans."""

NOTHING, DISC = -1, -2
"""In place of a wall's index: the beam met nothing within range, or disc 0; disc 1 is DISC - 1, and so on."""
_TOUCHING_M = 1e-9  # a lidar nearer than this to a wall, or to its straight continuation, stands on it


class Lidar:
    """A scanning lidar among walls."""

    def __init__(self, segments: Floats, spec: LidarSpec, *, one_sided: bool = False) -> None:
        """Walls are (n, 4) x1, y1, x2, y2 in metres, world frame; those without length are dropped.

        `one_sided` promises that free space lies on the left of every wall and every lidar in free space, as in
        `World.segments`: half of the walls, those seen from behind, are never looked at.
        """
        np.empty(_KEPT_BYTES, np.uint8)  # freed at once, see there
        segments = np.asarray(segments, np.float64).reshape(-1, 4)
        self.spec, self._one_sided = spec, one_sided
        long = lengths(segments)
        self._index = np.flatnonzero(long > _TOUCHING_M)
        self._lengths = long[self._index]
        self._ends, self._units = segments[self._index], directions(segments)
        self._order = slice(None, None, -1 if spec.clockwise else 1)
        self._bearings = spec.bearings()[self._order]
        self._turn = Turning(spec, self._bearings, spec.moments()[self._order])
        self._step = spec.beam_step
        self._cos, self._sin = np.cos(self._bearings), np.sin(self._bearings)
        self._cells: dict[tuple[int, int, int], Ints] = {}

    def rays(self, ways: Floats) -> Floats:
        """Where each beam begins and points, (k, beams, 3): x, y and direction, world frame; `ways` as in `trace`."""
        poses = interpolated(_ways(ways), self.spec.moments()).swapaxes(0, 1)
        x, y, heading = np.moveaxis(poses, 2, 0)
        cos, sin, mount_x, mount_y = np.cos(heading), np.sin(heading), self.spec.mount_x_m, self.spec.mount_y_m
        places = (x + cos * mount_x - sin * mount_y, y + sin * mount_x + cos * mount_y)
        return np.stack([*places, heading + self.spec.bearings()], 2)

    def cast(self, ways: Floats, discs: Floats | None = None) -> Floats:
        """True ranges, (k, beams) metres; see `trace`."""
        return self.trace(ways, discs)[0]

    def trace(self, ways: Floats, discs: Floats | None = None) -> tuple[Floats, Ints]:
        """True ranges and what was met, both (k, beams).

        ways: (s, k, 3) x, y, theta of the robots at equal steps of the scan's period (`world.way`), from its begin to
        its stamp; or (k, 3), at the stamp, where they stand or the lidar looks everywhere at once. discs: (s, m, 3) or
        (m, 3), x, y, radius of bodies at the same steps; one in which a robot's centre is at the stamp is its own.
        A lidar that is in one, as beyond its own body it may be, looks through it.
        Ranges are metres from 0 to range_max_m, inf beyond; what was met is the index of a wall, NOTHING, or at most
        DISC.
        """
        ways, discs = _ways(ways), _ways(np.zeros((0, 3)) if discs is None else discs)
        shape = (ways.shape[1], self.spec.beams)
        nearness = np.zeros(shape)  # 1 / range, which is linear in a beam's direction
        met = np.full(shape, NOTHING, np.intp)
        for low in range(0, len(nearness), CHUNK):
            part = slice(low, low + CHUNK)
            if self.spec.turning:
                self._turning(ways[:, part], discs, nearness[part], met[part])
            else:
                self._at_once(ways[-1, part], discs[-1], nearness[part], met[part])
        with np.errstate(divide="ignore"):
            ranges = 1 / nearness[:, self._order]
        met = met[:, self._order]
        beyond = ranges > self.spec.range_max_m
        ranges[beyond], met[beyond] = np.inf, NOTHING
        return ranges, met

    def measured(
        self, ranges: Floats, rngs: Sequence[np.random.Generator], met: Ints | None = None, rays: Floats | None = None
    ) -> Floats:
        """True ranges (k, beams) as the sensor reports them (`world.lidar.readings`), with one generator a robot.

        met, rays: what the beams met and how they pointed, as from `trace` and `rays`; None: no edges, all met square.
        """
        sines = self._sines(met, rays) if self.spec.grazing_deg and met is not None and rays is not None else None
        return readings(self.spec, ranges, rngs, met, sines)

    def _sines(self, met: Ints, rays: Floats) -> Floats:
        """(k, beams) sine of the angle between beam and wall; inf where it met none. Discs graze in a beam at most."""
        x, y = self._units[np.maximum(met, 0)].T.swapaxes(1, 2)
        sines = np.abs(np.cos(rays[..., 2]) * y - np.sin(rays[..., 2]) * x)
        return np.where(met >= 0, sines, np.inf)

    def _near(self, x: float, y: float, half_m: float) -> Ints:
        """Rows of the walls that a lidar may see which stays within `half_m` of a place in the cell of this one."""
        cell = (math.floor(x / CELL_M), math.floor(y / CELL_M), math.ceil(half_m / STRIDE_M))
        if cell not in self._cells:
            middle = (np.array(cell[:2]) + 0.5) * CELL_M
            reach = self.spec.range_max_m + CELL_M * math.sqrt(0.5) + cell[2] * STRIDE_M
            nearest = _nearest(self._ends[:, :2] - middle, self._ends[:, 2:] - middle)
            self._cells[cell] = np.flatnonzero(nearest <= reach)
        return self._cells[cell]

    def _in_reach(self, poses: Floats, half_m: Floats) -> tuple[Ints, Ints, Floats, Floats, Floats, Floats]:
        """Walls that lidars may see which stay within half_m (k,) of poses (k, 3).

        Of each: its row, whose it is, start and end (n, 2) in the frame of the pose, distance from it, and twice
        the area of the triangle with it, positive where the pose is on its left.
        """
        near = [self._near(x, y, half) for (x, y, _), half in zip(poses.tolist(), half_m.tolist(), strict=True)]
        wall = np.concatenate(near)
        robot = np.repeat(np.arange(len(poses)), [len(rows) for rows in near])
        start, end = _seen_from(poses[robot], self._ends[wall].reshape(-1, 2, 2).swapaxes(0, 1))
        nearest = _nearest(start, end)
        area = start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]
        half = half_m[robot]
        facing = nearest <= self.spec.range_max_m + half
        if self._one_sided:
            facing &= area > -_TOUCHING_M - half * self._lengths[wall]
        parts = (wall, robot, start, end, nearest, area)
        return tuple(part[facing] for part in parts)  # type: ignore[return-value]

    def _at_once(self, poses: Floats, discs: Floats, nearness: Floats, met: Ints) -> None:
        own = _own(poses, discs)
        if self.spec.mount_x_m or self.spec.mount_y_m:
            poses = self.rays(poses)[:, 0] - [0, 0, self.spec.bearings()[0]]
        self._walls(poses, nearness.reshape(-1), met.reshape(-1))
        if len(discs):
            self._discs(poses, discs, own, nearness.reshape(-1), met.reshape(-1))

    def _walls(self, poses: Floats, nearness: Floats, met: Ints) -> None:
        wall, robot, start, end, nearest, cross = self._in_reach(poses, np.zeros(len(poses)))
        along_wall = end - start
        farthest = np.maximum(np.hypot(start[:, 0], start[:, 1]), np.hypot(end[:, 0], end[:, 1]))
        sweep = np.arctan2(cross, (start * end).sum(1))
        first = np.where((sweep >= 0)[:, None], start, end)
        begin = (np.arctan2(first[:, 1], first[:, 0]) - self._bearings[0]) % (2 * math.pi)
        on = nearest <= _TOUCHING_M  # then every beam starts on the wall
        begin[on], sweep[on], nearest[on] = 0.0, 2 * math.pi, 0.0

        # rounding must not carry a grazing hit beyond the ends of the wall
        with np.errstate(divide="ignore"):
            least, most = 1 / farthest, 1 / nearest
        # on the wall's straight continuation a beam along the wall returns its near end
        edge_on = np.abs(cross) <= _TOUCHING_M * np.hypot(along_wall[:, 0], along_wall[:, 1])
        least[edge_on] = most[edge_on]
        slope_x, slope_y = (along_wall / np.where(edge_on, 1.0, cross)[:, None]).T

        pair, beam = beams_within(begin, np.abs(sweep), self._step, self.spec.beams)
        found = self._cos[beam] * slope_y[pair] - self._sin[beam] * slope_x[pair]
        found = np.minimum(np.maximum(found, least[pair]), most[pair])
        keep_nearest(robot[pair] * self.spec.beams + beam, found, self._index[wall][pair], nearness, met)

    def _discs(self, poses: Floats, discs: Floats, own: Bools, nearness: Floats, met: Ints) -> None:
        offset = discs[None, :, :2] - poses[:, None, :2]
        away = np.hypot(offset[..., 0], offset[..., 1])
        radius = np.broadcast_to(discs[:, 2], away.shape)
        robot, disc = np.nonzero((away > radius) & ~own & (away - radius <= self.spec.range_max_m))
        away, radius = away[robot, disc], radius[robot, disc]
        bearing = np.arctan2(offset[robot, disc, 1], offset[robot, disc, 0]) - poses[robot, 2] - self._bearings[0]
        half = np.arcsin(radius / away)
        pair, beam = beams_within((bearing - half) % (2 * math.pi), 2 * half, self._step, self.spec.beams)
        off = beam * self._step - bearing[pair]
        chord = np.maximum(radius[pair] ** 2 - (away[pair] * np.sin(off)) ** 2, 0.0)
        distance = np.maximum(away[pair] * np.cos(off) - np.sqrt(chord), _TOUCHING_M)
        keep_nearest(robot[pair] * self.spec.beams + beam, 1 / distance, DISC - disc[pair], nearness, met)

    def _turning(self, ways: Floats, discs: Floats, nearness: Floats, met: Ints) -> None:
        scans, nearness, met = Scans(self._turn, ways), nearness.reshape(-1), met.reshape(-1)
        wall, robot, start, end, nearest, area = self._in_reach(scans.origins, scans.half_m)
        row, ray, found = scans.walls(robot, start, end, nearest, area, self._lengths[wall])
        keep_nearest(ray, found, self._index[wall][row], nearness, met)
        if discs.shape[1]:
            disc, ray, found = scans.discs(discs, self.spec.range_max_m, _own(ways[-1], discs[-1]))
            keep_nearest(ray, found, DISC - disc, nearness, met)


def _ways(ways: Floats) -> Floats:
    """Ways (s, k, 3) or poses (k, 3) as (s, k, 3)."""
    ways = np.asarray(ways, np.float64)
    return ways if ways.ndim == 3 else ways.reshape(1, -1, 3)


def _own(poses: Floats, discs: Floats) -> Bools:
    """(k, m) which of discs (m, 3) the centre of each robot, at poses (k, 3), is in."""
    offset = discs[None, :, :2] - poses[:, None, :2]
    return np.asarray(np.hypot(offset[..., 0], offset[..., 1]) <= discs[:, 2])


def _seen_from(poses: Floats, points: Floats) -> Floats:
    """Points (..., n, 2), each in the frame of its pose (n, 3)."""
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    dx, dy = points[..., 0] - poses[:, 0], points[..., 1] - poses[:, 1]
    return np.stack([cos * dx + sin * dy, cos * dy - sin * dx], -1)


def _nearest(start: Floats, end: Floats) -> Floats:
    """Distances of segments from the origin."""
    along = end - start
    share = np.clip(-(start * along).sum(1) / (along * along).sum(1), 0.0, 1.0)
    foot = start + share[:, None] * along
    return np.asarray(np.hypot(foot[:, 0], foot[:, 1]))
