"""Scans of lidars that turn while their robots drive: each beam has a place and a direction of its own.

All is done in one frame for each scan: at the middle of the way that the lidar makes in it, along its middle heading.
There a wall covers about the beams that it would cover for a lidar that stands. Its interval is widened by what the
motion can change, and every beam in it is tested.
"""

import math

import numpy as np

from protocol.arrays import Bools, Complexes, Floats, Ints
from protocol.messages import LidarSpec
from world.lidar.beams import beams_within
from world.way import Steps, between, steps

_ON_M = 1e-9  # a beam that passes a wall's end by less than this meets it; a lidar nearer to a wall's line is on it
_SMALL_RAD = 0.3  # up to here a polynomial gives cosine and sine to 2e-9, in a fourth of NumPy's time
_EVEN = (0.5, 1.5)
"""Shares of the lidar's own turn rate between which it must stay as the robot turns; else every beam is tested on every
wall."""


class Turning:
    """How lidars of one kind turn: what their scans have in common."""

    def __init__(self, spec: LidarSpec, bearings: Floats, moments: Floats) -> None:
        """`bearings` (b,) ascend evenly, and `moments` (b,) belong to them."""
        self.beams, self.moments = len(bearings), moments
        self.mount = np.array([spec.mount_x_m, spec.mount_y_m])
        self.mount_m, self.first, self.began = math.hypot(*self.mount), float(bearings[0]), float(moments[0])
        self.step = float(bearings[-1] - bearings[0]) / (self.beams - 1)
        self.period = float(moments[-1] - moments[0]) / (self.beams - 1)
        self.pointing = np.exp(1j * bearings)
        self._steps: dict[int, tuple[Floats, Steps]] = {}

    def steps(self, count: int) -> tuple[Floats, Steps]:
        """(count, beams) weights that make values of a way at the beams' moments of so many, and their `way.steps`."""
        if count not in self._steps:
            before, after, share = made = steps(count, self.moments)
            weights, beams = np.zeros((count, self.beams)), np.arange(self.beams)
            weights[before, beams] += 1 - share
            weights[after, beams] += share
            self._steps[count] = weights, made
        return self._steps[count]


class Scans:
    """Scans of some lidars of one kind, in one period."""

    def __init__(self, turning: Turning, ways: Floats) -> None:
        """`ways` (s, k, 3) as in `Lidar.trace`."""
        self._turning, mount, count = turning, turning.mount, len(ways)
        weights, self._steps = turning.steps(count)
        middle, total = (ways[0] + ways[-1]) / 2, ways[-1, :, 2] - ways[0, :, 2]
        dx, dy, turned = np.ascontiguousarray((ways - middle).transpose(2, 1, 0))  # (k, s) each
        ahead, aside = np.cos(middle[:, 2]), np.sin(middle[:, 2])
        self._frame = complex_of(ahead, -aside)
        along_x, along_y = ahead[:, None], aside[:, None]
        local = np.array([along_x * dx + along_y * dy, along_x * dy - along_y * dx, turned])
        most = float(np.abs(turned).max(initial=0.0))
        self.origins = middle
        """(k, 3) poses, world frame, of the frames in which all is done."""
        self.half_m = np.sqrt((dx * dx + dy * dy).max(1)) + turning.mount_m * most
        """(k,) metres, how far from its origin each lidar gets."""
        x, y, angle = (local.reshape(-1, count) @ weights).reshape(3, -1, turning.beams)
        place, turn = complex_of(x, y), _turn(angle, most)
        if turning.mount_m:
            self.origins[:, 0] += ahead * mount[0] - aside * mount[1]
            self.origins[:, 1] += aside * mount[0] + ahead * mount[1]
            place += (turn - 1) * complex(*mount)
        # by ray, which is robot * beams + beam
        self._place, self._back = place.reshape(-1), (turn * turning.pointing).conj().reshape(-1)

        # beam n points at first + n * step, but for `bent`: a robot turns evenly until it is told otherwise
        even = np.arange(count) / max(count - 1, 1) - 0.5
        bent = np.abs(turned - even * total[:, None]).max(1)
        first, step = turning.first + (turning.began - 0.5) * total, turning.step + turning.period * total
        bent[(step <= _EVEN[0] * turning.step) | (step >= _EVEN[1] * turning.step)] = math.pi
        self._beam_at = np.array([first, step, bent, self.half_m])

    def walls(
        self, robot: Ints, start: Floats, end: Floats, nearest: Floats, area: Floats, length: Floats
    ) -> tuple[Ints, Ints, Floats]:
        """Rows of walls (n, 2) from `start` to `end`, the rays that may meet them, and 1 / range there.

        That is not positive where a ray misses its wall. Each wall is in the frame of a `robot` (n,), `nearest` (n,)
        metres from its origin, makes twice `area` (n,) with it, and is `length` (n,) metres long.
        """
        begins, ends = complex_of(start[:, 0], start[:, 1]), complex_of(end[:, 0], end[:, 1])
        along_wall = ends - begins
        sweep = np.arctan2(area, begins.real * ends.real + begins.imag * ends.imag)
        begin = np.arctan2(begins.imag, begins.real) + np.minimum(sweep, 0.0)
        row, beam = self._beams(robot, begin, np.abs(sweep), nearest)
        ray = (robot * self._turning.beams).take(row) + beam
        back, wall = self._back.take(ray), along_wall.take(row)
        before = begins.take(row) - self._place.take(ray)
        to_start, span = back * before, back * wall  # in the beam's own frame
        left, across, apart = to_start.imag, span.imag, (before.conj() * wall).imag
        with np.errstate(divide="ignore", invalid="ignore"):
            found = across / apart
        flat = np.abs(area) <= (self.half_m[robot] + _ON_M) * length
        if flat.any():  # the lidar may get onto the wall's line
            on = np.flatnonzero(flat[row])
            on = on[np.abs(apart[on]) <= _ON_M * length[row[on]]]
            near, far = to_start[on].real, (to_start + span)[on].real
            found[on] = 1 / np.where(near * far <= 0, _ON_M, np.minimum(near, far))
        # the start of the wall is so far left of the beam, its end so far more `across`
        found[np.flatnonzero(np.abs(left + left + across) > np.abs(across) + 2 * _ON_M)] = 0.0
        return row, ray, found

    def discs(self, ways: Floats, reach_m: float, own: Bools) -> tuple[Ints, Ints, Floats]:
        """Numbers of discs, the rays that meet them, and 1 / range there.

        `ways` (s, m, 3) as in `Lidar.trace`. own: (k, m) which discs are a robot's own body.
        """
        bodies, radius = complex_of(ways[..., 0], ways[..., 1]), ways[0, :, 2]
        middle, origins = (bodies[0] + bodies[-1]) / 2, complex_of(self.origins[:, 0], self.origins[:, 1])
        width = radius + np.abs(bodies - middle).max(0)
        offset = middle - origins[:, None]
        distance = np.abs(offset)
        robot, disc = np.nonzero(~own & (distance - width - self.half_m[:, None] <= reach_m))
        if not len(robot):
            return disc, disc, np.zeros(0)
        frame, distance, width = self._frame[robot], distance[robot, disc], width[disc]
        half = np.arcsin(np.minimum(width / np.maximum(distance, _ON_M), 1.0))
        sweep = np.where(distance > width, 2 * half, 2 * math.pi)
        seen = offset[robot, disc] * frame
        row, beam = self._beams(robot, np.arctan2(seen.imag, seen.real) - half, sweep, distance - width)
        ray, radius = (robot * self._turning.beams).take(row) + beam, radius[disc].take(row)
        places = between((bodies[:, disc] - origins[robot]) * frame, self._steps, row, beam)
        seen = (places - self._place.take(ray)) * self._back.take(ray)  # in the beam's own frame
        chord = radius * radius - seen.imag * seen.imag
        outside = seen.real * seen.real > chord
        met = np.flatnonzero((chord >= 0) & (seen.real > 0) & outside)
        away = seen.real.take(met) - np.sqrt(chord.take(met))
        return disc[row.take(met)], ray.take(met), 1 / np.maximum(away, _ON_M)

    def _beams(self, robot: Ints, begin: Floats, sweep: Floats, nearest: Floats) -> tuple[Ints, Ints]:
        """All (row, beam) that may meet what lies within [begin, begin + sweep] and `nearest` metres away or more."""
        (first, step, bent, half), beams = self._beam_at[:, robot], self._turning.beams
        doubt = bent + np.arcsin(np.minimum(half / np.maximum(nearest, _ON_M), 1.0))
        begin, sweep = (begin - doubt - first) % (2 * math.pi), sweep + 2 * doubt
        everywhere = (nearest <= half) | (sweep >= 2 * math.pi)
        if not everywhere.any():
            return beams_within(begin, sweep, step, beams)
        part, whole = np.flatnonzero(~everywhere), np.flatnonzero(everywhere)
        row, beam = beams_within(begin[part], sweep[part], step[part], beams)
        every = np.repeat(whole, beams), np.tile(np.arange(beams), len(whole))
        return np.concatenate([part[row], every[0]]), np.concatenate([beam, every[1]])


def _turn(angle: Floats, most: float) -> Complexes:
    """Unit complex numbers of angles of at most so many radians, to 2e-9."""
    if most > _SMALL_RAD:
        return complex_of(np.cos(angle), np.sin(angle))
    square = angle * angle
    cos = 1 - square * (1 / 2 - square * (1 / 24 - square * (1 / 720)))
    return complex_of(cos, angle * (1 - square * (1 / 6 - square * (1 / 120 - square * (1 / 5040)))))


def complex_of(x: Floats, y: Floats) -> Complexes:
    """x + iy, in a third of the time that NumPy takes for this sum."""
    out = np.empty(x.shape, np.complex128)
    out.real, out.imag = x, y
    return out
