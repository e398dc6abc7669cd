"""Tentative walls: hits on one line that lie on no wall yet, and when they are enough to be one (ours).

A few beams over a small step, over a corner or over two faces of a post fit a line, too. Such a smear is no wall. What
is seen steadily holds the robot all the same (`joint.know_walls`), while it is in sight: among far columns, whose faces
show too few beams to be walls, wheels would turn it by 5 degrees a metre.
"""

import math

from agent.corner_scan import FRONTIER, NOMINAL, OCCLUSION, TELLING_HITS
from agent.geometry.lines import Record, above, along
from agent.kernels import kernel
from agent.mapping.association import Gates, cost, overlap
from agent.mapping.edges import (
    TENTATIVE,
    WALL,
    free_record,
    length,
    off_axis,
    related,
    scatter,
    set_end,
    set_tip,
    spread,
    squares_beside,
    take_hits,
    tip_at,
)
from agent.mapping.ends import END_MARGIN_M
from agent.mapping.slots import forget_bare
from protocol.arrays import Ints, Records

MAX_DIRECTION_SD = math.radians(5.0)
"""rad, how well a new wall's direction must be known: 3 of it are 15 degrees. With 10 degrees, smears over steps
of 5 cm became walls that were as oblique."""
STEADY = 0.5  # share of the scans in view that must have hit a new wall: posts' faces reach 0.7 to 1, smears 0.3
SMEAR_M = 0.3  # no smear over the faces of a post or over a step is longer: twice the widest that was measured
STRAIGHT_SIGMAS = 1.2
"""Root mean square distance of the hits of a short wall from its line, in standard deviations, at most. Walls show 0.6
(three beams a scan) to 1.0 (many), smears over two faces of a post of 0.1 m, from 1.5 m away, 1.3 to 1.8."""
BEND_SIGMAS, BEND_M = 2.0, 0.03
"""A wall is a smear whose hits lie on a parabola that is significant and so deep, metres: over a corner that stands out
into the room, both ends lie behind the middle. Of 20 that were turned by more than 10 degrees 16 were found so, and of
196 right ones 4, themselves 11 to 28 mm off."""
WALL_HITS = 12.0
"""Beams that a new wall must show, in one scan or over several: 0.25 m of wall from 1.2 m away, where no smear over a
step of 0.1 m fits a line. With 6, two far views of three beams, each across two faces of a turned post, made a wall."""
LONG_SCANS, LONG_SD = 10.0, math.radians(1.5)
"""Scans that must have hit a wall of fewer beams, and rad of its direction's deviation, where it is longer than a smear
and on the axis of rectilinear walls. Where noise grows with range a beam from 2.3 m counts as little as a sixteenth,
and walls of a metre that were seen past a corner for 10 s were none yet."""
AXIS_TRUST = 0.8  # agreement of directions above which walls are rectilinear; furnished layouts have over 0.95
OFF_AXIS = math.radians(10.0)  # a new wall farther off the axis of rectilinear walls is suspect; true ones are within 2
OBLIQUE_SD = math.radians(3.0)
"""rad, how well a suspect wall's direction must be known: 3 of it lie between wall and axis. A face of a post of 0.1 m
needs 44 beams (7 scans from 0.9 m), a smear over a step of 0.05 m 180, before which the step itself is seen."""
EARLY_WALL = 0.1
"""Probability that a piece is a wall which shows too few beams or is suspect: 1 of 10 was one in eight layouts."""


@kernel
def tentative_of(edges: Records, count: int, p: Record, gates: Gates) -> int:
    """The tentative wall that a piece on no wall lies on, or -1."""
    best, e = math.inf, -1
    for f in range(count):
        if edges[f].kind == TENTATIVE and math.isfinite(overlap(edges[f], p, gates)):
            chi2 = cost(edges[f], p, gates)
            if chi2 < best:
                best, e = chi2, f
    return e


@kernel
def take_piece(edges: Records, count: int, p: Record, gates: Gates) -> tuple[int, int]:
    """Take a piece on no wall into the tentative wall on its line, or a new one; its record and the new count.

    The record is -1 if the array is full. A tentative wall is no part of the map: it links to nothing, and only
    contradiction and further pieces look at it.
    """
    e = tentative_of(edges, count, p, gates)
    if e >= 0:
        n = edges[e]
        take_hits(n, p)
        if related(n):
            _count_beside(n, p)
        t = along(n, p.x, p.y)
        set_tip(n, 0, min(tip_at(n, 0), t + p.end[0]))
        set_tip(n, 1, max(tip_at(n, 1), t + p.end[1]))
        return e, count
    e, count = free_record(edges, count)
    if e >= 0:
        n = edges[e]
        n.kind, n.own, n.probation = TENTATIVE, 0, 1
        n.hits, n.x, n.y, n.ux, n.uy = p.hits, p.x, p.y, p.ux, p.uy
        n.xx, n.xy, n.yy = scatter(p)
        n.bend[0], n.bend[1] = p.bend[0], p.bend[1]
        n.seen, n.due, n.misses, n.through, n.twin = 0.0, 0.0, 0.0, 0.0, 0
        n.relative[0], n.relative[1], n.relative[2] = 0.0, 0.0, 0.0
        n.held[0], n.held[1], n.strain[0], n.strain[1] = 0, 0, 0.0, 0.0
        for side in range(2):
            set_end(n, side, OCCLUSION, 0.0, 0.0)
            forget_bare(n, side)
            n.link[side] = -1
            set_tip(n, side, p.end[side])
    return e, count


@kernel
def _count_beside(c: Record, p: Record) -> None:
    """Count how far the hits of a piece lie beside a tentative wall whose line the joint estimate holds."""
    squares = p.residual + p.hits * above(c, p.x, p.y) ** 2
    c.xx += squares * c.uy * c.uy
    c.xy -= squares * c.ux * c.uy
    c.yy += squares * c.ux * c.ux


@kernel
def is_steady(c: Record, noise: float) -> bool:
    """Whether a tentative wall is known to go some way, and is no smear.

    The hits of a smear lie beside its line by more than noise, and it comes and goes as the beams fall. From afar noise
    hides that in each scan, and all scans of a first look together show it.
    """
    if is_bent(length(c), c.hits, squares_beside(c), noise) or _bends_back(c, noise) or c.seen < STEADY * c.due:
        return False
    return bool(noise / math.sqrt(spread(c)) <= MAX_DIRECTION_SD)


@kernel
def _bends_back(c: Record, noise: float) -> bool:
    """Whether the hits of all pieces lie on a parabola that bends away from the robot, and on no line."""
    significant = c.bend[0] > BEND_SIGMAS * noise * math.sqrt(c.bend[1])
    return bool(significant and 0.25 * c.bend[0] * length(c) ** 2 > BEND_M * c.bend[1])


@kernel
def wall_probability(c: Record, axis: float, trust: float, noise: float) -> float:
    """Probability that a tentative wall is one.

    Where the walls so far are rectilinear (`common_axis`), a short oblique piece is far likelier a smear than a wall
    that is oblique. So its direction must be known well, which it is once the robot has come nearer. Hits on one line
    count together, whichever scan they come from, and a short piece is not believed for following the axis: else the
    oblique face of a post would be known by those of its views alone whose noise turns them there.
    """
    if not is_steady(c, noise):
        return 0.0
    direction_sd = noise / math.sqrt(spread(c))
    oblique = trust >= AXIS_TRUST and abs(off_axis(c, axis)) > OFF_AXIS
    is_long = length(c) > SMEAR_M and c.seen >= LONG_SCANS and direction_sd <= LONG_SD and trust >= AXIS_TRUST
    if c.hits < WALL_HITS and (oblique or not is_long):
        return EARLY_WALL
    return 1.0 if direction_sd <= OBLIQUE_SD or not oblique else EARLY_WALL


@kernel
def become_wall(wall: Record, p: Record, own: bool) -> None:
    """Make a tentative wall one of the map, which ends as its newest piece p does, or as far as all were seen."""
    wall.kind, wall.own, wall.misses, wall.through = WALL, 1 if own else 0, 0.0, 0.0
    t = along(wall, p.x, p.y)
    for side in range(2):
        if p.hits < TELLING_HITS:
            set_end(wall, side, FRONTIER, 0.0, 0.0)
            continue
        wall.slack[side] = p.slack[side]
        # a corner links two walls, and the other may still be tentative
        wall.label[side] = OCCLUSION if p.label[side] == NOMINAL else p.label[side]
        set_tip(wall, side, t + p.end[side])


@kernel
def is_bent(size: float, hits: float, squares: float, noise: float) -> bool:
    """Whether hits over `size` metres, with `squares` m2 of squared distances from their line, are a smear."""
    return size < SMEAR_M and squares > hits * (STRAIGHT_SIGMAS * noise) ** 2


@kernel
def cuts_corner(edges: Records, near: Ints, p: Record) -> bool:
    """Whether a piece is of a few beams across a known corner or step, which fit a line, too.

    It begins on one known wall and ends on the next, or, short and oblique, on one beside it that goes the same way.
    near: (n,) all walls on which it may begin or end.
    """
    short = p.end[1] - p.end[0] < SMEAR_M
    for e in near:
        a = edges[e]
        if a.kind != WALL or a.ux * p.ux + a.uy * p.uy < 0 or not _ends_on(a, p, 0):
            continue
        steps = short and min(abs(a.ux * p.uy - a.uy * p.ux), a.ux * p.ux + a.uy * p.uy) > math.sin(OFF_AXIS)
        for f in near:
            b = edges[f]
            if f == e or b.kind != WALL or b.ux * p.ux + b.uy * p.uy < 0:
                continue
            beside = steps and b.ux * a.ux + b.uy * a.uy > math.cos(OFF_AXIS)
            if (f == a.link[1] or beside) and _ends_on(b, p, 1):
                return True
    return False


@kernel
def _ends_on(wall: Record, p: Record, side: int) -> bool:
    """Whether an end of a piece lies on a wall."""
    x, y = p.x + p.end[side] * p.ux, p.y + p.end[side] * p.uy
    t = along(wall, x, y)
    on_line = abs(above(wall, x, y)) < END_MARGIN_M
    return on_line and tip_at(wall, 0) - END_MARGIN_M < t < tip_at(wall, 1) + END_MARGIN_M
