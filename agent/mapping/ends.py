"""What is known of the ends of walls: labels, intervals of occlusion ends, and corners that link two walls (ours).

An occlusion end is an interval, from the last hit to where the next ray would have met the wall, intersected over
scans. What was confirmed often is changed only by as many more views, else distant views undo what near ones closed.
"""

import math

import numpy as np

from agent.corner_scan import FRONTIER, NOMINAL, OCCLUSION
from agent.geometry.lines import MIN_CORNER_SINE, Record, along, meet
from agent.kernels import kernel
from agent.mapping.edges import (
    CONFIRMATIONS,
    MIN_WALL_M,
    WALL,
    cut_out,
    doubt,
    free_record,
    has_slot,
    join,
    length,
    may_hide_slot,
    part,
    set_end,
    set_tip,
    settle_corner,
    tip_at,
)
from agent.mapping.slots import see_bare, show_slot
from protocol.arrays import Records

END_MARGIN_M = 0.04  # views of one end agree within this: the distance of two beams at 2.3 m, or 4 sd of a range
PATIENCE = 3.0  # views against an end before it changes: 6 % of labels are wrong, seldom three of one end
PATIENCE_GROWTH = 0.3  # further views that are needed for each view that confirmed the end, up to CONFIRMATIONS views
CLOSE_CORNER_M = 0.06  # two open ends this near to where their walls meet form that corner
ELSEWHERE_M = 1.0
"""Metres before a known end from which an end that is seen is another one. A few views in a hundred end by mistake, and
they were held against the corner of a wall 45 m away until that was cut down to what was in sight. Where the rest of a
wall is missing, scans see through it."""
PROLONGED_M = 0.1
"""A corner is a guess where its wall had no hit nearer to it than this: beams are 6 cm apart at the lidar's range, and
slots between furniture and wall are wider."""
ENDS_ON_AFTER = 5.0
"""Views that show a wall to end on another one, before that is cut in two there: a partition stands against it, and
what goes on behind is another wall. Three of 60 maps of maze-15 had a wall through the end of a partition, and a robot
in tb3_dqn_stage4 never looked behind one (recall 0.967)."""
PARTITION_M = 0.6
"""Length of such a partition, at least. Furniture is shorter, and stands before walls that do go on. With these cut at
sides of 0.1 to 0.5 m, and joined again soon after, robots took a sixth more time in furnished layouts."""
STRAY_M = 0.2
"""Metres beyond a corner within which an open end is the same end. Walls in `hall` and in two furnished layouts stood
twice on one line, over up to 6 m, as one ended 0.05 to 0.14 m beyond the other's corner, and no scan passed that."""
NEAR_TAIL_M = 0.5  # open ends farther apart than this are not tried as a corner


@kernel
def outlasted(e: Record, side: int, patience: float) -> bool:
    """Count one view against an end; true once such views outnumber what confirmed it. patience: a factor."""
    e.conflict[side] += 1.0
    return bool(e.conflict[side] > PATIENCE * patience + PATIENCE_GROWTH * min(e.strength[side], CONFIRMATIONS))


@kernel
def see_end(
    edges: Records, k: int, side: int, label: int, t: float, slack: float, face: float, patience: float
) -> None:
    """Fuse one view of an open end: its label, its coordinate t along wall k, and its slack, metres.

    face: metres before t that may be of a small face beyond the corner: the view moves a known end outward only as
    far as is sure.
    """
    e, was = edges[k], edges[k].label[side]
    outward = 1.0 if side == 1 else -1.0
    seen, known = outward * t, outward * tip_at(e, side)  # coordinates that count outward: a larger one is more wall
    reach = known + (e.slack[side] if was == OCCLUSION else 0.0)
    too_long = was != FRONTIER and seen > reach + END_MARGIN_M
    too_short = label != FRONTIER and seen + slack + END_MARGIN_M < known
    if too_short and seen + slack + ELSEWHERE_M < known:
        return
    if too_long or too_short:
        if outlasted(e, side, patience):
            if too_short and label == OCCLUSION and _may_end_at_slot(edges, k, side):
                show_slot(e, side, known - seen, slack)
            part(edges, k, side)
            set_end(e, side, label, slack, 1.0)
            set_tip(e, side, t)
    elif label == FRONTIER:  # the wall goes on at least as far as this
        if was != NOMINAL and seen > known and e.held[side] == 0:
            set_tip(e, side, t if was == FRONTIER else outward * min(seen, reach))
            e.slack[side] = max(reach - seen, 0.0)
    elif was == FRONTIER:
        low = max(seen, known)
        set_tip(e, side, outward * low)
        set_end(e, side, OCCLUSION, max(seen + slack, known) - low, 1.0)
    else:
        e.conflict[side] = max(e.conflict[side] - 1.0, 0.0)
        if was == OCCLUSION:
            low, high = max(known, seen - face), min(reach, seen + slack)
            if low > high:
                low = high = 0.5 * (low + high)
            if e.held[side] == 1:  # its middle is where the joint estimate has it
                middle, half = 0.5 * (known + reach), 0.5 * (high - low)
                low, high = middle - half, middle + half
            set_tip(e, side, outward * low)
            e.slack[side] = high - low
            e.strength[side] += 1.0


@kernel
def _may_end_at_slot(edges: Records, k: int, side: int) -> bool:
    """Whether an end of wall k is a corner beside which a slot may be."""
    f = edges[k].link[side]
    return f >= 0 and (may_hide_slot(edges[k], edges[f]) if side == 1 else may_hide_slot(edges[f], edges[k]))


@kernel
def may_meet(edges: Records, e: int, side: int, f: int) -> bool:
    """Whether an end of wall e and the other end of wall f may be a corner, by how the two turn and where they end.

    Walls that turn by less share a corner in published maps only (`blunt_corners`).
    """
    turns = abs(meet(edges[e], edges[f])[0]) >= MIN_CORNER_SINE
    return turns and not _ends_elsewhere(edges[e], side, edges[f]) and not _ends_elsewhere(edges[f], 1 - side, edges[e])


@kernel
def _ends_elsewhere(e: Record, side: int, f: Record) -> bool:
    """Whether an end of wall e is known to lie so far beyond where the line of wall f meets it that no corner is there.

    What stands close before a long wall, such as the side of a cabinet, seems to form a corner with it.
    """
    corner = meet(e, f)[1]
    beyond = tip_at(e, side) - corner if side == 1 else corner - tip_at(e, side)
    return bool(beyond > ELSEWHERE_M)


@kernel
def see_corner(edges: Records, e: int, f: int, p: Record, q: Record, patience: float) -> None:
    """Fuse one view of the head of e meeting the tail of f, which pieces p and q show.

    A wall prolonged over a gap is a guess, as a slot may open before the corner. A guess links open ends, and neither
    confirms a corner nor speaks against an end that lies in the gap. Where all views together show a slot, none joins.
    """
    if e == f or not may_meet(edges, e, 1, f):
        return
    at_e = meet(edges[e], edges[f])[1]
    gap_e, gap_f = p.gap[1], q.gap[0]
    guess = max(gap_e, gap_f) > PROLONGED_M
    linked, slot = edges[e].link[1] == f and edges[f].link[0] == e, has_slot(edges, e, f)
    if (linked or slot) and may_hide_slot(edges[e], edges[f]):
        see_bare(edges[e], 1, gap_e, p.apart[1], p.bearing[1])
        see_bare(edges[f], 0, gap_f, q.apart[0], q.bearing[0])
    if linked:
        if not guess:
            for k, side in ((e, 1), (f, 0)):
                set_end(edges[k], side, NOMINAL, 0.0, edges[k].strength[side] + 1.0)
        settle_corner(edges, e)
        return
    if slot:
        return
    free = True
    for k, side, at, gap in ((e, 1, at_e, gap_e), (f, 0, meet(edges[f], edges[e])[1], gap_f)):
        off = _corner_off(edges[k], side, at)
        if guess and END_MARGIN_M < off <= gap + END_MARGIN_M:
            return
        if (edges[k].link[side] >= 0 or abs(off) > END_MARGIN_M) and not outlasted(edges[k], side, patience):
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
def cut_behind_partition(edges: Records, count: int, e: int, f: int, p: Record, q: Record) -> tuple[int, int]:
    """Cut one of two walls in two where the other one ends on it, and let them share the corner that p and q show.

    A view that the partition hides from the rest of the wall behind it joined both: a short gap with nothing to be seen
    in it was taken for wall. A guess cuts nothing. Returns the new count, and the number of the new wall, or -1.
    """
    turns, guess = abs(meet(edges[e], edges[f])[0]) >= MIN_CORNER_SINE, max(p.gap[1], q.gap[0]) > PROLONGED_M
    if not turns or guess or free_record(edges, count)[0] < 0:
        return count, -1
    for long, short, side in ((f, e, 0), (e, f, 1)):  # side: at which the long one goes on past the corner
        corner, at = meet(edges[long], edges[short])[1], meet(edges[short], edges[long])[1]
        before = (corner - tip_at(edges[long], 1 - side)) * (1.0 if side == 1 else -1.0)
        if not _ends_elsewhere(edges[long], side, edges[short]) or before < MIN_WALL_M:
            continue
        if _ends_on(edges[short], 1 - side, at):
            new, count = cut_out(edges, count, long, corner, corner)
            join(edges, e, new if side == 0 else f, 1.0)
            return count, new
    return count, -1


@kernel
def _ends_on(e: Record, side: int, corner: float) -> bool:
    """Whether a partition has an open end, as views have shown often, where its line meets another wall's."""
    if e.label[side] != OCCLUSION or e.link[side] >= 0 or e.strength[side] < ENDS_ON_AFTER:
        return False
    if length(e) < PARTITION_M:
        return False
    return abs(_corner_off(e, side, corner)) <= END_MARGIN_M


@kernel
def _corner_off(e: Record, side: int, corner: float) -> float:
    """How far beyond the known end of a wall a corner would be, metres along it; 0 where it may well be there."""
    if e.label[side] != OCCLUSION or e.strength[side] < 1.0:
        return 0.0
    beyond = (corner - tip_at(e, side)) * (1.0 if side == 1 else -1.0)
    return min(beyond, 0.0) + max(beyond - e.slack[side], 0.0)


@kernel
def inner_ends_give_way(edges: Records, e: int, f: int, p: Record, patience: float) -> bool:
    """Whether the ends that two walls on one line would lose, were they one, are open or contradicted for long enough.

    A piece p of both speaks against a corner that lies on the other wall only where it passes it.
    """
    give = True
    for side in range(2):
        k, other = (e, f) if f_ends_both(edges, e, f, side) else (f, e)
        if edges[k].label[side] != NOMINAL:
            continue
        if _is_short_of(edges[k], side, edges[other], p) or not outlasted(edges[k], side, patience):
            give = False
    return give


@kernel
def f_ends_both(edges: Records, e: int, f: int, side: int) -> bool:
    """Whether two walls on one line, were they one, would end as wall f does: the end farther out is that of both.

    An open end just beyond a corner is a view of the same end that went astray: the corner stays. That of the two with
    each other is none, and ends of short walls are near to each other whatever they are.
    """
    beyond = along(edges[e], edges[f].tip[side, 0], edges[f].tip[side, 1]) - tip_at(edges[e], side)
    outward = beyond if side == 1 else -beyond
    at_corner, may_stray = _ends_at_corner(edges[f], side, e), min(length(edges[e]), length(edges[f])) > STRAY_M
    if may_stray and abs(outward) <= STRAY_M and at_corner != _ends_at_corner(edges[e], side, f):
        return at_corner
    return bool(outward > 0.0)


@kernel
def _ends_at_corner(e: Record, side: int, other: int) -> bool:
    """Whether a wall ends at a corner, of another wall than that one."""
    return bool(e.label[side] == NOMINAL and e.link[side] != other)


@kernel
def _is_short_of(e: Record, side: int, f: Record, p: Record) -> bool:
    """Whether an end of wall e lies on wall f, and a piece does not go on past it."""
    at_f = along(f, e.tip[side, 0], e.tip[side, 1])
    beyond = along(e, p.x, p.y) + p.end[side] - tip_at(e, side)
    return bool(tip_at(f, 0) < at_f < tip_at(f, 1) and (beyond if side == 1 else -beyond) <= END_MARGIN_M)


@kernel
def close_open_corners(edges: Records, count: int) -> None:
    """Link an open head and an open tail whose lines meet where both walls end."""
    tails = np.empty(count, np.int64)
    found = 0
    for f in range(count):
        if edges[f].kind == WALL and edges[f].link[0] < 0:
            tails[found] = f
            found += 1
    for e in range(count):
        if edges[e].kind != WALL or edges[e].link[1] >= 0:
            continue
        best, winner = CLOSE_CORNER_M, -1
        for f in tails[:found]:
            if f == e or edges[f].link[0] >= 0:
                continue
            off = _ends_off_corner(edges[e], edges[f])
            if off < best and not has_slot(edges, e, f):
                best, winner = off, f
        if winner >= 0:
            join(edges, e, winner, 0.0)


@kernel
def _ends_off_corner(e: Record, f: Record) -> float:
    """How far the head of e or the tail of f is from where their lines meet, metres; inf where they form no corner."""
    if math.hypot(e.tip[1, 0] - f.tip[0, 0], e.tip[1, 1] - f.tip[0, 1]) > NEAR_TAIL_M:
        return math.inf
    sine, at_e = meet(e, f)
    if abs(sine) < MIN_CORNER_SINE:
        return math.inf
    beyond_e = at_e - tip_at(e, 1)
    beyond_f = tip_at(f, 0) - along(f, e.x + at_e * e.ux, e.y + at_e * e.uy)
    return max(0.0, -beyond_e, beyond_e - e.slack[1], -beyond_f, beyond_f - f.slack[0])
