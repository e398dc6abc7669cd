"""Scans of lidars that turn while their robots drive: each beam has a place and a direction of its own.

All is done in one frame for each scan: at the middle of the way that the lidar makes in it, along its middle heading.
There a wall covers about the beams that it would cover for a lidar that stands. Its interval is widened by what the
motion can change, and every beam in it is tested.
"""

import math

import numpy as np

from protocol.arrays import Bools, Floats, Ints
from protocol.messages import LidarSpec
from world.beams import beams_within
from world.way import along, between

_ON_M = 1e-9  # a beam that passes a wall's end by less than this meets it; a lidar nearer to a wall's line is on it
_SMALL_RAD = 0.3  # up to here a polynomial gives cosine and sine to 2e-9, in a fourth of NumPy's time
_EVEN = (0.5, 1.5)
"""Where the robot's turn makes the lidar's slower or faster than these shares, every beam is tested on every wall."""


class Turning:
    """How lidars of one kind turn: what their scans have in common."""

    def __init__(self, spec: LidarSpec, bearings: Floats, moments: Floats) -> None:
        """`bearings` (b,) ascend evenly, and `moments` (b,) belong to them."""
        self.beams, self.moments = len(bearings), moments
        self.mount = np.array([spec.mount_x_m, spec.mount_y_m])
        self.mount_m, self.first, self.began = math.hypot(*self.mount), float(bearings[0]), float(moments[0])
        self.step = float(bearings[-1] - bearings[0]) / (self.beams - 1)
        self.period = float(moments[-1] - moments[0]) / (self.beams - 1)
        self.cos, self.sin = np.cos(bearings), np.sin(bearings)
        self._weights: dict[int, Floats] = {}

    def weights(self, steps: int) -> Floats:
        """(steps, beams) by which values at steps of a period make those at the beams' moments (`world.way`)."""
        if steps not in self._weights:
            self._weights[steps] = np.ascontiguousarray(along(np.eye(steps), self.moments).T)
        return self._weights[steps]


class Scans:
    """Scans of some lidars of one kind, in one period."""

    def __init__(self, turning: Turning, ways: Floats) -> None:
        """`ways` (s, k, 3) as in `Lidar.trace`."""
        self._turning, self._steps, mount = turning, len(ways), turning.mount
        x, y, heading = ways.transpose(2, 1, 0)  # (k, s) each
        middle = (heading[:, 0] + heading[:, -1]) / 2
        at_x, at_y = (x.max(1) + x.min(1)) / 2, (y.max(1) + y.min(1)) / 2
        ahead, aside = np.cos(middle), np.sin(middle)
        dx, dy, turned = x - at_x[:, None], y - at_y[:, None], heading - middle[:, None]
        local = np.empty((3, *x.shape))
        local[0] = ahead[:, None] * dx + aside[:, None] * dy
        local[1] = ahead[:, None] * dy - aside[:, None] * dx
        local[2] = turned
        self.origins = np.empty((len(x), 3))
        """(k, 3) poses, world frame, of the frames in which all is done."""
        self.origins[:, 0] = at_x + ahead * mount[0] - aside * mount[1]
        self.origins[:, 1] = at_y + aside * mount[0] + ahead * mount[1]
        self.origins[:, 2] = middle
        most = np.abs(turned).max(1)
        self.half_m = np.sqrt((dx * dx + dy * dy).max(1)) + turning.mount_m * most
        """(k,) metres, how far from its origin each lidar gets."""
        beam_x, beam_y, angle = local @ turning.weights(self._steps)  # (k, beams) each
        cos, sin = _cos_sin(angle, float(most.max(initial=0.0)))
        if turning.mount_m:
            beam_x = beam_x + (cos - 1) * mount[0] - sin * mount[1]
            beam_y = beam_y + sin * mount[0] + (cos - 1) * mount[1]
        # by ray, which is robot * beams + beam
        self._x, self._y = beam_x.reshape(-1), beam_y.reshape(-1)
        self._cos = (cos * turning.cos - sin * turning.sin).reshape(-1)
        self._sin = (sin * turning.cos + cos * turning.sin).reshape(-1)

        # beam n points at first + n * step, but for `bent`: a robot turns evenly until it is told otherwise
        total = turned[:, -1] - turned[:, 0]
        even = turned[:, :1] + np.linspace(0, 1, self._steps) * total[:, None]
        self._bent = np.abs(turned - even).max(1)
        self._first = turning.first + turned[:, 0] + turning.began * total
        self._step = turning.step + turning.period * total
        share = self._step / turning.step
        self._even = (share > _EVEN[0]) & (share < _EVEN[1])

    def walls(
        self, robot: Ints, start: Floats, end: Floats, nearest: Floats, area: Floats
    ) -> tuple[Ints, Ints, Floats]:
        """Rows of walls (n, 2) from `start` to `end`, the rays that meet them, and 1 / range there.

        Each wall is in the frame of a `robot` (n,), `nearest` (n,) metres from its origin, and makes twice `area` (n,)
        with it.
        """
        bearing = np.arctan2(start[:, 1], start[:, 0])
        sweep = np.arctan2(area, start[:, 0] * end[:, 0] + start[:, 1] * end[:, 1])
        row, ray = self._rays(robot, bearing + np.minimum(sweep, 0.0), np.abs(sweep), nearest)
        along_x, along_y = end[:, 0] - start[:, 0], end[:, 1] - start[:, 1]
        ahead, aside = self._cos.take(ray), self._sin.take(ray)
        from_x, from_y = start[:, 0].take(row) - self._x.take(ray), start[:, 1].take(row) - self._y.take(ray)
        wall_x, wall_y = along_x.take(row), along_y.take(row)
        across = ahead * wall_y - aside * wall_x
        beside = ahead * from_y - aside * from_x  # the start is so far left of the beam, the end so far more `across`
        apart = from_x * wall_y - from_y * wall_x
        with np.errstate(divide="ignore", invalid="ignore"):
            found = across / apart
        flat = np.abs(area) <= (self.half_m[robot] + _ON_M) * np.hypot(along_x, along_y)
        if flat.any():  # the lidar may get onto the wall's line
            on = np.flatnonzero(flat[row])
            on = on[np.abs(apart[on]) <= _ON_M * np.hypot(wall_x[on], wall_y[on])]
            to_start = ahead[on] * from_x[on] + aside[on] * from_y[on]
            to_end = to_start + ahead[on] * wall_x[on] + aside[on] * wall_y[on]
            away = np.where(to_start * to_end <= 0, _ON_M, np.minimum(to_start, to_end))
            found[on] = 1 / away
        met = np.flatnonzero((np.abs(beside + beside + across) <= np.abs(across) + 2 * _ON_M) & (found > 0))
        return row[met], ray[met], found[met]

    def discs(self, ways: Floats, reach_m: float, own: Bools) -> tuple[Ints, Ints, Floats]:
        """Numbers of discs, the rays that meet them, and 1 / range there.

        `ways` (s, m, 3) as in `Lidar.trace`. own: (k, m) which discs are a robot's own body.
        """
        x, y, radius = ways[..., 0], ways[..., 1], ways[0, :, 2]
        mid_x, mid_y = (x.max(0) + x.min(0)) / 2, (y.max(0) + y.min(0)) / 2
        width = radius + np.sqrt(((x - mid_x) ** 2 + (y - mid_y) ** 2).max(0))
        place_x, place_y, heading = self.origins.T
        dx, dy = mid_x - place_x[:, None], mid_y - place_y[:, None]
        distance = np.hypot(dx, dy)
        robot, disc = np.nonzero(~own & (distance - width - self.half_m[:, None] <= reach_m))
        if not len(robot):
            return disc, disc, np.zeros(0)
        dx, dy, distance, width = dx[robot, disc], dy[robot, disc], distance[robot, disc], width[disc]
        half = np.arcsin(np.minimum(width / np.maximum(distance, _ON_M), 1.0))
        sweep = np.where(distance > width, 2 * half, 2 * math.pi)
        row, ray = self._rays(robot, np.arctan2(dy, dx) - heading[robot] - half, sweep, distance - width)
        moments, disc = self._turning.moments[ray % self._turning.beams], disc[row]
        of = robot[row]
        dx, dy = between(x, moments, disc) - place_x[of], between(y, moments, disc) - place_y[of]
        cos, sin = np.cos(heading)[of], np.sin(heading)[of]
        from_x, from_y = cos * dx + sin * dy - self._x[ray], cos * dy - sin * dx - self._y[ray]
        ahead = self._cos[ray] * from_x + self._sin[ray] * from_y
        beside = self._cos[ray] * from_y - self._sin[ray] * from_x
        chord = radius[disc] ** 2 - beside**2
        met = np.flatnonzero((chord >= 0) & (ahead > 0))
        return disc[met], ray[met], 1 / np.maximum(ahead[met] - np.sqrt(chord[met]), _ON_M)

    def _rays(self, robot: Ints, begin: Floats, sweep: Floats, nearest: Floats) -> tuple[Ints, Ints]:
        """All (row, ray) that may meet what lies within [begin, begin + sweep] and `nearest` metres away or farther."""
        half, beams = self.half_m[robot], self._turning.beams
        doubt = self._bent[robot] + np.arcsin(np.minimum(half / np.maximum(nearest, _ON_M), 1.0))
        step = self._step[robot]
        begin, sweep = (begin - doubt - self._first[robot]) % (2 * math.pi), sweep + 2 * doubt
        everywhere = (nearest <= half) | (sweep >= 2 * math.pi) | ~self._even[robot]
        part = np.flatnonzero(~everywhere)
        row, beam = beams_within(begin[part], sweep[part], step[part], beams)
        row = part[row]
        if len(part) < len(robot):
            whole = np.flatnonzero(everywhere)
            row = np.concatenate([row, np.repeat(whole, beams)])
            beam = np.concatenate([beam, np.tile(np.arange(beams), len(whole))])
        return row, robot[row] * beams + beam


def _cos_sin(angle: Floats, most: float) -> tuple[Floats, Floats]:
    """Cosine and sine of angles of at most so many radians, to 2e-9."""
    if most > _SMALL_RAD:
        return np.cos(angle), np.sin(angle)
    square = angle * angle
    cos = 1 - square * (1 / 2 - square * (1 / 24 - square * (1 / 720)))
    return cos, angle * (1 - square * (1 / 6 - square * (1 / 120 - square * (1 / 5040))))
