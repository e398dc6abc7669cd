"""Discrete faults in the walls of particles: drawn at places where the map is right, and made as if measured so.

Kinds: `false-wall` (across a free room), `missing-wall`, `moved-corner` (by 0.5 m, both walls tilt to it) and
`false-gap`. Everything is in the robot's own frame.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from agent.corner_scan import OCCLUSION
from agent.mapping.edges import EDGE, free_record, length, remove, settle_corner, spread, tip_at
from deploy.metrics import CORNER_NEAR_M, NEAR_M, Truth, distance_to
from protocol.arrays import Bools, Floats, Records
from protocol.wireframe import Label, Wireframe

AWAY_M = 0.12  # a false wall is judged only where it is farther than this from any true wall of about its direction
SAMPLE_M = 0.04  # between the samples at which a place is judged: less than the shortest wall that a filter keeps
FALSE_WALL_M = (0.8, 3.0)  # length of a false wall: from the width of a corridor to less than the lidar's range
WALL_M = (0.5, 2.5)  # length of a wall that goes missing: the whole of it can be in view
CORNER_WALL_M = (0.7, 3.5)  # length of the walls of a corner that moves: longer than the shift
CORNER_JUDGED_M = 1.0  # most that is judged of either wall of a corner
SHIFT_M = 0.5  # how far a corner moves
GAP_M = (0.2, 0.5)  # width of a false gap: less than a door, more than the filter bridges between a scan and its walls
GAP_BESIDE_M = 0.3  # wall left on each side of a gap
OFF_M = 5e-3  # points that must be seen lie this far off their wall, in free space
JUDGED_SHARE = 0.8  # middle part of a wall that is judged: its ends may hide behind its neighbours
HITS = 60.0  # beams on a false wall; true walls have some hundred in mid-run
SEEN = 20.0  # scans that hit a false wall: no wall is on probation after so many
STRENGTH = 5.0  # times that an invented end was confirmed


@dataclass(frozen=True)
class Fault:
    """A place, what is done to the walls of a particle there, and how the map is judged."""

    place: Floats  # (2,) its middle, in free space
    samples: Floats  # (s, 2) points in free space beside all that is judged
    normals: Floats  # (s, 2) towards the side from which the wall at each sample is seen; zero where there is no wall
    inject: Callable[[Records, int], int | None]
    """Spoil one particle's records (count in use) and return the new count; None where it has no such wall."""
    gone: Callable[[Wireframe], bool | np.bool_]  # whether the map agrees with the truth at the place


def _false_wall(edges: Records, truth: Truth, near: Floats, rng: np.random.Generator) -> Fault | None:
    middle = near + rng.uniform(-2.0, 2.0, 2)
    axis = truth.seen_directions[rng.integers(len(truth.seen_directions))]
    unit = np.array([-axis[1], axis[0]])  # across: square to some wall
    ahead, behind = _free(middle, unit, truth), _free(middle, -unit, truth)
    if not FALSE_WALL_M[0] <= ahead + behind <= FALSE_WALL_M[1] or min(ahead, behind) < 0.1:
        return None
    tail, head = middle - behind * unit, middle + ahead * unit
    samples = _between(tail, head)
    samples = samples[_away(samples, unit, truth.outline) > AWAY_M]
    if len(samples) < 0.5 * (ahead + behind) / SAMPLE_M:
        return None

    def inject(edges: Records, count: int) -> int | None:
        e, count = free_record(edges, count)
        if e < 0:
            return None
        wall = np.zeros(1, EDGE)[0]  # well seen from end to end
        _lie_on(wall, HITS, HITS * float(np.hypot(*(head - tail))) ** 2 / 12, tail, head)
        wall["kind"], wall["own"], wall["label"], wall["link"] = 1, 1, OCCLUSION, -1
        wall["strength"], wall["seen"], wall["due"] = STRENGTH, SEEN, SEEN
        edges[e] = wall
        return count

    return Fault(
        (tail + head) / 2,
        samples,
        np.zeros_like(samples),
        inject,
        lambda found: not _covered(samples, unit, found).any(),
    )


def _missing_wall(edges: Records, truth: Truth, near: Floats, rng: np.random.Generator) -> Fault | None:
    e = _drawn_wall(edges, truth, WALL_M, rng)
    if e is None:
        return None
    tail, head, unit, normal = _ends(edges[e])
    cut = 0.5 * (1 - JUDGED_SHARE) * (head - tail)
    judged, middle = _between(tail + cut, head - cut), (tail + head) / 2

    def inject(edges: Records, count: int) -> int | None:
        e = _same_wall(edges, count, middle, unit)
        if e is None:
            return None
        links = enumerate(edges[e]["link"].tolist())
        ends = [(k, 1 - side, int(edges[k]["probation"])) for side, k in links if k >= 0]
        remove(edges, e)
        for k, side, probation in ends:  # as if it had never been seen: its neighbours just end there
            edges[k]["label"][side], edges[k]["strength"][side] = OCCLUSION, STRENGTH
            edges[k]["probation"] = probation
        return count

    samples, normals = judged + OFF_M * normal, np.tile(normal, (len(judged), 1))
    return Fault(middle + OFF_M * normal, samples, normals, inject, lambda found: _covered(judged, unit, found).all())


def _false_gap(edges: Records, truth: Truth, near: Floats, rng: np.random.Generator) -> Fault | None:
    width = rng.uniform(*GAP_M)
    e = _drawn_wall(edges, truth, (width + 2 * GAP_BESIDE_M, 10.0), rng)
    if e is None:
        return None
    tail, head, unit, normal = _ends(edges[e])
    low = rng.uniform(GAP_BESIDE_M, float((head - tail) @ unit) - GAP_BESIDE_M - width)
    begin, end = tail + low * unit, tail + (low + width) * unit
    judged, middle = _between(begin, end), (begin + end) / 2

    def inject(edges: Records, count: int) -> int | None:
        e = _same_wall(edges, count, middle, unit)
        if e is None:
            return None
        f, count = free_record(edges, count)
        if f < 0:
            return None
        whole = edges[f] = edges[e].copy()
        for k, a, b, side in ((e, whole["tip"][0], begin, 1), (f, end, whole["tip"][1], 0)):
            w = edges[k]
            share = float((b - a) @ unit) / length(whole)
            _lie_on(w, whole["hits"] * share, spread(whole) * share**3, a, b)
            w["label"][side], w["link"][side] = OCCLUSION, -1
            w["strength"][side], w["conflict"][side], w["slack"][side] = STRENGTH, 0.0, 0.0
        before, after = whole["link"].tolist()
        if before >= 0:  # outer corners stay where the lines meet
            settle_corner(edges, before)
        if after >= 0:
            edges[after]["link"][0] = f
            settle_corner(edges, f)
        return count

    def gone(wireframe: Wireframe) -> bool:
        across = np.stack([begin - 0.05 * unit, end + 0.05 * unit])  # must lie near one wall
        return any(bool((_away(across, unit, wall[None]) < NEAR_M).all()) for wall in wireframe.segments())

    normals = np.tile(normal, (len(judged), 1))
    return Fault(middle + OFF_M * normal, judged + OFF_M * normal, normals, inject, gone)


def _moved_corner(edges: Records, truth: Truth, near: Floats, rng: np.random.Generator) -> Fault | None:
    e = _drawn_wall(edges, truth, CORNER_WALL_M, rng)
    if e is None or edges[e]["link"][1] < 0:
        return None
    f = int(edges[e]["link"][1])
    if not _is_true(edges[f], truth, CORNER_WALL_M):
        return None
    (start, corner, u, normal_e), (_, finish, v, normal_f) = _ends(edges[e]), _ends(edges[f])
    if np.hypot(*(truth.corners - corner).T).min() > NEAR_M:
        return None
    angle = rng.uniform(0, 2 * math.pi)
    moved = corner + SHIFT_M * np.array([math.cos(angle), math.sin(angle)])
    a, b = moved - start, finish - moved
    lengths = np.hypot(*a), np.hypot(*b)
    if min(lengths) < 0.3 or abs(a[0] * b[1] - a[1] * b[0]) < 0.5 * lengths[0] * lengths[1]:
        return None  # nearly straight: no corner
    middle_e = (start + corner) / 2
    before = _between(corner - min(CORNER_JUDGED_M, JUDGED_SHARE * length(edges[e])) * u, corner)
    after = _between(corner, corner + min(CORNER_JUDGED_M, JUDGED_SHARE * length(edges[f])) * v)
    false = [(_between(start, moved), a / lengths[0]), (_between(moved, finish), b / lengths[1])]
    false = [(s[_away(s, unit, truth.outline) > AWAY_M], unit) for s, unit in false]

    def inject(edges: Records, count: int) -> int | None:
        e = _same_wall(edges, count, middle_e, u)
        if e is None or edges[e]["link"][1] < 0:
            return None
        f = int(edges[e]["link"][1])
        if np.hypot(*(edges[e]["tip"][1] - corner)) > 2 * NEAR_M:
            return None
        for wall, ends in ((edges[e], (edges[e]["tip"][0], moved)), (edges[f], (moved, edges[f]["tip"][1]))):
            scale = float(np.hypot(*(ends[1] - ends[0]))) / length(wall)
            share = -tip_at(wall, 0) / length(wall)
            _lie_on(wall, wall["hits"], spread(wall) * scale**2, ends[0], ends[1], share)
        settle_corner(edges, e)
        return count

    def gone(wireframe: Wireframe) -> bool:
        nominal = wireframe.points[wireframe.labels == Label.NOMINAL]
        is_there = np.hypot(*(nominal - corner).T).min(initial=np.inf) < CORNER_NEAR_M
        walls = _covered(before, u, wireframe).all() and _covered(after, v, wireframe).all()
        return bool(is_there and walls and not any(_covered(some, unit, wireframe).any() for some, unit in false))

    inward = (normal_e + normal_f) / np.hypot(*(normal_e + normal_f))
    normals = np.vstack([np.tile(normal_e, (len(before), 1)), np.tile(normal_f, (len(after), 1))])
    return Fault(corner + OFF_M * inward, np.vstack([before, after]) + OFF_M * normals, normals, inject, gone)


KINDS = {
    "false-wall": _false_wall, "missing-wall": _missing_wall, "moved-corner": _moved_corner, "false-gap": _false_gap,
}  # fmt: skip
"""Each draws a fault from the walls in use of the best particle, the truth, and (2,) a place of the robot, which a wall
across a room is near to. None where the place drawn is unfit."""


def _lie_on(wall: np.void, hits: float, along2: float, tail: Floats, head: Floats, share: float = 0.5) -> None:
    """Put a record's line and ends from tail to head: hits whose centroid lies at that share of it, along2 in m2."""
    unit = (head - tail) / np.hypot(*(head - tail))
    wall["hits"] = hits
    wall["x"], wall["y"] = tail + share * (head - tail)
    wall["ux"], wall["uy"] = unit
    wall["xx"], wall["xy"], wall["yy"] = along2 * unit[0] ** 2, along2 * unit[0] * unit[1], along2 * unit[1] ** 2
    wall["tip"][0], wall["tip"][1] = tail, head


def _ends(wall: np.void) -> tuple[Floats, Floats, Floats, Floats]:
    """Tail, head, unit direction, and normal to the free side."""
    (tail, head), unit = np.array(wall["tip"]), np.array([wall["ux"], wall["uy"]])
    return tail, head, unit, np.array([-unit[1], unit[0]])


def _same_wall(edges: Records, count: int, point: Floats, unit: Floats) -> int | None:
    """The wall of a particle that runs through a point in a direction."""
    used = edges[:count]
    dx, dy = point[0] - used["x"], point[1] - used["y"]
    along = dx * used["ux"] + dy * used["uy"]
    off = np.abs(dy * used["ux"] - dx * used["uy"])
    tip = (used["tip"] - np.stack([used["x"], used["y"]], 1)[:, None]) @ unit
    fits = (used["kind"] == 1) & (used["ux"] * unit[0] + used["uy"] * unit[1] > 0.97) & (off < 0.05)
    fits &= (tip[:, 0] < along) & (along < tip[:, 1])
    return int(np.flatnonzero(fits)[np.argmin(off[fits])]) if fits.any() else None


def _drawn_wall(edges: Records, truth: Truth, lengths: tuple[float, float], rng: np.random.Generator) -> int | None:
    """One of the true walls of a particle."""
    e = int(rng.integers(len(edges)))
    return e if _is_true(edges[e], truth, lengths) else None


def _is_true(wall: np.void, truth: Truth, lengths: tuple[float, float]) -> bool:
    if wall["kind"] != 1 or wall["seen"] < STRENGTH or not lengths[0] <= length(wall) <= lengths[1]:
        return False
    tail, head, unit, _ = _ends(wall)
    samples = _between(tail, head)
    return bool((_away(samples, unit, truth.outline) < 0.5 * NEAR_M).all())


def _free(point: Floats, unit: Floats, truth: Truth) -> float:
    """Metres from a point to the first true wall in a direction."""
    a, along = truth.outline[:, :2] - point, truth.outline[:, 2:] - truth.outline[:, :2]
    across = unit[0] * along[:, 1] - unit[1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        away = (a[:, 0] * along[:, 1] - a[:, 1] * along[:, 0]) / across
        share = (a[:, 0] * unit[1] - a[:, 1] * unit[0]) / across
    hit = (across != 0) & (away > 0) & (share >= 0) & (share <= 1)
    return float(away[hit].min(initial=np.inf))


def _between(a: Floats, b: Floats) -> Floats:
    """(s, 2) samples from a to b, a half step from either."""
    n = max(2, math.ceil(float(np.hypot(*(b - a))) / SAMPLE_M))
    return a + ((np.arange(n) + 0.5) / n)[:, None] * (b - a)


def _away(samples: Floats, unit: Floats, walls: Floats) -> Floats:
    """(s,) metres from samples (s, 2) along a direction to the nearest wall (m, 4) alike."""
    return distance_to(samples, np.repeat(unit[None], len(samples), 0), walls)


def _covered(samples: Floats, unit: Floats, wireframe: Wireframe) -> Bools:
    """Which samples have a mapped wall alike near."""
    return _away(samples, unit, wireframe.segments()) < NEAR_M
