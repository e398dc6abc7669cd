"""What a scan says against walls: seen through, not seen where they should be, overlaid (facts/mapping.md rule 8)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agent.corner_scan import Sight
from agent.kernels import kernel
from agent.mapping.edges import (
    CANDIDATE,
    FREE,
    FRONTIER,
    Edges,
    above,
    along,
    doubt,
    length,
    new_slot,
    part,
    remove,
    set_tip,
    tip_at,
)
from protocol.geometry import Pose

UNSEEN, THROUGH, ON = 0, 1, 2

GRAZING = math.sin(math.radians(8.0))
"""Sine of the flattest view of a wall that is expected to show it; as in the scorer."""

SIDE_BY_SIDE = 0.5
"""Cosine of the angle between walls that cannot leave one place: 60 degrees; buildings turn by 90."""

BESIDE_M = 0.15
"""Walls that share a place run side by side from there if they overlap by more; twice the reach of a corner."""


class ViewRules(NamedTuple):
    """Rules of contradiction, as plain numbers for the kernels (agent.config.MapConfig says why)."""

    step: float
    margin: float
    half_beam: float
    end_skip: float
    cut_after: float
    drop_after: float
    drop_growth: float
    confirmations: float
    sure_after: float
    min_length: float


@kernel
def patient_view(rules: ViewRules, factor: float) -> ViewRules:
    """The rules of a particle that is more or less patient."""
    return ViewRules(
        rules.step,
        rules.margin,
        rules.half_beam,
        rules.end_skip,
        rules.cut_after * factor,
        rules.drop_after * factor,
        rules.drop_growth,
        rules.confirmations,
        rules.sure_after,
        rules.min_length,
    )


@kernel
def piece_at(pieces: NDArray[np.void], bearing: float, half_beam: float) -> int:
    """The piece that a ray in the robot's frame meets well inside its ends, or -1. bearing in [0, 2 pi)."""
    for k in range(len(pieces)):
        for turn in (0.0, 2 * math.pi):
            if pieces[k].bearing[0] + half_beam <= bearing + turn <= pieces[k].bearing[1] - half_beam:
                return k
    return -1


@kernel
def within(sectors: NDArray[np.float64], bearing: float, margin: float) -> bool:
    """Whether a bearing in [0, 2 pi) is by that margin inside one of the sectors (s, 2), radians."""
    for s in range(len(sectors)):
        for turn in (-2 * math.pi, 0.0, 2 * math.pi):
            if sectors[s, 0] + margin <= bearing + turn <= sectors[s, 1] - margin:
                return True
    return False


@kernel
def look_at(
    x: float,
    y: float,
    pose: Pose,
    raw: NDArray[np.void],
    pieces: NDArray[np.void],
    sight: Sight,
    rules: ViewRules,
) -> tuple[int, int]:
    """What the scan saw at a point of the map: UNSEEN, THROUGH it, or a wall ON it; and the piece it met.

    raw has the pieces' bearings, pieces the same in the map's frame.
    """
    dx, dy = x - pose[0], y - pose[1]
    distance = math.hypot(dx, dy)
    if distance > sight.reach or distance < 1e-6:
        return UNSEEN, -1
    bearing = (math.atan2(dy, dx) - pose[2]) % (2 * math.pi)
    if within(sight.blind, bearing, -rules.half_beam):
        return UNSEEN, -1
    k = piece_at(raw, bearing, rules.half_beam)
    if k >= 0:
        p = pieces[k]
        off = (y - p.y) * p.ux - (x - p.x) * p.uy
        if off > rules.margin:
            return THROUGH, k
        if off < -rules.margin:
            return UNSEEN, k
        return ON, k
    if within(sight.open, bearing, rules.half_beam):
        return (THROUGH, -1) if distance < sight.reach - rules.margin else (UNSEEN, -1)
    return UNSEEN, -1


@kernel
def _cut(edges: Edges, count: int, e: int, low: float, high: float, rules: ViewRules) -> int:
    """Take the part [low, high] (coordinates along the wall) out of a wall."""
    tail, head = tip_at(edges[e], 0), tip_at(edges[e], 1)
    keep_tail, keep_head = low - tail > rules.min_length, head - high > rules.min_length
    if not keep_tail and not keep_head:
        remove(edges, e)
        return count
    if keep_tail and keep_head:
        f, count = new_slot(edges, count)
        if f >= 0:
            edges[f] = edges[e]
            g = edges[e].link[1]
            if g >= 0:
                edges[g].link[0] = f
                edges[e].link[1] = -1
            edges[f].link[0] = -1
            edges[f].label[0], edges[f].slack[0], edges[f].strength[0] = FRONTIER, 0.0, 0.0
            edges[f].conflict[0] = 0.0
            doubt(edges[f])
            set_tip(edges[f], 0, high)
        keep_head = False
    side = 0 if keep_head else 1
    part(edges, e, side)
    edges[e].label[side], edges[e].slack[side] = FRONTIER, 0.0
    edges[e].strength[side], edges[e].conflict[side] = 0.0, 0.0
    set_tip(edges[e], side, high if keep_head else low)
    doubt(edges[e])
    return count


@kernel
def _usurped(edges: Edges, count: int, e: int, hit: NDArray[np.bool_], margin: float) -> bool:
    """Whether a wall begins, or ends, on one that is hit, and the two part slowly while they run side by side.

    The solid of one would be in the free space of the other: a corner has one wall in and one out (paper III-A). A
    wall displaced by a wrong corner often lies behind the true one, where no view speaks against it. Square walls
    stay, since rooms and partitions meet so, and so does a wall that begins where the other ends.
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
            if abs(above(v, x, y)) > 2 * margin or not low - 2 * margin < t < high + 2 * margin or beside < BESIDE_M:
                continue
            if abs(above(v, w.tip[1 - side, 0], w.tip[1 - side, 1])) > 2 * margin:
                return True
    return False


@kernel
def contradict(
    edges: Edges,
    count: int,
    pose: Pose,
    raw: NDArray[np.void],
    pieces: NDArray[np.void],
    walls: NDArray[np.int64],
    sight: Sight,
    rules: ViewRules,
) -> int:
    """Count what a merged scan says for and against every wall, and cut or drop those refuted; returns the count."""
    hit = np.zeros(len(edges), np.bool_)
    for k in range(len(walls)):
        if walls[k] >= 0:
            hit[walls[k]] = True
    for e in range(count):
        w = edges[e]
        if w.alive == FREE:
            continue
        size = length(w)
        t_near = min(max(along(w, pose[0], pose[1]), tip_at(w, 0)), tip_at(w, 1))
        if math.hypot(w.x + t_near * w.ux - pose[0], w.y + t_near * w.uy - pose[1]) > sight.reach:
            if w.alive == CANDIDATE:
                remove(edges, e)  # forgotten: it has to show itself within one pass
            continue
        side = above(w, pose[0], pose[1])
        skip = min(rules.end_skip, 0.25 * size)
        n = max(3, math.ceil((size - 2 * skip) / rules.step))
        low, high, visible, on = math.inf, -math.inf, 0, 0
        tail = tip_at(w, 0) + skip
        spacing = (size - 2 * skip) / (n - 1)
        for j in range(n):
            t = tail + j * spacing
            x, y = w.x + t * w.ux, w.y + t * w.uy
            saw, k = look_at(x, y, pose, raw, pieces, sight, rules)
            if saw == UNSEEN:
                continue
            flat = GRAZING * math.hypot(x - pose[0], y - pose[1])
            if abs(side) < flat:
                continue  # the ray may as well have passed beside it
            faces = side > flat
            if saw == THROUGH:
                low, high = min(low, t), max(high, t)
                if faces:
                    visible += 1
            elif faces:
                visible += 1
                if walls[k] == e:
                    on += 1  # else another wall stands in its place
        if on == 0:  # a piece may lie wholly within the half beam at its ends
            for k in range(len(walls)):
                if walls[k] == e:
                    on, visible = 1, max(visible, 1)
        refuted = on == 0 and (visible >= 2 or _usurped(edges, count, e, hit, rules.margin))
        if refuted or on > 0:
            w.due += 1.0
        if on > 0:
            w.seen += 1.0
            w.misses = 0.0
            if w.seen >= rules.sure_after and w.through == 0.0:
                w.probation = 0
        elif refuted:
            w.misses += 1.0
        sure = 0.0 if w.probation == 1 else min(w.seen, rules.confirmations)
        if w.misses >= rules.drop_after + rules.drop_growth * sure:
            remove(edges, e)
            continue
        if low > high:
            if on > 0 and w.through > 0.0 and 2 * on > n:
                w.through -= 1.0
            continue
        if w.through > 0.0:  # the same place as before?
            one, two = along(w, w.gap[0, 0], w.gap[0, 1]), along(w, w.gap[1, 0], w.gap[1, 1])
            if min(max(one, two), high) >= max(min(one, two), low) - spacing:
                low, high = min(low, one, two), max(high, one, two)
                w.through += 1.0
            else:
                w.through = 1.0
        else:
            w.through = 1.0
        w.gap[0, 0], w.gap[0, 1] = w.x + low * w.ux, w.y + low * w.uy
        w.gap[1, 0], w.gap[1, 1] = w.x + high * w.ux, w.y + high * w.uy
        if w.through >= rules.cut_after - w.probation:  # what was cut before is suspect
            if w.alive == CANDIDATE:
                remove(edges, e)
                continue
            if low <= tail + 0.5 * spacing:
                low = tip_at(w, 0)
            if high >= tail + (n - 1.5) * spacing:
                high = tip_at(w, 1)
            count = _cut(edges, count, e, low - 0.5 * spacing, high + 0.5 * spacing, rules)
    return count
