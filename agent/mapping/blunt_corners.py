"""Blunt corners: walls turned by a few degrees, and walls that cross, meet on the published map where their lines do
(ours).

Hits near a corner of 8 or 18 degrees fit both walls within noise, so no scan tells where it is (`MIN_CORNER_SINE`), and
either wall seems to go on for a hand's breadth: behind the next one, inside solid, where no view speaks against it. In
peers' maps such an end took the next wall along, off by 10 cm. The lines of both walls, each fitted to all its hits, do
tell. As small faces, these corners are worked out anew from the walls whenever they change.
"""

import math

import numpy as np

from agent.corner_scan import NOISE_SIGMAS, NOMINAL
from agent.geometry.lines import MIN_CORNER_SINE, Record, meet
from agent.kernels import kernel
from agent.mapping.association import ANGLE_GATE
from agent.mapping.edges import MIN_WALL_M, WALL, line_sd, set_tip, tip_at
from agent.mapping.ends import CLOSE_CORNER_M
from protocol.arrays import Ints, Records

LEAST_SINE = math.sin(ANGLE_GATE)  # walls that are turned by less may be one that is not straight
KNOWN_M = 0.1
"""Metres along the walls to which their corner must be known, by NOISE_SIGMAS. Of 118 in ten runs in `made.traced`,
turned by 4 to 20 degrees, the median was known to 1 cm and off by 1; 116 were off by 8 at most, two by 10 and 30."""
BESIDE_CORNER_M = 0.07
"""How far an end may lie behind the other wall: the hits of the next wall that a line took lie 2 to 5 cm beside it, and
7 at most, in the same runs."""
CROSSED_M = 0.15
"""The same where both walls go on past the other. In three of 39 more maps there, ends lay 8 to 10 cm behind the next
wall, at bends of 7 to 15 degrees."""


@kernel
def close_blunt_corners(edges: Records, shown: Ints, noise: float) -> None:
    """Link open heads and tails at blunt corners, and move both ends there.

    shown: (n,) not negative for walls that are published. noise: m, standard deviation of a range.
    """
    tail_of, head_of = np.full(len(edges), -1), np.full(len(edges), -1)  # the best partner of each head and each tail
    head_off, tail_off = np.full(len(edges), BESIDE_CORNER_M), np.full(len(edges), BESIDE_CORNER_M)
    heads, tails = _open_ends(edges, shown, 1), _open_ends(edges, shown, 0)
    for e in heads:
        for f in tails:
            off = _off_corner(edges[e], edges[f], noise) if e != f else math.inf
            if off < head_off[e]:
                head_off[e], tail_of[e] = off, f
            if off < tail_off[f]:
                tail_off[f], head_of[f] = off, e
    for e in heads:
        f = tail_of[e]
        if f < 0 or head_of[f] != e:
            continue
        at_e, at_f = meet(edges[e], edges[f])[1], meet(edges[f], edges[e])[1]
        if at_e - tip_at(edges[e], 0) < MIN_WALL_M or tip_at(edges[f], 1) - at_f < MIN_WALL_M:
            continue  # cut at its other end already, so that too little would be left
        set_tip(edges[e], 1, at_e)
        edges[f].tip[0] = edges[e].tip[1]
        edges[e].link[1], edges[f].link[0] = f, e
        edges[e].label[1], edges[f].label[0] = NOMINAL, NOMINAL


@kernel
def _open_ends(edges: Records, shown: Ints, side: int) -> Ints:
    """(n,) the published walls that have an end here which is no corner."""
    found, count = np.empty(len(edges), np.int64), 0
    for e in range(len(edges)):
        if edges[e].kind == WALL and shown[e] >= 0 and edges[e].link[side] < 0:
            found[count] = e
            count += 1
    return found[:count]


@kernel
def _off_corner(e: Record, f: Record, noise: float) -> float:
    """How far the head of e or the tail of f lies beside the other wall's line, metres; inf if they share no corner.

    Walls do not cross: where they go on past each other with less than half of both, that is their corner, however well
    it is known, and before any other. Of several the first one along goes on with it, so distances count as negative.
    """
    sine, at_e = meet(e, f)
    if sine == 0.0 or e.ux * f.ux + e.uy * f.uy < 0.0:
        return math.inf
    at_f = meet(f, e)[1]
    past_e, past_f = tip_at(e, 1) - at_e, at_f - tip_at(f, 0)
    off = abs(sine) * max(past_e, past_f)
    if min(past_e, past_f) > 0.0:
        kept = at_e - tip_at(e, 0) + tip_at(f, 1) - at_f
        return -off if past_e + past_f < kept and off <= CROSSED_M else math.inf
    apart = min(past_e, past_f) < -CLOSE_CORNER_M and past_e + past_f < 0.0
    if apart or off > BESIDE_CORNER_M or not LEAST_SINE <= abs(sine) < MIN_CORNER_SINE:
        return math.inf
    sd = math.hypot(line_sd(e, at_e, noise), line_sd(f, at_f, noise))
    return max(off, 0.0) if NOISE_SIGMAS * sd <= KNOWN_M * abs(sine) else math.inf
