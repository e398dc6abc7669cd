"""What a scan says against the walls of a particle: seen through, not seen where they should be, overlaid (ours).

A wall that was wrongly added often lies in solid behind the true one. So views count from both sides, and what was
cut, unlinked or overlaid goes on probation: a few scans that should see it and do not remove it.
"""

import math

import numpy as np

from agent.corner_scan import BRIDGE_M, FRONTIER
from agent.geometry.lines import Record, above, along
from agent.kernels import kernel
from agent.mapping.association import OF_TWO_WALLS
from agent.mapping.bodies import Bodies, is_front, seen_teammates
from agent.mapping.edges import (
    CONFIRMATIONS,
    FREE,
    MIN_WALL_M,
    TENTATIVE,
    cut_out,
    doubt,
    keep_share,
    open_end,
    part,
    put_on_probation,
    related,
    remove,
    tip_at,
)
from agent.mapping.views import STEP_M, THROUGH, UNSEEN, Samples, View, in_reach, look_at_wall, samples_along
from protocol.arrays import Bools, Ints, Records

SIDE_BY_SIDE = 0.5  # cosine of 60 degrees: of two walls that meet at less, one is wrong; buildings turn by 90
BESIDE_OVERLAP_M = 0.15
"""Two walls that share a place run side by side from there if they overlap by more; twice the reach of a corner."""
CUT_AFTER = 3.0  # scans that see through the same part of a wall before it is cut out
SHOWN_SHARE = 0.75
"""Share of a wall that must be left for it to be the same one, only shorter, and shown on. One of 1 m, hit by 450
scans, was shown no more, as it had been 0.13 m too long, and the way back to it had been given up."""
DROP_AFTER = 8.0  # scans in a row that should have hit a wall on probation and did not, before it is removed
DROP_GROWTH = 0.3  # further scans for each that hit a wall which has left probation, up to CONFIRMATIONS hits
SURE_AFTER = 4.0  # scans that hit a wall before it leaves probation


@kernel
def contradict(edges: Records, count: int, view: View, walls: Ints, bodies: Bodies, patience: float) -> int:
    """Count what a merged scan says for and against every wall, and cut or remove those refuted; returns the count.

    walls: (k,) the wall of each of the view's pieces, as of `associate`. bodies: where teammates are. patience: the
    particle's own, as a factor.
    """
    hit = np.zeros(len(edges), np.bool_)
    for k in range(len(walls)):
        if walls[k] >= 0:
            hit[walls[k]] = True
    teammates, reach = seen_teammates(bodies, view.pose), bodies.radius + view.margin
    for e in range(count):
        w = edges[e]
        if w.kind == FREE:
            continue
        if not in_reach(w, view):
            if w.kind == TENTATIVE:
                remove(edges, e)  # a tentative wall has to become one of the map while the robot passes once
            continue
        samples = samples_along(w, STEP_M)
        visible, on, low, high = _views_of(e, w, samples, view, walls)
        refuted = on == 0 and (
            is_front(edges, e, teammates, reach) or visible >= 2 or _usurped(edges, count, e, hit, view.margin)
        )
        if _missed_too_often(w, on, refuted, patience):
            remove(edges, e)
        elif low > high:  # no sample was seen through
            if on > 0 and w.through > 0.0 and 2 * on > samples.number:
                w.through -= 1.0
        else:
            low, high = _count_gap(w, low, high, samples.spacing)
            if w.through >= CUT_AFTER * patience - w.probation:
                count = _cut_gap(edges, count, e, low, high, samples)
    return count


@kernel
def _views_of(e: int, wall: Record, samples: Samples, view: View, walls: Ints) -> tuple[int, int, float, float]:
    """Hold all samples of a wall against a scan.

    Returns how many the scan would have shown a wall at, and showed this wall at; and where along the wall, metres,
    the first and the last lie that it saw through (inf and -inf if none).
    """
    low, high, visible, on = math.inf, -math.inf, 0, 0
    for j in range(samples.number):
        t = samples.first + j * samples.spacing
        saw, piece, faces = look_at_wall(wall, t, view)
        if saw == UNSEEN or (piece >= 0 and walls[piece] == OF_TWO_WALLS):
            continue
        if saw == THROUGH:  # counts from behind, too: no robot stands in solid
            low, high = min(low, t), max(high, t)
        if faces:
            visible += 1
            on += saw != THROUGH and walls[piece] == e  # else another wall stands in its place
    if on == 0:  # a short piece has no beam well inside its ends, and no sample meets it
        for k in range(len(walls)):
            if walls[k] == e:
                on, visible = 1, max(visible, 1)
    return visible, on, low, high


@kernel
def _usurped(edges: Records, count: int, e: int, hit: Bools, margin: float) -> bool:
    """Whether a wall begins or ends on one that is hit, and the two run side by side while they part slowly.

    The solid behind one would lie in the free space of the other: a corner has one wall in and one out (paper III-A).
    Such a wall often lies behind the true one, where no view speaks against it. Square walls stay, since rooms and
    partitions meet so, and so does a wall that begins where the other ends.
    """
    w = edges[e]
    for side in range(2):
        x, y = w.tip[side, 0], w.tip[side, 1]
        for k in range(count):
            v = edges[k]
            if not hit[k] or v.probation == 1 or v.ux * w.ux + v.uy * w.uy < SIDE_BY_SIDE:
                continue
            t, low, high = along(v, x, y), tip_at(v, 0), tip_at(v, 1)
            beside = high - t if side == 0 else t - low
            if not low - _unseen(v, 0, margin) < t < high + _unseen(v, 1, margin):
                continue
            if abs(above(v, x, y)) > 2 * margin or beside < BESIDE_OVERLAP_M:
                continue
            if abs(above(v, w.tip[1 - side, 0], w.tip[1 - side, 1])) > 2 * margin:
                return True
    return False


@kernel
def _unseen(wall: Record, side: int, margin: float) -> float:
    """Metres beyond an end up to which a wall may go on: where the pose errs, past a frontier as far as is bridged.

    The far end of a wall is seen last. Until then the false wall that began there stayed behind it.
    """
    return max(2 * margin, BRIDGE_M if wall.label[side] == FRONTIER and related(wall) else 0.0)


@kernel
def _missed_too_often(wall: Record, on: int, refuted: bool, patience: float) -> bool:
    """Count a scan that hit a wall or should have; true once misses in a row outweigh what confirmed it."""
    if refuted or on > 0:
        wall.due += 1.0
    if on > 0:
        wall.seen += 1.0
        wall.misses = 0.0
        if wall.seen >= SURE_AFTER and wall.through == 0.0:
            wall.probation = 0
    elif refuted:
        wall.misses += 1.0
    sure = 0.0 if wall.probation == 1 else min(wall.seen, CONFIRMATIONS)
    return bool(wall.misses >= DROP_AFTER * patience + DROP_GROWTH * sure)


@kernel
def _count_gap(wall: Record, low: float, high: float, spacing: float) -> tuple[float, float]:
    """Count a scan that saw through [low, high] of a wall; returns that part with what earlier scans saw through.

    A part that does not touch the earlier one begins a new count.
    """
    one, two = along(wall, wall.gap[0, 0], wall.gap[0, 1]), along(wall, wall.gap[1, 0], wall.gap[1, 1])
    if wall.through > 0.0 and min(max(one, two), high) >= max(min(one, two), low) - spacing:
        low, high = min(low, one, two), max(high, one, two)
        wall.through += 1.0
    else:
        wall.through = 1.0
    wall.gap[0, 0], wall.gap[0, 1] = wall.x + low * wall.ux, wall.y + low * wall.uy
    wall.gap[1, 0], wall.gap[1, 1] = wall.x + high * wall.ux, wall.y + high * wall.uy
    return low, high


@kernel
def _cut_gap(edges: Records, count: int, e: int, low: float, high: float, samples: Samples) -> int:
    """Cut the part between two samples out of a wall, to its end if the sample is the last; returns the new count."""
    half, tail, head = 0.5 * samples.spacing, tip_at(edges[e], 0), tip_at(edges[e], 1)
    if low <= samples.first + half:
        low = tail
    if high >= samples.first + (samples.number - 1.5) * samples.spacing:
        high = head
    low, high, size = low - half, high + half, head - tail
    keep_tail, keep_head = low - tail > MIN_WALL_M, head - high > MIN_WALL_M
    if edges[e].kind == TENTATIVE or not (keep_tail or keep_head):
        remove(edges, e)
        return count
    if keep_tail and keep_head:
        f, count = cut_out(edges, count, e, low, high)
        doubt(edges[e])
        if f >= 0:
            doubt(edges[f])
        return count
    side, left = 1 if keep_tail else 0, (low - tail if keep_tail else head - high) / size
    part(edges, e, side)
    keep_share(edges[e], left)
    open_end(edges[e], side, low if keep_tail else high)
    if left < SHOWN_SHARE:
        doubt(edges[e])
    else:
        put_on_probation(edges[e])
    return count
