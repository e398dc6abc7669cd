"""A corner scan merged into one particle: lines fused, ends moved, corners linked, walls joined and inserted (ours)."""

import math

import numpy as np

from agent.corner_scan import NOISE_SIGMAS, NOMINAL, OCCLUSION, TELLING_HITS
from agent.geometry.lines import Record, along
from agent.kernels import kernel
from agent.mapping.association import (
    ANGLE_GATE,
    OF_TWO_WALLS,
    Gates,
    Lines,
    cost,
    is_beside,
    is_off,
    lines_of,
    overlap,
    set_line,
    walls_near,
)
from agent.mapping.edges import (
    WALL,
    add_hits,
    common_axis,
    count_hits,
    direction_sd,
    part,
    related,
    remove,
    set_end,
    set_tip,
    settle_corner,
    spread,
    take_hits,
    tip_at,
)
from agent.mapping.ends import (
    END_MARGIN_M,
    close_open_corners,
    cut_behind_partition,
    f_ends_both,
    inner_ends_give_way,
    may_meet,
    see_corner,
    see_end,
)
from agent.mapping.tentative import become_wall, cuts_corner, is_bent, take_piece, wall_probability
from protocol.arrays import Floats, Ints, Records

SAME_DIRECTION = 0.95  # cosine of 18 degrees: walls that differ more in direction are never tried as one
ALWAYS, LIKELIER, NEVER = -1.0, 0.5, 1.0  # dice: becomes a wall, or if that is likelier than not, or does not


@kernel
def merge_scan(
    edges: Records, count: int, pieces: Records, walls: Ints, dice: Floats, gates: Gates, patience: float, own: bool
) -> int:
    """Merge pieces (map frame), each with its wall as of `associate`, into a particle; returns the new count.

    `walls` (k,) is updated in place: pieces on no wall get their tentative wall, or the wall that it has become; joined
    walls are renamed. dice: (k,), a tentative wall becomes one of the map if its piece's die, in [0, 1) or ALWAYS,
    LIKELIER or NEVER, is below its probability. patience: the particle's own, as a factor. own: whether the robot saw
    the pieces itself, and not a peer.
    """
    # where all pieces become walls, nobody asks which way walls go
    axis, trust = common_axis(edges, count) if (dice != ALWAYS).any() else (0.0, 0.0)
    lines, bent = lines_of(edges, count, len(pieces), gates), np.empty(len(pieces), np.bool_)
    near = np.empty(count + len(pieces), np.int64)
    for k in range(len(pieces)):
        p = pieces[k]
        bent[k] = is_bent(p.end[1] - p.end[0], p.hits, p.residual, gates.noise)
        if walls[k] == OF_TWO_WALLS:
            continue
        if walls[k] < 0:
            if bent[k] or cuts_corner(edges, near[: walls_near(lines, count, p, gates, near)], p):
                continue
            walls[k], count = take_piece(edges, count, p, gates)
            if walls[k] >= 0 and dice[k] < wall_probability(edges[walls[k]], axis, trust, gates.noise):
                become_wall(edges[walls[k]], p, own)
                set_line(lines, edges, walls[k], gates)
            continue
        _unite_all(edges, count, lines, near, p, walls, walls[k], gates, patience)
        w = edges[walls[k]]
        if not bent[k]:
            take_hits(w, p)
            set_line(lines, edges, walls[k], gates)
        if own:
            w.own = 1
    tells = ~bent & (pieces["hits"] >= TELLING_HITS)
    for k in range(len(pieces)):
        if not _is_wall(edges, walls[k]):
            continue
        if tells[k]:
            _see_open_ends(edges, pieces, walls, k, patience)
        j = pieces[k].link[1]
        if pieces[k].label[1] == NOMINAL and _is_wall(edges, walls[j]) and (tells[k] or tells[j]):
            see_corner(edges, walls[k], walls[j], pieces[k], pieces[j], patience)
            if own:  # a peer's map cuts no wall
                count, new = cut_behind_partition(edges, count, walls[k], walls[j], pieces[k], pieces[j])
                _rename_cut(edges, new, pieces, walls)
    for e in range(count):
        if edges[e].kind == WALL and edges[e].link[1] >= 0:
            settle_corner(edges, e)
    close_open_corners(edges, count)
    return count


@kernel
def _is_wall(edges: Records, e: int) -> bool:
    """Whether a piece's record is a wall of the map."""
    return e >= 0 and edges[e].kind == WALL


@kernel
def _rename_cut(edges: Records, new: int, pieces: Records, walls: Ints) -> None:
    """Let pieces that lie on what was cut off a wall be of the new one; -1: nothing was cut."""
    for k in range(len(pieces) if new >= 0 else 0):
        if walls[k] == edges[new].twin - 1 and along(edges[new], pieces[k].x, pieces[k].y) > tip_at(edges[new], 0):
            walls[k] = new


@kernel
def _see_open_ends(edges: Records, pieces: Records, walls: Ints, k: int, patience: float) -> None:
    """Fuse what piece k shows of those ends of its wall that are no corners.

    A corner is an occlusion end where its other wall is unknown, or where one of both is known to go on.
    """
    p, e = pieces[k], walls[k]
    t = along(edges[e], p.x, p.y)
    for side in range(2):
        label, slack, face = p.label[side], p.slack[side], p.face[side]
        if label == NOMINAL:
            f = walls[p.link[side]]
            if _is_wall(edges, f) and (f == e or may_meet(edges, e, side, f)):
                continue
            label, slack = OCCLUSION, 0.0
        see_end(edges, e, side, label, t + p.end[side], slack, face, patience)


@kernel
def _unite_all(
    edges: Records, count: int, lines: Lines, near: Ints, p: Record, walls: Ints, e: int, gates: Gates, patience: float
) -> None:
    """Join wall e, of which p is a piece, and all walls on its line that p lies on, too.

    Where the joint estimate holds lines, they are joined into the one with most hits, which keeps its line: a face of
    0.16 m beside a wall of 4.2 m turned that by 2 degrees. lines: of all walls, which are kept up. near: (count,) room
    for the numbers of some.
    """
    found, k = walls_near(lines, count, p, gates, near), 0
    while k < found:
        f, k = near[k], k + 1
        if f == e or is_off(lines.rows[f], p, gates) or overlap(edges[f], p, gates) <= END_MARGIN_M:
            continue
        if overlap(edges[e], p, gates) <= END_MARGIN_M or not math.isfinite(cost(edges[f], p, gates)):
            continue
        if same_line(edges[e], edges[f], gates) and inner_ends_give_way(edges, e, f, p, patience):
            after = f + 1
            if related(edges[e]) and related(edges[f]) and edges[f].hits > edges[e].hits:
                e, f = f, e
            a, b = edges[e].link, edges[f].link
            moved = e, f, a[0], a[1], b[0], b[1]  # the corners that they shared with others, too
            _unite(edges, e, f)
            for j in moved:
                if j >= 0:
                    set_line(lines, edges, j, gates)
            for j in range(len(walls)):
                if walls[j] == f:
                    walls[j] = e
            found = walls_near(lines, count, p, gates, near)
            k = int(np.searchsorted(near[:found], after))


@kernel
def same_line(e: Record, f: Record, gates: Gates) -> bool:
    """Whether two walls may be one: each one's centroid lies on the other's line, and they go the same way.

    Where the pose errs, the way they go is not asked closely: a wall that was mapped twice would stay two.
    """
    if e.ux * f.ux + e.uy * f.uy < SAME_DIRECTION:
        return False
    if not related(e) and not related(f):
        turn = math.asin(max(-1.0, min(1.0, e.ux * f.uy - e.uy * f.ux)))
        turn_sd = math.hypot(direction_sd(e, gates.noise), direction_sd(f, gates.noise))
        if abs(turn) > ANGLE_GATE + NOISE_SIGMAS * turn_sd:
            return False
    return not is_beside(e, f, gates) and not is_beside(f, e, gates)


@kernel
def _unite(edges: Records, e: int, f: int) -> None:
    """Join wall f into wall e on the same line. Hits add up, so the better supported one keeps its line."""
    a, b = edges[e], edges[f]
    if related(a):
        count_hits(a, b.hits, along(a, b.x, b.y), spread(b))
    else:
        add_hits(a, b.hits, b.x, b.y, (b.xx, b.xy, b.yy))
    for side in range(2):
        if not f_ends_both(edges, e, f, side):
            continue  # the end of f lies inside the joint wall, and is none
        other = along(a, b.tip[side, 0], b.tip[side, 1])
        part(edges, e, side)
        set_end(a, side, b.label[side], b.slack[side], b.strength[side])
        a.conflict[side], a.bare[side] = b.conflict[side], b.bare[side]
        set_tip(a, side, other)
        g = b.link[side]
        if g >= 0:
            a.link[side], b.link[side] = g, -1
            edges[g].link[1 - side] = e
            settle_corner(edges, e if side == 1 else g)
    a.seen, a.due, a.through = max(a.seen, b.seen), max(a.due, b.due), 0.0
    a.probation, a.own = min(a.probation, b.probation), max(a.own, b.own)
    remove(edges, f)
    if related(b):
        b.twin = e + 1
