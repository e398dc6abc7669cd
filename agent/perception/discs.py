"""Teammates in a scan: discs of known radius, whose beams tell nothing about walls (ours)."""

import math
from typing import NamedTuple

import numpy as np

from agent.corner_scan import NOISE_SIGMAS
from agent.kernels import kernel
from agent.perception.beams import Beams
from agent.perception.segmentation import beam_sums, fit_line
from protocol.arrays import Bools, Floats
from protocol.geometry import wrapped

# Measured on 3,600 scans of three robots (maze-15 and apartment with ideal sensing, maze-15 and office with real, 60 s
# each). Of 1,472 teammates in view 136 are missed; 5.2 discs a scan are found on anything else, most of which
# `perceive` rules out by the map (IN_WALL).
FEW_BEAMS = 3
"""Fewer beams show no disc. A circle fits so many as well as a line does; more must fit a circle better. With 4, 288
are missed."""
LEAST_ON = 0.5
"""Share of the beams inside a disc that must end on it, as something may hide the others. With a third 128 are missed
and 5.8 found on anything else, with three quarters 155 and 2.5."""
MAX_CHI2 = 4.0
"""Mean chi-square of beams on a teammate, which moves within a revolution. With 2, 147 are missed; with 8, 134, and 6.1
are found on anything else."""
INNER = 0.9
"""Share of a disc's width whose beams are asked, as those at its edge may pass it. With 0.7, 327 are missed, with
1, 92."""
NEAR = 0.1
"""Share of the radius that a range may be off a disc beside noise, as its place is a guess at first. With 0, 147 are
missed; with 0.3, 137, and 3.0 are found on anything else."""
GOES_ON = 0.5
"""Share of the radius behind a disc's front within which a beam on either side of it shows a wall that goes on. Without
this test 130 are missed, and finding discs takes 2.6 times as long."""
JUMP = 0.3
"""Share of the radius behind a disc's centre beyond which a beam beside it has passed it. From 0 to 1 as many are
missed, and 6.1 to 4.4 are found on anything else."""
MOST_PAST = 1
"""Beams inside a disc that may pass through it, as its place is known to a beam. Without this test 78 % of the views of
posts of 0.1 m from up to 2.4 m show a disc, beside which beams pass, and with it 17 %; of 2,164 teammates in view 181
are missed for 198. With 0, 276 are missed."""
ROUNDS = 3
"""Gauss-Newton steps from the first guess, which is off by half a radius at most. With 1, 135 are missed and 6.7 found
on anything else; with 6, 135 and 4.2, in 1.4 times the time."""
NEAREST = 1.05  # radii from the lidar at which a disc's centre lies at least: nearer, no ray is a tangent
WIDER = 1.001  # by this a quick test is wider than the exact one after it, against rounding


class Panorama(NamedTuple):
    """A scan in which discs are looked for, in even steps of bearing all around: beam k is the one near k steps."""

    ranges: Floats  # (n,) m, inf where nothing came back, NaN where nothing was measured
    directions: Floats  # (n, 2) cosine and sine of each beam's bearing
    noise: Floats  # (n,) m, standard deviation of each range
    step: float  # rad, from each beam to the next
    radius: float  # m, of the discs
    shift: float  # m, by which the lidar moved in the revolution


class Disc(NamedTuple):
    """Where the centre of a disc is."""

    distance: float  # m
    bearing: float  # rad


class Support(NamedTuple):
    """How well the beams inside a disc end on it."""

    beams: int  # beams well inside the disc
    on: int  # those of them that end on it
    past: int  # those that pass through it
    chi2: float  # of these, in sum
    first: int  # the first and the last of these; they may lie outside of [0, n)
    last: int


@kernel
def find_discs(beams: Beams, noise: Floats, radius: float) -> Floats:
    """Discs in a ring of beams: (d, 2) metres, centres in the robot's frame. noise: (n,) sd of the ranges.

    A disc is a run of beams that fit a circle of the radius better than a line, with a jump in range at one end, and a
    jump or another disc at the other. Far posts, wall ends and walls pass now and then: `perceive` asks the map.
    """
    scan = _evenly_spread(beams, noise, radius)
    found = np.empty((len(scan.ranges), 3))  # distance, bearing, mean chi-square
    count = 0
    for i in range(len(scan.ranges)):
        if not math.isfinite(scan.ranges[i]) or _goes_on_beside(scan, i):
            continue
        disc = Disc(scan.ranges[i] + radius, i * scan.step)
        if not _may_be(_support_of(scan, disc)):
            continue
        for _ in range(ROUNDS):
            disc = _better(scan, disc)
        support = _support_of(scan, disc)
        if (
            _may_be(support)
            and support.past <= MOST_PAST
            and support.chi2 <= MAX_CHI2 * support.on
            and not _is_line(scan, disc, support)
        ):
            count = _keep_best(found, count, disc, support.chi2 / support.on, radius)
    return _bounded(scan, found, count)


@kernel
def _evenly_spread(beams: Beams, noise: Floats, radius: float) -> Panorama:
    """The nearest of the beams at each step of bearing.

    Where parallax parts what is near from what is far no beam falls on some steps: they have the farther of both.
    """
    n = round(2 * math.pi / beams.step)
    ranges, directions, sd = np.full(n, np.nan), np.zeros((n, 2)), np.ones(n)
    taken = np.zeros(n, np.bool_)
    for i in range(len(beams.ranges)):
        k = round(beams.bearings[i] / beams.step) % n
        taken[k] = True
        if math.isnan(beams.ranges[i]) or ranges[k] <= beams.distances[i]:
            continue
        ranges[k], sd[k] = beams.distances[i], noise[i]
        directions[k, 0], directions[k, 1] = math.cos(beams.bearings[i]), math.sin(beams.bearings[i])
    for k in range(n):
        if not taken[k] and taken[k - 1]:
            after = k + 1
            while not taken[after % n]:
                after += 1
            farther = after % n if ranges[after % n] > ranges[k - 1] else k - 1
            for gap in range(k, after):
                ranges[gap % n], sd[gap % n], directions[gap % n] = ranges[farther], sd[farther], directions[farther]
    return Panorama(ranges, directions, sd, beams.step, radius, beams.shift)


@kernel
def _in_ring(k: int, n: int) -> int:
    """Beam k of n, where k may lie less than n outside; quicker than a remainder."""
    return k + n if k < 0 else k - n if k >= n else k


@kernel
def _near(scan: Panorama, k: int) -> float:
    """Metres by which the range of beam k may differ from that to a disc, if the beam is to end on it."""
    return NOISE_SIGMAS * scan.noise[k] + NEAR * scan.radius


@kernel
def _half_width(distance: float, radius: float) -> float:
    """Half the angle, radians, under which a disc is seen."""
    return math.asin(min(radius / distance, 1.0))


@kernel
def _goes_on_beside(scan: Panorama, i: int) -> bool:
    """Whether the beams beside a disc that beam i would meet end about as far: most beams end on walls, which go on."""
    r, n = scan.ranges[i], len(scan.ranges)
    beside = math.ceil(math.asin(scan.radius / (r + scan.radius)) / scan.step) + 1
    before, after = scan.ranges[(i - beside) % n], scan.ranges[(i + beside) % n]
    far, near = r + GOES_ON * scan.radius, r - _near(scan, i)
    return near <= before <= far or near <= after <= far


@kernel
def _span(scan: Panorama, disc: Disc) -> tuple[int, int]:
    """First and last beam well inside a disc; they may lie outside of [0, n)."""
    half = INNER * _half_width(disc.distance, scan.radius)
    return math.ceil((disc.bearing - half) / scan.step), math.floor((disc.bearing + half) / scan.step)


@kernel
def _off(scan: Panorama, k: int, distance: float, cb: float, sb: float) -> tuple[float, float, float]:
    """Metres by which the range of beam k exceeds that to a disc at a bearing (cosine cb, sine sb); -inf if it misses.

    With the cosine and sine of the angle from the disc's centre to the beam.
    """
    x, y = scan.directions[k, 0], scan.directions[k, 1]
    c, s = x * cb + y * sb, y * cb - x * sb
    side, radius = distance * s, scan.radius
    if c < 0 or abs(side) >= radius:
        return -math.inf, c, s
    return scan.ranges[k] - distance * c + math.sqrt(radius * radius - side * side), c, s


@kernel
def _support_of(scan: Panorama, disc: Disc) -> Support:
    """How the beams well inside a disc support it."""
    low, high = _span(scan, disc)
    cb, sb = math.cos(disc.bearing), math.sin(disc.bearing)
    on, past, chi2, first, last = 0, 0, 0.0, high + 1, low - 1
    for k in range(low, high + 1):
        beam = _in_ring(k, len(scan.ranges))
        off, _, _ = _off(scan, beam, disc.distance, cb, sb)
        if abs(off) < _near(scan, beam):
            on += 1
            chi2 += (off / scan.noise[beam]) ** 2
            first, last = min(first, k), max(last, k)
        elif off > scan.radius:
            past += 1
    return Support(high - low + 1, on, past, chi2, first, last)


@kernel
def _may_be(support: Support) -> bool:
    """Whether enough beams end on a disc, and enough of those inside it."""
    return support.on >= FEW_BEAMS and support.on >= LEAST_ON * support.beams


@kernel
def _better(scan: Panorama, disc: Disc) -> Disc:
    """One Gauss-Newton step on distance and bearing, with the two exact derivatives of the range."""
    distance, bearing = disc
    radius = scan.radius
    a11, a12, a22, b1, b2 = 1e-12, 0.0, 1e-12, 0.0, 0.0
    cb, sb = math.cos(bearing), math.sin(bearing)
    low, high = _span(scan, disc)
    for k in range(low, high + 1):
        beam = _in_ring(k, len(scan.ranges))
        off, c, s = _off(scan, beam, distance, cb, sb)
        if abs(off) <= _near(scan, beam):
            side = distance * s
            root = math.sqrt(radius * radius - side * side)
            by_distance, by_bearing = c + side * s / root, side - side * distance * c / root
            a11, a12, a22 = a11 + by_distance**2, a12 + by_distance * by_bearing, a22 + by_bearing**2
            b1, b2 = b1 + by_distance * off, b2 + by_bearing * off
    det = a11 * a22 - a12 * a12
    d_distance, d_bearing = b1 / a11, 0.0
    if det > 1e-9 * a11 * a22:
        d_distance, d_bearing = (b1 * a22 - b2 * a12) / det, (b2 * a11 - b1 * a12) / det
    distance = max(distance + max(-radius, min(radius, d_distance)), NEAREST * radius)
    return Disc(distance, bearing + max(-scan.step, min(scan.step, d_bearing)))


@kernel
def _is_line(scan: Panorama, disc: Disc, support: Support) -> bool:
    """Whether the beams on a disc, unless they are few, fit a line better."""
    size, m = support.last - support.first + 1, 0
    run, angle, sd = np.empty(size), np.empty(size), np.empty(size)
    cb, sb = math.cos(disc.bearing), math.sin(disc.bearing)
    for k in range(support.first, support.last + 1):
        beam = _in_ring(k, len(scan.ranges))
        if abs(_off(scan, beam, disc.distance, cb, sb)[0]) < _near(scan, beam):
            run[m], angle[m] = scan.ranges[beam], math.atan2(scan.directions[beam, 1], scan.directions[beam, 0])
            sd[m] = scan.noise[beam]
            m += 1
    return m > FEW_BEAMS and fit_line(beam_sums(run[:m], angle[:m], sd[:m])[m])[2] < support.chi2


@kernel
def _keep_best(found: Floats, count: int, disc: Disc, residual: float, radius: float) -> int:
    """Note a disc in found (n, 3), unless one on the same spot fits better; returns how many are noted.

    residual: its mean chi-square.
    """
    at = count
    for c in range(count):
        apart = math.hypot(
            found[c, 0] * math.cos(found[c, 1]) - disc.distance * math.cos(disc.bearing),
            found[c, 0] * math.sin(found[c, 1]) - disc.distance * math.sin(disc.bearing),
        )
        if apart < radius:
            at = c
            break
    if at == count or residual < found[at, 2]:
        found[at, 0], found[at, 1], found[at, 2] = disc.distance, disc.bearing, residual
    return max(count, at + 1)


@kernel
def _bounded(scan: Panorama, found: Floats, count: int) -> Floats:
    """(d, 2) metres, centres of those discs that end at a jump on one side, and at a jump or another disc on the other.

    A row of discs is a wall, so a disc with both ends hidden by others does not count, nor does it end another.
    """
    jump = np.zeros((count, 2), np.bool_)
    for c in range(count):
        for side in range(2):
            jump[c, side] = _jumps(scan, found[c, 0], found[c, 1], 2 * side - 1)
    kept, n_kept = np.empty((count, 2)), 0
    for c in range(count):
        distance, bearing = found[c, 0], found[c, 1]
        edge = _half_width(distance, scan.radius) + scan.step
        bounded = jump[c, 0] or jump[c, 1]
        for side in range(2):
            if bounded and not jump[c, side]:
                bounded = _on_another(scan, found, count, jump, c, bearing + (2 * side - 1) * edge)
        if bounded:
            kept[n_kept, 0], kept[n_kept, 1] = distance * math.cos(bearing), distance * math.sin(bearing)
            n_kept += 1
    return kept[:n_kept].copy()


@kernel
def _jumps(scan: Panorama, distance: float, bearing: float, side: int) -> bool:
    """Whether a beam beside a disc (side 1: left, -1: right) is clearly farther or nearer than the disc."""
    half = _half_width(distance, scan.radius)
    wider = _half_width(max(distance - scan.shift, scan.radius), scan.radius) - half  # seen from where it was taken
    edge = bearing + side * half
    for steps in range(1, 2 + math.ceil(wider / scan.step)):
        if scan.ranges[round(edge / scan.step + side * steps) % len(scan.ranges)] > distance + JUMP * scan.radius:
            return True
    beam = round(edge / scan.step + side) % len(scan.ranges)
    return scan.ranges[beam] < distance - scan.radius - _near(scan, beam)


@kernel
def _on_another(scan: Panorama, found: Floats, count: int, jump: Bools, c: int, bearing: float) -> bool:
    """Whether a bearing beside disc c meets another disc that ends at a jump itself."""
    for other in range(count):
        if other != c and (jump[other, 0] or jump[other, 1]):
            half = _half_width(found[other, 0], scan.radius)
            if abs(wrapped(bearing - found[other, 1])) <= half + scan.step:
                return True
    return False


@kernel
def hidden_beams(beams: Beams, discs: Floats, radius: float) -> Bools:
    """(n,) which beams meet one of the discs (d, 2), or pass within one beam of it."""
    out = np.zeros(len(beams.ranges), np.bool_)
    for d in range(len(discs)):
        from_x, from_y, half, slope = math.nan, math.nan, 0.0, 0.0
        for k in range(len(out)):
            x, y = discs[d, 0] - beams.origins[k, 0], discs[d, 1] - beams.origins[k, 1]
            if x != from_x or y != from_y:  # most beams are taken from the same place
                from_x, from_y = x, y
                half = math.asin(radius / max(math.hypot(x, y), WIDER * radius)) + beams.step
                slope = math.tan(WIDER * half) if half < 1.5 else math.inf
            c, s = beams.directions[k, 0], beams.directions[k, 1]
            across, ahead = c * y - s * x, c * x + s * y
            if (ahead <= 0.0 and half < 1.5) or abs(across) > slope * ahead:
                continue  # clearly beside the disc, without an angle
            out[k] |= abs(math.atan2(across, ahead)) <= half
    return out


@kernel
def beams_on(beams: Beams, expected: Floats, radius: float, margin: float) -> Bools:
    """(n,) which beams end on a disc expected at (k, 3) centre and slack (+ margin), metres, robot's frame."""
    out = np.zeros(len(beams.ranges), np.bool_)
    for d in range(len(expected)):
        x, y, reach = expected[d, 0], expected[d, 1], radius + (expected[d, 2] + margin)
        away, room = math.hypot(x, y), WIDER * reach
        for k in range(len(out)):
            r, bearing = beams.distances[k], beams.bearings[k]
            if away - room < r < away + room:  # others are off the disc at any bearing
                out[k] |= math.hypot(r * math.cos(bearing) - x, r * math.sin(bearing) - y) < reach
    return out


@kernel
def _may_stand_at(x: float, y: float, places: Floats, radius: float) -> bool:
    """Whether a point may be on the front of a teammate at one of places (k, 3), centre and slack."""
    return bool((np.hypot(places[:, 0] - x, places[:, 1] - y) <= radius + places[:, 2]).any())


@kernel
def peeping_beams(beams: Beams, hidden: Bools, teammates: Bools, places: Floats, radius: float) -> Bools:
    """(n,) which beams end on something narrower than a body, where a teammate may be.

    Of a teammate that is far off, or behind another one or a corner, too little is seen for a disc. In a crowd such
    pieces became walls, which kept the crowd together, as all came to look at them. So what stands free beside nearer
    beams on teammates (n,) is none, nor what is where one may be that is not seen itself: places (k, 3) centre and
    slack, metres. hidden: (n,) beams that are left out already.
    """
    n, out, beside = len(hidden), np.zeros(len(hidden), np.bool_), teammates.copy()
    if not teammates.any() and not len(places):
        return out
    x, y = beams.distances * np.cos(beams.bearings), beams.distances * np.sin(beams.bearings)
    far = np.where(np.isnan(beams.ranges), 0.0, beams.distances)
    seen = np.isfinite(beams.ranges) & ~hidden
    more = True
    while more:  # one may peep out behind another that does
        more = False
        for first in np.flatnonzero(seen & ~out):
            if seen[first - 1] and math.hypot(x[first] - x[first - 1], y[first] - y[first - 1]) < radius:
                continue
            end = first + 1
            while end - first < n and seen[end % n]:
                if math.hypot(x[end % n] - x[(end - 1) % n], y[end % n] - y[(end - 1) % n]) >= radius:
                    break
                end += 1
            if math.hypot(x[(end - 1) % n] - x[first], y[(end - 1) % n] - y[first]) >= 2.0 * radius:
                continue
            last, before, after = end - 1, first - 1, end
            while first - before < n and hidden[before % n] and not beside[before % n]:  # grazing a teammate
                before -= 1
            while after - end < n and hidden[after % n] and not beside[after % n]:
                after += 1
            one = beside[before % n] and far[before % n] < far[first]  # else it hides nothing of this
            other = beside[after % n] and far[after % n] < far[last % n]
            # behind something nearer that is no teammate it may go on
            free = (one or far[before % n] > far[first]) and (other or far[after % n] > far[last % n])
            middle = (first + last) // 2 % n
            if (free and (one or other)) or _may_stand_at(x[middle], y[middle], places, radius):
                more = True
                for k in range(first, end):
                    out[k % n] = beside[k % n] = True
    return out
