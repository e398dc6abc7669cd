"""Log-likelihood of a corner scan given a wireframe and a pose (paper III-B; equations ours).

Predicted against measured corners and walls, labels, missing and extra features, and free space seen through a
wall. It reads a particle and changes nothing, so it also judges maps that are not the robot's own.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agent.corner_scan import Sight
from agent.kernels import kernel
from agent.mapping.association import Gates, cost
from agent.mapping.contradiction import GRAZING, ON, THROUGH, UNSEEN, ViewRules, look_at
from agent.mapping.edges import NOMINAL, OCCLUSION, WALL, Edges, above, along, length, tip_at
from protocol.geometry import Pose


class Odds(NamedTuple):
    """Log-odds of what a scan shows if the particle is right against if it is not (agent.config.FilterConfig)."""

    match: float
    extra: float
    missing: float
    through: float
    corner: float
    label: float


@kernel
def log_likelihood(
    edges: Edges,
    count: int,
    pose: Pose,
    raw: NDArray[np.void],
    pieces: NDArray[np.void],
    walls: NDArray[np.int64],
    sight: Sight,
    gates: Gates,
    views: ViewRules,
    odds: Odds,
) -> float:
    """Log-likelihood, up to a constant, of pieces (raw: robot's frame, pieces: map's) associated with walls (or -1)."""
    total = 0.0
    for k in range(len(pieces)):
        p, e = pieces[k], walls[k]
        if e < 0:
            total -= odds.extra
            continue
        total += odds.match - 0.5 * min(cost(edges[e], p, gates), 2 * odds.match + 2 * odds.extra)
        if p.label[1] == NOMINAL and walls[p.link[1]] >= 0:
            if edges[e].link[1] == walls[p.link[1]]:
                total += odds.corner
            elif edges[e].link[1] >= 0 or edges[walls[p.link[1]]].link[0] >= 0:
                total -= odds.corner
        t = along(edges[e], p.x, p.y)
        for side in range(2):
            out = 1.0 if side == 1 else -1.0
            beyond = out * (t + p.end[side] - tip_at(edges[e], side))
            closed = edges[e].label[side] == NOMINAL
            if closed and beyond > views.margin + views.end_skip:
                total -= odds.label  # wall goes on behind a corner
            if p.label[side] == OCCLUSION and beyond + p.slack[side] < -(views.margin + views.end_skip):
                total -= odds.label  # wall ends before its end
    for e in range(count):
        w = edges[e]
        if w.alive != WALL:
            continue
        size = length(w)
        t_near = min(max(along(w, pose[0], pose[1]), tip_at(w, 0)), tip_at(w, 1))
        if math.hypot(w.x + t_near * w.ux - pose[0], w.y + t_near * w.uy - pose[1]) > sight.reach:
            continue
        side_of = above(w, pose[0], pose[1])
        skip = min(views.end_skip, 0.25 * size)
        n = max(3, math.ceil((size - 2 * skip) / (3 * views.step)))
        through, missing, on = 0, 0, 0
        for j in range(n):
            t = tip_at(w, 0) + skip + j * (size - 2 * skip) / (n - 1)
            x, y = w.x + t * w.ux, w.y + t * w.uy
            saw, k = look_at(x, y, pose, raw, pieces, sight, views)
            flat = GRAZING * math.hypot(x - pose[0], y - pose[1])
            if saw == UNSEEN or abs(side_of) < flat:
                continue
            if saw == THROUGH:
                through += 1
            elif saw == ON and side_of > flat:
                if walls[k] == e:
                    on += 1
                else:
                    missing += 1
        if through > 0:
            total -= odds.through
        if missing > on:
            total -= odds.missing
    return total
