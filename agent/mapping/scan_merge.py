"""A corner scan merged into one particle: lines fused, ends moved, corners linked, walls joined and inserted."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agent.corner_scan import Record
from agent.kernels import kernel
from agent.mapping.association import Gates, cost, overlap
from agent.mapping.edges import (
    CANDIDATE,
    FRONTIER,
    NOMINAL,
    OCCLUSION,
    WALL,
    Edges,
    above,
    add_hits,
    along,
    doubt,
    join,
    length,
    line_sd,
    meet,
    new_slot,
    part,
    piece_scatter,
    remove,
    residual,
    set_tip,
    settle_corner,
    spread,
    tip_at,
)
from protocol.geometry import Pose


class MergeRules(NamedTuple):
    """Rules of a merge, as plain numbers for the kernels (agent.config.MapConfig says why)."""

    end_margin: float
    patience: float
    patience_growth: float
    confirmations: float
    max_direction_sd: float
    min_sine: float
    close_corner: float
    prolonged: float
    steady: float
    smear: float
    straight: float
    wall_hits: float
    off_axis: float
    oblique_sd: float
    axis_trust: float
    early_wall: float


@kernel
def patient_merge(rules: MergeRules, factor: float) -> MergeRules:
    """The rules of a particle that is more or less patient."""
    return MergeRules(
        rules.end_margin,
        rules.patience * factor,
        rules.patience_growth,
        rules.confirmations,
        rules.max_direction_sd,
        rules.min_sine,
        rules.close_corner,
        rules.prolonged,
        rules.steady,
        rules.smear,
        rules.straight,
        rules.wall_hits,
        rules.off_axis,
        rules.oblique_sd,
        rules.axis_trust,
        rules.early_wall,
    )


@kernel
def to_map_frame(pieces: NDArray[np.void], pose: Pose) -> NDArray[np.void]:
    """Pieces moved from the robot's frame into the map's."""
    out = pieces.copy()
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in range(len(out)):
        p = out[k]
        p.x, p.y = pose[0] + c * p.x - s * p.y, pose[1] + s * p.x + c * p.y
        p.ux, p.uy = c * p.ux - s * p.uy, s * p.ux + c * p.uy
    return out


@kernel
def _outlasted(e: Record, side: int, rules: MergeRules) -> bool:
    """Count one view against an end; true once such views outnumber what confirmed it (rule 7)."""
    e.conflict[side] += 1.0
    return e.conflict[side] > rules.patience + rules.patience_growth * min(e.strength[side], rules.confirmations)


@kernel
def _set_end(edges: Edges, k: int, side: int, label: int, t: float, slack: float) -> None:
    """Replace an end by what was seen."""
    part(edges, k, side)
    edges[k].label[side], edges[k].slack[side] = label, slack
    edges[k].conflict[side], edges[k].strength[side] = 0.0, 1.0
    set_tip(edges[k], side, t)


@kernel
def _see_end(edges: Edges, k: int, side: int, label: int, t: float, slack: float, rules: MergeRules) -> None:
    """Fuse one view of an end. All coordinates count outward here: a larger one is more wall."""
    e = edges[k]
    out = 1.0 if side == 1 else -1.0
    seen, known = out * t, out * tip_at(e, side)
    margin = rules.end_margin
    if e.label[side] == FRONTIER:
        if label == FRONTIER:
            if seen > known:
                set_tip(e, side, t)
        elif known <= seen + slack + margin:
            high = max(seen + slack, known)
            set_tip(e, side, out * max(seen, known))
            e.label[side], e.slack[side] = OCCLUSION, high - max(seen, known)
            e.strength[side], e.conflict[side] = 1.0, 0.0
        elif _outlasted(e, side, rules):
            _set_end(edges, k, side, OCCLUSION, t, slack)
        return
    reach = known + (e.slack[side] if e.label[side] == OCCLUSION else 0.0)
    if label == FRONTIER:
        if seen > reach + margin:
            if _outlasted(e, side, rules):
                _set_end(edges, k, side, FRONTIER, t, 0.0)
        elif e.label[side] == OCCLUSION and seen > known:
            set_tip(e, side, out * min(seen, reach))
            e.slack[side] = max(reach - seen, 0.0)
        return
    if seen > reach + margin or seen + slack < known - margin:
        if _outlasted(e, side, rules):
            _set_end(edges, k, side, OCCLUSION, t, slack)
        return
    e.conflict[side] = max(e.conflict[side] - 1.0, 0.0)
    if e.label[side] == OCCLUSION:  # an interval, intersected over scans (rule 3)
        low, high = max(known, seen), min(reach, seen + slack)
        if low > high:
            low = high = 0.5 * (low + high)
        set_tip(e, side, out * low)
        e.slack[side] = high - low
        e.strength[side] += 1.0


@kernel
def _corner_off(e: Record, side: int, corner: float) -> float:
    """How far beyond the known end of a wall a corner would be, metres along it; 0 where it may well be there."""
    if e.label[side] != OCCLUSION or e.strength[side] < 1.0:
        return 0.0
    beyond = (corner - tip_at(e, side)) * (1.0 if side == 1 else -1.0)
    return min(beyond, 0.0) + max(beyond - e.slack[side], 0.0)


@kernel
def _see_corner(edges: Edges, e: int, f: int, gap_e: float, gap_f: float, rules: MergeRules) -> None:
    """Fuse one view of the head of e meeting the tail of f; gaps: metres before the corner without a hit.

    A prolonged wall is a guess: a slot may open before the corner. It links what is open, and neither confirms a
    corner nor speaks against an end that lies in the gap.
    """
    sine, _, _, at_e = meet(edges[e], edges[f])
    if e == f or abs(sine) < rules.min_sine:
        return
    guess = max(gap_e, gap_f) > rules.prolonged
    if edges[e].link[1] == f and edges[f].link[0] == e:
        if not guess:
            edges[e].strength[1] += 1.0
            edges[f].strength[0] += 1.0
            edges[e].conflict[1], edges[f].conflict[0] = 0.0, 0.0
        settle_corner(edges, e)
        return
    free = True
    for k, side, at, gap in ((e, 1, at_e, gap_e), (f, 0, meet(edges[f], edges[e])[3], gap_f)):
        off = _corner_off(edges[k], side, at)
        if guess and rules.end_margin < off <= gap + rules.end_margin:
            return
        if (edges[k].link[side] >= 0 or abs(off) > rules.end_margin) and not _outlasted(edges[k], side, rules):
            free = False
    if not free:
        return
    for k, side in ((e, 1), (f, 0)):
        former = edges[k].link[side]
        if former >= 0:
            part(edges, k, side)
            doubt(edges[former])
    join(edges, e, f, 0.0 if guess else 1.0)


@kernel
def _unite(edges: Edges, e: int, f: int) -> None:
    """Join wall f into wall e on the same line: hits add up, so the better supported one keeps its line (rule 6)."""
    add_hits(edges[e], edges[f].hits, edges[f].x, edges[f].y, edges[f].xx, edges[f].xy, edges[f].yy)
    for side in range(2):
        out = 1.0 if side == 1 else -1.0
        other = along(edges[e], edges[f].tip[side, 0], edges[f].tip[side, 1])
        # an inner corner is no corner of the joint wall
        if out * other > out * tip_at(edges[e], side):
            part(edges, e, side)
            edges[e].label[side], edges[e].slack[side] = edges[f].label[side], edges[f].slack[side]
            edges[e].strength[side], edges[e].conflict[side] = (
                edges[f].strength[side],
                edges[f].conflict[side],
            )
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


@kernel
def _same_line(e: Record, f: Record, gates: Gates) -> bool:
    """Whether two walls may be one: each one's centroid lies on the other's line."""
    if e.ux * f.ux + e.uy * f.uy < 0.95:
        return False
    for a, b in ((e, f), (f, e)):
        t = along(a, b.x, b.y)
        off = abs((b.y - a.y) * a.ux - (b.x - a.x) * a.uy)
        sd = math.hypot(line_sd(a, t, gates.noise), line_sd(b, 0.0, gates.noise))
        if off > gates.offset + gates.sigmas * sd:
            return False
    return True


@kernel
def _inner_ends_give_way(edges: Edges, e: int, f: int, rules: MergeRules) -> bool:
    """Whether the ends between two walls on one line are open, or have been contradicted for long enough."""
    first, second = (e, f) if tip_at(edges[e], 1) < along(edges[e], edges[f].tip[1, 0], edges[f].tip[1, 1]) else (f, e)
    give = True
    if edges[first].label[1] == NOMINAL and not _outlasted(edges[first], 1, rules):
        give = False
    if edges[second].label[0] == NOMINAL and not _outlasted(edges[second], 0, rules):
        give = False
    return give


@kernel
def _close_open_corners(edges: Edges, count: int, gates: Gates, rules: MergeRules) -> None:
    """Link an open head and an open tail whose lines meet where both walls end."""
    for e in range(count):
        if edges[e].alive != WALL or edges[e].link[1] >= 0:
            continue
        best, winner = rules.close_corner, -1
        for f in range(count):
            if f == e or edges[f].alive != WALL or edges[f].link[0] >= 0:
                continue
            if math.hypot(edges[e].tip[1, 0] - edges[f].tip[0, 0], edges[e].tip[1, 1] - edges[f].tip[0, 1]) > 0.5:
                continue
            sine, x, y, at_e = meet(edges[e], edges[f])
            if abs(sine) < rules.min_sine:
                continue
            beyond_e = at_e - tip_at(edges[e], 1)
            beyond_f = tip_at(edges[f], 0) - along(edges[f], x, y)
            off = 0.0
            for beyond, slack in ((beyond_e, edges[e].slack[1]), (beyond_f, edges[f].slack[0])):
                off = max(off, -beyond, beyond - slack)
            if off < best:
                best, winner = off, f
        if winner >= 0:
            join(edges, e, winner, 0.0)


@kernel
def main_axis(edges: Edges, count: int) -> tuple[float, float]:
    """Direction of a particle's walls modulo a right angle, and how well they agree in it: 0 not at all, 1 all."""
    c, s, total = 0.0, 0.0, 1e-9
    for e in range(count):
        if edges[e].alive == WALL:
            angle, size = 4 * math.atan2(edges[e].uy, edges[e].ux), length(edges[e])
            c += size * math.cos(angle)
            s += size * math.sin(angle)
            total += size
    return 0.25 * math.atan2(s, c), math.hypot(c, s) / total if total > 1.0 else 0.0


@kernel
def _bent(size: float, hits: float, squares: float, gates: Gates, rules: MergeRules) -> bool:
    """Whether hits are no straight wall but a smear: few, over a small step or corner, and off their line.

    size: m; squares: m2, sum of squared distances from the line.
    """
    return size < rules.smear and squares > hits * (rules.straight * gates.noise) ** 2


@kernel
def wall_probability(c: Record, axis: float, trust: float, gates: Gates, rules: MergeRules) -> float:
    """Probability that a candidate is a wall: its direction is known, and it is no smear over a small step or corner.

    A smear's hits lie beside its line by more than noise, and it comes and goes as the beams fall. Where the walls
    so far are rectilinear, a short oblique piece is far likelier a smear than an oblique wall, so its direction
    must be known well: the robot comes nearer. Hits on one line count together, whichever scan they come from, and
    a short piece is not believed for following the axis: else the oblique face of a post would be known by those of
    its views alone whose noise turns them there.
    """
    sd = gates.noise / math.sqrt(spread(c))
    off = 4 * (math.atan2(c.uy, c.ux) - axis)
    oblique = trust >= rules.axis_trust and abs(math.atan2(math.sin(off), math.cos(off))) / 4 > rules.off_axis
    if (
        _bent(length(c), c.hits, residual(c), gates, rules)
        or c.seen < rules.steady * c.due
        or sd > rules.max_direction_sd
    ):
        return 0.0
    return 1.0 if c.hits >= rules.wall_hits and (sd <= rules.oblique_sd or not oblique) else rules.early_wall


@kernel
def _cuts_corner(edges: Edges, count: int, p: Record, rules: MergeRules) -> bool:
    """Whether a piece is of a few beams across a known corner or step, which fit a line, too.

    It begins on one known wall and ends on the next, or, short and oblique, on one beside it that goes the same way.
    """
    short = p.end[1] - p.end[0] < rules.smear
    for e in range(count):
        a = edges[e]
        if a.alive != WALL or a.ux * p.ux + a.uy * p.uy < 0 or not _reaches(a, p, 0, rules.end_margin):
            continue
        steps = short and min(abs(a.ux * p.uy - a.uy * p.ux), a.ux * p.ux + a.uy * p.uy) > math.sin(rules.off_axis)
        for f in range(count):
            b = edges[f]
            if f == e or b.alive != WALL or b.ux * p.ux + b.uy * p.uy < 0:
                continue
            beside = steps and b.ux * a.ux + b.uy * a.uy > math.cos(rules.off_axis)
            if (f == a.link[1] or beside) and _reaches(b, p, 1, rules.end_margin):
                return True
    return False


@kernel
def _reaches(e: Record, p: Record, side: int, margin: float) -> bool:
    """Whether an end of a piece is within a margin (metres) of a wall."""
    x, y = p.x + p.end[side] * p.ux, p.y + p.end[side] * p.uy
    t = along(e, x, y)
    return abs(above(e, x, y)) < margin and tip_at(e, 0) - margin < t < tip_at(e, 1) + margin


@kernel
def _candidate(edges: Edges, count: int, p: Record, gates: Gates) -> tuple[int, int]:
    """Take a piece that lies on no wall into the candidate on its line, or a new one; its record and the new count.

    The record is -1 if the array is full. A candidate is no part of the map: it links to nothing, and only
    contradiction and further pieces look at it.
    """
    best, e = math.inf, -1
    for f in range(count):
        if edges[f].alive == CANDIDATE:
            chi2 = cost(edges[f], p, gates)
            if chi2 < best and math.isfinite(overlap(edges[f], p, gates)):
                best, e = chi2, f
    xx, xy, yy = piece_scatter(p)
    if e >= 0:
        add_hits(edges[e], p.hits, p.x, p.y, xx, xy, yy)
        t = along(edges[e], p.x, p.y)
        set_tip(edges[e], 0, min(tip_at(edges[e], 0), t + p.end[0]))
        set_tip(edges[e], 1, max(tip_at(edges[e], 1), t + p.end[1]))
        return e, count
    e, count = new_slot(edges, count)
    if e >= 0:
        n = edges[e]
        n.alive, n.own, n.probation = CANDIDATE, 0, 1
        n.hits, n.x, n.y, n.ux, n.uy = p.hits, p.x, p.y, p.ux, p.uy
        n.xx, n.xy, n.yy = xx, xy, yy
        n.seen, n.due, n.misses, n.through = 0.0, 0.0, 0.0, 0.0
        for side in range(2):
            n.label[side], n.slack[side], n.link[side] = OCCLUSION, 0.0, -1
            n.strength[side], n.conflict[side] = 0.0, 0.0
            set_tip(n, side, p.end[side])
    return e, count


@kernel
def _is_wall(edges: Edges, e: int) -> bool:
    """Whether a piece's record is a wall of the map."""
    return e >= 0 and edges[e].alive == WALL


@kernel
def merge_scan(
    edges: Edges,
    count: int,
    pieces: NDArray[np.void],
    walls: NDArray[np.int64],
    dice: NDArray[np.float64],
    gates: Gates,
    rules: MergeRules,
    own: int,
) -> int:
    """Merge pieces (map frame), each associated with a wall or with -1, into a particle; returns the new count.

    own: 1 where the robot saw the pieces itself, 0 where a peer did.

    `walls` is updated in place: pieces on no wall get their candidate, or the wall that it has become; joined walls are
    renamed. dice: (k,) in [0, 1), a candidate becomes a wall if its piece's die is below its probability; 0.5 takes the
    likelier side.
    """
    axis, trust = main_axis(edges, count)
    for k in range(len(pieces)):
        p = pieces[k]
        e = walls[k]
        bent = _bent(p.end[1] - p.end[0], p.hits, p.residual, gates, rules)
        if e < 0:
            if bent or _cuts_corner(edges, count, p, rules):
                continue
            e, count = _candidate(edges, count, p, gates)
            walls[k] = e
            if e < 0 or dice[k] >= wall_probability(edges[e], axis, trust, gates, rules):
                continue
            n = edges[e]
            n.alive, n.own = WALL, own
            n.misses, n.through = 0.0, 0.0
            t = along(n, p.x, p.y)
            for side in range(2):
                n.slack[side] = p.slack[side]
                # a corner is none until its partner is known
                n.label[side] = OCCLUSION if p.label[side] == NOMINAL else p.label[side]
                set_tip(n, side, t + p.end[side])
            continue
        for f in range(count):  # a piece that lies on two walls shows that they are one
            if f == e or edges[f].alive != WALL or not math.isfinite(cost(edges[f], p, gates)):
                continue
            if min(overlap(edges[f], p, gates), overlap(edges[e], p, gates)) <= rules.end_margin:
                continue
            if _same_line(edges[e], edges[f], gates) and _inner_ends_give_way(edges, e, f, rules):
                _unite(edges, e, f)
                for j in range(len(walls)):
                    if walls[j] == f:
                        walls[j] = e
        w = edges[e]
        if not bent:
            xx, xy, yy = piece_scatter(p)
            add_hits(w, p.hits, p.x, p.y, xx, xy, yy)
        w.own = max(w.own, own)
    for k in range(len(pieces)):
        p, e = pieces[k], walls[k]
        if not _is_wall(edges, e) or _bent(p.end[1] - p.end[0], p.hits, p.residual, gates, rules):
            continue
        t = along(edges[e], p.x, p.y)
        for side in range(2):
            if p.label[side] != NOMINAL:
                _see_end(edges, e, side, p.label[side], t + p.end[side], p.slack[side], rules)
            elif not _is_wall(edges, walls[p.link[side]]):
                _see_end(edges, e, side, OCCLUSION, t + p.end[side], 0.0, rules)
        if p.label[1] == NOMINAL and _is_wall(edges, walls[p.link[1]]):
            _see_corner(edges, e, walls[p.link[1]], p.gap[1], pieces[p.link[1]].gap[0], rules)
    for e in range(count):
        if edges[e].alive == WALL and edges[e].link[1] >= 0:
            settle_corner(edges, e)
    _close_open_corners(edges, count, gates, rules)
    return count
