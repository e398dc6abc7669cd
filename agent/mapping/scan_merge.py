"""A corner scan merged into one particle: lines fused, ends moved, corners linked, walls joined and inserted (ours)."""

import math

from agent.corner_scan import NOMINAL, OCCLUSION
from agent.geometry.lines import Record, above, along
from agent.kernels import kernel
from agent.mapping.association import GATE_SIGMAS, Gates, cost, overlap
from agent.mapping.candidates import become_wall, cuts_corner, is_bent, main_axis, take_piece, wall_probability
from agent.mapping.edges import WALL, add_hits, line_sd, part, piece_scatter, remove, set_tip, settle_corner, tip_at
from agent.mapping.ends import END_MARGIN_M, close_open_corners, inner_ends_give_way, see_corner, see_end
from protocol.arrays import Floats, Ints, Records

SAME_DIRECTION = 0.95
"""Cosine of 18 degrees: walls that differ more in direction are never tried as one."""


@kernel
def merge_scan(
    edges: Records, count: int, pieces: Records, walls: Ints, dice: Floats, gates: Gates, patience: float, own: bool
) -> int:
    """Merge pieces (map frame), each associated with a wall or with -1, into a particle; returns the new count.

    `walls` (k,) is updated in place: pieces on no wall get their candidate, or the wall that it has become; joined
    walls are renamed. dice: (k,) in [0, 1), a candidate becomes a wall if its piece's die is below its probability;
    0.5 takes the likelier side. patience: the particle's own, as a factor. own: whether the robot saw the pieces
    itself, and not a peer.
    """
    axis, trust = main_axis(edges, count)
    for k in range(len(pieces)):
        p = pieces[k]
        bent = _is_bent_piece(p, gates.noise)
        if walls[k] < 0:
            if bent or cuts_corner(edges, count, p):
                continue
            e, count = take_piece(edges, count, p, gates)
            walls[k] = e
            if e >= 0 and dice[k] < wall_probability(edges[e], axis, trust, gates.noise):
                become_wall(edges[e], p, own)
            continue
        _unite_all(edges, count, p, walls, walls[k], gates, patience)
        w = edges[walls[k]]
        if not bent:
            xx, xy, yy = piece_scatter(p)
            add_hits(w, p.hits, p.x, p.y, xx, xy, yy)
        if own:
            w.own = 1
    for k in range(len(pieces)):
        if _is_wall(edges, walls[k]) and not _is_bent_piece(pieces[k], gates.noise):
            _see_ends(edges, pieces, walls, k, patience)
    for e in range(count):
        if edges[e].alive == WALL and edges[e].link[1] >= 0:
            settle_corner(edges, e)
    close_open_corners(edges, count)
    return count


@kernel
def _is_bent_piece(p: Record, noise: float) -> bool:
    """Whether a piece is a smear by itself."""
    return is_bent(p.end[1] - p.end[0], p.hits, p.residual, noise)


@kernel
def _is_wall(edges: Records, e: int) -> bool:
    """Whether a piece's record is a wall of the map."""
    return e >= 0 and edges[e].alive == WALL


@kernel
def _see_ends(edges: Records, pieces: Records, walls: Ints, k: int, patience: float) -> None:
    """Fuse what piece k shows of the ends of its wall. A corner whose other wall is unknown is an occlusion end."""
    p, e = pieces[k], walls[k]
    t = along(edges[e], p.x, p.y)
    for side in range(2):
        label, slack = p.label[side], p.slack[side]
        if label == NOMINAL:
            if _is_wall(edges, walls[p.link[side]]):
                continue
            label, slack = OCCLUSION, 0.0
        see_end(edges, e, side, label, t + p.end[side], slack, patience)
    if p.label[1] == NOMINAL and _is_wall(edges, walls[p.link[1]]):
        see_corner(edges, e, walls[p.link[1]], p.gap[1], pieces[p.link[1]].gap[0], patience)


@kernel
def _unite_all(edges: Records, count: int, p: Record, walls: Ints, e: int, gates: Gates, patience: float) -> None:
    """Join into wall e all walls on its line that its piece p lies on, too."""
    for f in range(count):
        if f == e or edges[f].alive != WALL or not math.isfinite(cost(edges[f], p, gates)):
            continue
        if min(overlap(edges[f], p, gates), overlap(edges[e], p, gates)) <= END_MARGIN_M:
            continue
        if _same_line(edges[e], edges[f], gates) and inner_ends_give_way(edges, e, f, patience):
            _unite(edges, e, f)
            for j in range(len(walls)):
                if walls[j] == f:
                    walls[j] = e


@kernel
def _same_line(e: Record, f: Record, gates: Gates) -> bool:
    """Whether two walls may be one: each one's centroid lies on the other's line."""
    if e.ux * f.ux + e.uy * f.uy < SAME_DIRECTION:
        return False
    for a, b in ((e, f), (f, e)):
        sd = math.hypot(line_sd(a, along(a, b.x, b.y), gates.noise), line_sd(b, 0.0, gates.noise))
        if abs(above(a, b.x, b.y)) > gates.offset + GATE_SIGMAS * sd:
            return False
    return True


@kernel
def _unite(edges: Records, e: int, f: int) -> None:
    """Join wall f into wall e on the same line. Hits add up, so the better supported one keeps its line."""
    add_hits(edges[e], edges[f].hits, edges[f].x, edges[f].y, edges[f].xx, edges[f].xy, edges[f].yy)
    for side in range(2):
        outward = 1.0 if side == 1 else -1.0
        other = along(edges[e], edges[f].tip[side, 0], edges[f].tip[side, 1])
        if outward * other <= outward * tip_at(edges[e], side):
            continue  # the corner of f lies inside the joint wall, and is none
        part(edges, e, side)
        edges[e].label[side], edges[e].slack[side] = edges[f].label[side], edges[f].slack[side]
        edges[e].strength[side], edges[e].conflict[side] = edges[f].strength[side], edges[f].conflict[side]
        set_tip(edges[e], side, other)
        g = edges[f].link[side]
        if g >= 0:
            edges[f].link[side] = -1
            edges[e].link[side] = g
            edges[g].link[1 - side] = e
            settle_corner(edges, e if side == 1 else g)
    edges[e].seen = max(edges[e].seen, edges[f].seen)
    edges[e].due = max(edges[e].due, edges[f].due)
    edges[e].probation = min(edges[e].probation, edges[f].probation)
    edges[e].own = max(edges[e].own, edges[f].own)
    edges[e].through = 0.0
    remove(edges, f)
