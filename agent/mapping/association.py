"""Which wall of a particle a piece of a scan belongs to: edges are matched, corners follow (ours).

With a wrong pose, walls are matched more safely than corners: at 0.2 m and 4 degrees of error 0 to 13 % of the walls go
wrong, and 28 to 51 % of the nearest vertices.
"""

import math
from typing import NamedTuple

import numpy as np

from agent.corner_scan import BRIDGE_M, FRONTIER, NOISE_SIGMAS, NOMINAL, piece_sd
from agent.geometry.lines import Record, above, along
from agent.kernels import kernel
from agent.mapping.edges import WALL, direction_sd, line_sd, related, shared_length, spread, tip_at
from protocol.arrays import Floats, Ints, Records

FACING = 0.7  # cosine of 46 degrees: what is turned farther is another wall, and no sine is worked out for it
OFFSET_GATE_M = 0.012
"""Distance that a wall and a piece of it may have beside noise, as real walls are not straight. A gate of 6 cm would
fuse steps of 3 to 5 cm, and the map would be torn down and rebuilt for ever."""
ANGLE_GATE = math.radians(3.0)  # the same for directions, rad
MOST_TURN = 0.5  # rad that piece and wall may differ by, however unsure their directions are
_SURELY = 1.000001 * NOISE_SIGMAS**2  # of a variance: a piece so far off a wall is, however numbers are rounded
_SIGMAS = 1.001 * NOISE_SIGMAS  # the same of standard deviations, of which sums are taken
BEST = 0.0  # die of who takes the best wall, as a single hypothesis does
GOES_ON_M = 0.1  # what goes on past an end does so for more than this: scans place ends to a few centimetres
TURNING_SIGMAS = 2.0
"""Deviations of its own noise that a piece with a corner may lie off a wall that goes on there. In `hurtado_apartment`,
five seeds, corners are 12 to 19 mm off; with the wall's own deviation in the gate, too, 16 to 47 mm."""
LOST_RAD = math.radians(2.0)  # who knows a wall's direction no better may have been pushed, and goes by any piece of it
OF_TWO_WALLS = -2
"""In place of a piece's wall: it has hits on two, and tells nothing of either. From 2.5 m away the back of a shelf and
the wall 65 mm behind it are one piece, which scan after scan moved the wall onto the shelf's back."""
UNSURE_DIRECTION = math.radians(5.0)
"""A piece whose own direction is known no better is of few beams, or was seen while the robot turned: it may be of two
faces (of a column of 0.4 m from 2 m on, of a face of 0.15 m from 0.7 m), or of any wall within reach."""
KNOWN_M = 0.025
"""Deviation up to which a robot knows where a wall is: its gate is 0.1 m then, and backs of shelves stand 65 to 115 mm
before walls."""
BESIDE_M = 1.0  # so far beyond its end, a known wall still goes by: furniture that hides a wall is no longer
BRIDGE_CHI2 = 4.0  # added to the chi-square of a piece that does not touch its wall, which is the weaker claim


class Gates(NamedTuple):
    """What an association allows for."""

    noise: float  # m, standard deviation of a range
    offset: float  # m, distance of a piece from its wall beside noise


@kernel
def _faces(e: Record, p: Record) -> bool:
    """Whether a wall and a piece go about the same way."""
    return bool(e.ux * p.ux + e.uy * p.uy >= FACING)


@kernel
def cost(e: Record, p: Record, gates: Gates) -> float:
    """Chi-square (2 degrees of freedom) of a piece p, in the map's frame, lying on the line of wall e; inf out of gate.

    Gates on the distance of the piece's centroid, scaled by noise, on direction, and on how far the wall's nearest
    point lies beside the piece's line: a short wall's own swings out, to a long piece that begins half a metre off.
    Not where the pose errs: there the last gate would refuse the very walls that put the pose right.
    """
    if not _faces(e, p):
        return math.inf
    turn = math.asin(max(-1.0, min(1.0, e.ux * p.uy - e.uy * p.ux)))
    if related(e):
        turn_sd = math.hypot(gates.noise / math.sqrt(p.spread), direction_sd(e, gates.noise))
    else:
        turn_sd = gates.noise * math.sqrt(1 / p.spread + 1 / spread(e))
    t, off = along(e, p.x, p.y), above(e, p.x, p.y)
    off_sd = math.hypot(gates.noise / math.sqrt(p.hits), line_sd(e, t, gates.noise))
    if (
        abs(turn) > min(ANGLE_GATE + NOISE_SIGMAS * turn_sd, MOST_TURN)
        or abs(off) > gates.offset + NOISE_SIGMAS * off_sd
    ):
        return math.inf
    if not related(e):
        near = min(max(t, tip_at(e, 0)), tip_at(e, 1))
        x, y = e.x + near * e.ux, e.y + near * e.uy
        near_sd = math.hypot(line_sd(e, near, gates.noise), piece_sd(p, along(p, x, y), gates.noise))
        if abs(above(p, x, y)) > gates.offset + NOISE_SIGMAS * near_sd:
            return math.inf
    return (off / (off_sd + gates.offset / NOISE_SIGMAS)) ** 2 + (turn / (turn_sd + ANGLE_GATE / NOISE_SIGMAS)) ** 2


@kernel
def _shared(e: Record, p: Record, t: float) -> float:
    """Length of a wall beside a piece whose centroid is t metres along it, metres; negative is a gap."""
    return float(min(t + p.end[1], tip_at(e, 1)) - max(t + p.end[0], tip_at(e, 0)))


@kernel
def overlap(e: Record, p: Record, gates: Gates) -> float:
    """Length that piece and wall share, metres; negative is a gap that may be bridged; -inf: they share nothing.

    Only open ends may be bridged: a corner ends its wall. Two corners that face each other are those of two walls on
    either side of a plate, unless the walls share more than they may be off. Few walls are near a piece, and this tells
    quicker than `cost` which are not: it is asked first.
    """
    if not _faces(e, p):
        return -math.inf
    t = along(e, p.x, p.y)
    tail, head = tip_at(e, 0), tip_at(e, 1)
    shared = _shared(e, p, t)
    if shared > gates.offset:
        return shared
    side = 1 if t > 0.5 * (tail + head) else 0
    if (
        e.label[side] == NOMINAL
        and p.label[1 - side] == NOMINAL
        and shared < 0.5 * min(head - tail, p.end[1] - p.end[0])
    ):
        return -math.inf
    if shared > 0:
        return shared
    bridge = BRIDGE_M
    if e.label[side] != FRONTIER:
        bridge = gates.offset + (0.0 if e.label[side] == NOMINAL else e.slack[side])
    if p.label[1 - side] == NOMINAL:
        bridge = min(bridge, gates.offset)
    return shared if -shared <= bridge else -math.inf


@kernel
def is_unsure(p: Record, noise: float) -> bool:
    """Whether a piece's own direction is not known."""
    return bool(noise > UNSURE_DIRECTION * math.sqrt(p.spread))


@kernel
def stands_before(edges: Records, count: int, e: int, p: Record, gates: Gates) -> bool:
    """Whether a piece is, or may be, of something that stands before wall e, as the back of a shelf does.

    Where a robot knows a wall to some centimetres only, both are within its gate. Taken for the wall scan after scan,
    the shelf moved the robot by what lay between the two.
    """
    return _turns_before(edges[e], p, gates) or _may_be_before(edges, count, e, p, gates)


@kernel
def _turns_before(e: Record, p: Record, gates: Gates) -> bool:
    """Whether a piece turns a corner where a wall goes on, and lies off it by more than its own noise."""
    t, off = along(e, p.x, p.y), abs(above(e, p.x, p.y))
    if off <= gates.offset + TURNING_SIGMAS * gates.noise / math.sqrt(p.hits):
        return False
    if not related(e) or direction_sd(e, gates.noise) > LOST_RAD:
        return False
    for side in range(2):
        corner = t + p.end[side]
        if p.label[side] == NOMINAL and _goes_on(e, corner):
            return True
    return False


@kernel
def _goes_on(e: Record, t: float) -> bool:
    """Whether a wall goes on to both sides of coordinate t along it."""
    return bool(tip_at(e, 0) + GOES_ON_M < t < tip_at(e, 1) - GOES_ON_M)


@kernel
def turns_where_other_goes_on(w: Record, e: Record) -> bool:
    """Whether wall w has a corner where wall e goes on, other than a corner of e that is displaced along the wall."""
    for side in range(2):
        corner = along(e, w.tip[side, 0], w.tip[side, 1])
        displaced = GOES_ON_M + NOISE_SIGMAS * e.tip_sd[side]
        is_own = e.label[side] == NOMINAL and abs(corner - tip_at(e, side)) <= displaced
        if w.label[side] == NOMINAL and _goes_on(e, corner) and not is_own:
            return True
    return False


@kernel
def _may_be_before(edges: Records, count: int, e: int, p: Record, gates: Gates) -> bool:
    """Whether an unsure piece is at an uncertain wall, and a known one that faces the same way goes by beyond its end.

    In `pal_home_w` a robot knew one end of a wall to 40 mm, the other to 6, and the back of a shelf between them showed
    a few beams: they moved the robot onto it, by 60 mm, and half of its map with it. Where nothing is known beside,
    such beams are of the wall: without far faces of columns paths in `hall` are 23 to 40 mm off, and not 15 to 30.
    """
    if not is_unsure(p, gates.noise) or not related(edges[e]):
        return False
    sd = line_sd(edges[e], along(edges[e], p.x, p.y), gates.noise)
    if sd <= KNOWN_M:
        return False
    for f in range(count):
        w = edges[f]
        if f == e or w.kind != WALL or not related(w) or not _faces(w, p):
            continue
        if shared_length(edges[e], w) > GOES_ON_M:
            continue  # the same wall once more, which such pieces bring together with it
        t = along(w, p.x, p.y)
        is_near = _shared(w, p, t) > -BESIDE_M and abs(above(w, p.x, p.y)) <= gates.offset + NOISE_SIGMAS * sd
        if is_near and line_sd(w, t, gates.noise) <= KNOWN_M:
            return True
    return False


@kernel
def is_beside(a: Record, b: Record, gates: Gates) -> bool:
    """Whether the centroid of wall b lies off the line of wall a by more than noise."""
    t = along(a, b.x, b.y)
    sd = math.hypot(line_sd(a, t, gates.noise), line_sd(b, 0.0, gates.noise))
    return bool(abs(above(a, b.x, b.y)) > gates.offset + NOISE_SIGMAS * sd)


@kernel
def _one_of(edges: Records, e: int, f: int, p: Record, gates: Gates) -> int:
    """Which of two walls a piece is of that is on both within noise: e, unless one stands before the other.

    What is behind a wall shows only beside it. A piece that goes on past the end of the one in front has hits on both,
    and lies between them: OF_TWO_WALLS. Of two on one line it is of f as `_lies_more_along` says.
    """
    uncertain = related(edges[e]) and related(edges[f])
    if not is_beside(edges[e], edges[f], gates):
        return f if _lies_more_along(edges[f], edges[e], p, 0.0 if uncertain else GOES_ON_M) else e
    if not uncertain:
        return e
    front = f if above(edges[e], edges[f].x, edges[f].y) > 0.0 else e
    shared = _shared(edges[front], p, along(edges[front], p.x, p.y))
    if shared <= GOES_ON_M:
        return e
    return OF_TWO_WALLS if p.end[1] - p.end[0] - shared > GOES_ON_M else front


@kernel
def _lies_more_along(f: Record, e: Record, p: Record, by_m: float) -> bool:
    """Whether a piece lies along wall f, more than along wall e on its line, and f has a corner before e.

    Walls on both sides of a partition became one, as the one had taken a piece of the other, or was mapped 8 cm too
    long, and then took its views. The centroid of a wall that was cut may lie in the other part: its ends tell where it
    is. by_m: metres by which it must lie more along f. With an exact pose, views of a post's short faces that lie along
    either of two alike are not told apart by less than ends err: one of them became two.
    """
    middle = along(f, 0.5 * (e.tip[0, 0] + e.tip[1, 0]), 0.5 * (e.tip[0, 1] + e.tip[1, 1]))
    side = 1 if middle > 0.5 * (tip_at(f, 0) + tip_at(f, 1)) else 0
    is_past = middle > tip_at(f, 1) if side == 1 else middle < tip_at(f, 0)
    if f.label[side] != NOMINAL or not is_past:
        return False
    return bool(_shared(f, p, along(f, p.x, p.y)) > _shared(e, p, along(e, p.x, p.y)) + by_m)


class Lines(NamedTuple):
    """What tells quickly that a piece is not on a wall, side by side in memory: records are ten times as long."""

    discs: Floats
    """(4, n) of each record: x and y of a wall's centroid, inf where it is no wall; how far from there the middle of a
    piece may be, metres, and how much farther for each metre that the piece reaches."""
    rows: Floats
    """(n, 10): direction, centroid, coordinates of both ends, how far the wall may be bridged, and the three
    coefficients of its line's variance at a coordinate."""


@kernel
def lines_of(edges: Records, count: int, more: int, gates: Gates) -> Lines:
    """The lines of `count` records, with room for `more`."""
    lines = Lines(np.zeros((4, count + more)), np.zeros((count + more, 10)))
    lines.discs[0] = math.inf
    for e in range(count):
        set_line(lines, edges, e, gates)
    return lines


@kernel
def set_line(lines: Lines, edges: Records, k: int, gates: Gates) -> None:
    """Set what is told of record k, which may have changed.

    A line's standard deviation grows by `slope` a metre from its centroid at most, so no piece off the disc is on it.
    """
    e, discs, row = edges[k], lines.discs, lines.rows[k]
    if e.kind != WALL:
        discs[0, k] = math.inf
        return
    row[0], row[1], row[2], row[3] = e.ux, e.uy, e.x, e.y
    row[4], row[5] = tip_at(e, 0), tip_at(e, 1)
    row[6] = max(BRIDGE_M, gates.offset + max(e.slack[0], e.slack[1]))
    if related(e):
        row[7], row[8], row[9] = e.relative[0], 2.0 * e.relative[1], e.relative[2]
    else:
        row[7], row[8], row[9] = gates.noise**2 / e.hits, 0.0, gates.noise**2 / spread(e)
    sd = math.sqrt(row[7])
    slope = max(math.sqrt(max(row[9], 0.0)), 0.5 * abs(row[8]) / sd)
    far = max(abs(row[4]), abs(row[5])) + row[6]
    discs[0, k], discs[1, k] = e.x, e.y
    discs[2, k], discs[3, k] = far + gates.offset + _SIGMAS * (sd + slope * far), 1.0 + _SIGMAS * slope


@kernel
def walls_near(lines: Lines, count: int, p: Record, gates: Gates, near: Ints) -> int:
    """Put into `near` which of `count` walls, rising, a piece is not far from; how many.

    Most walls are far, which a processor's branch prediction learns. Which way a wall goes it does not learn, so that
    is asked of near ones alone.
    """
    xs, ys, most, more = lines.discs[0], lines.discs[1], lines.discs[2], lines.discs[3]
    x, y, reach, found = p.x, p.y, max(-p.end[0], p.end[1]), 0
    own = _SIGMAS * gates.noise / math.sqrt(p.hits)
    for e in range(count):
        dx, dy, far = xs[e] - x, ys[e] - y, most[e] + more[e] * reach + own
        if dx * dx + dy * dy <= far * far:
            near[found] = e
            found += 1
    return found


@kernel
def is_off(row: Floats, p: Record, gates: Gates) -> bool:
    """Whether a piece is clearly no part of a wall: `overlap` or `cost` would say so, too. row: of `Lines`."""
    if row[0] * p.ux + row[1] * p.uy < FACING:
        return True
    dx, dy = p.x - row[2], p.y - row[3]
    t, off = dx * row[0] + dy * row[1], abs(dy * row[0] - dx * row[1]) - gates.offset
    if max(t + p.end[0], row[4]) - min(t + p.end[1], row[5]) > row[6]:
        return True
    variance = gates.noise**2 / p.hits + max(row[7] + t * row[8] + t * t * row[9], 0.0)
    return bool(off > 0.0 and off * off > _SURELY * variance)


@kernel
def associate(edges: Records, count: int, pieces: Records, gates: Gates, dice: Floats, seen: bool = True) -> Ints:
    """The wall of each piece, -1 where it is on none, or OF_TWO_WALLS: (k,).

    dice: (k,) in [0, 1): a piece that several walls would take is given to one of them with the probability that
    their chi-squares say; a die of exactly BEST takes the best. seen: whether a scan saw the pieces, so that one wall
    hides another; those of a layer were all seen elsewhere.
    """
    out = np.full(len(pieces), -1)
    lines, near, chi2 = lines_of(edges, count, 0, gates), np.empty(count, np.int64), np.empty(count)
    for k in range(len(pieces)):
        best, found = math.inf, walls_near(lines, count, pieces[k], gates, near)
        for j in range(found):
            e, chi2[j] = near[j], math.inf
            if is_off(lines.rows[e], pieces[k], gates):
                continue
            shared = overlap(edges[e], pieces[k], gates)
            if math.isfinite(shared) and not stands_before(edges, count, e, pieces[k], gates):
                chi2[j] = cost(edges[e], pieces[k], gates) + (0.0 if shared > 0 else BRIDGE_CHI2)
                if chi2[j] < best:
                    best, out[k] = chi2[j], e
        for j in range(found if seen else 0):
            if out[k] >= 0 and near[j] != out[k] and math.isfinite(chi2[j]):
                out[k] = _one_of(edges, out[k], near[j], pieces[k], gates)
        if dice[k] == BEST or not math.isfinite(best) or out[k] == OF_TWO_WALLS:
            continue
        total = 0.0
        for j in range(found):
            total += math.exp(-0.5 * (chi2[j] - best))
        left = dice[k] * total
        for j in range(found):
            left -= math.exp(-0.5 * (chi2[j] - best))
            if left < 0 and math.isfinite(chi2[j]):
                out[k] = near[j]
                break
    return out
