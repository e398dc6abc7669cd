"""Which wall of a particle a piece of a scan belongs to: edges first, corners follow (facts/mapping.md rule 4)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agent.corner_scan import Record
from agent.kernels import kernel
from agent.mapping.edges import FRONTIER, NOMINAL, WALL, Edges, above, along, line_sd, spread, tip_at


class Gates(NamedTuple):
    """Gates of an association, as plain numbers for the kernels (agent.config.MapConfig says why)."""

    noise: float
    sigmas: float
    offset: float
    angle: float
    bridge: float
    pose_sd: float
    heading_sd: float


@kernel
def uncertain(gates: Gates, covariance: NDArray[np.float64]) -> Gates:
    """Gates for a pose of the given (3, 3) covariance."""
    return Gates(
        gates.noise,
        gates.sigmas,
        gates.offset,
        gates.angle,
        gates.bridge,
        math.sqrt(max(covariance[0, 0], covariance[1, 1])),
        math.sqrt(covariance[2, 2]),
    )


@kernel
def cost(e: Record, p: Record, gates: Gates) -> float:
    """Chi-square (2 degrees of freedom) of a piece p, in the map's frame, lying on the line of wall e; inf out of gate.

    Gates on the distance of the piece's centroid, scaled by noise, and on direction.
    """
    turn = math.asin(max(-1.0, min(1.0, e.ux * p.uy - e.uy * p.ux)))
    if e.ux * p.ux + e.uy * p.uy < 0.7:
        return math.inf
    turn_sd = math.hypot(gates.noise * math.sqrt(1 / p.spread + 1 / spread(e)), gates.heading_sd)
    t = along(e, p.x, p.y)
    off = above(e, p.x, p.y)
    off_sd = math.hypot(math.hypot(gates.noise / math.sqrt(p.hits), line_sd(e, t, gates.noise)), gates.pose_sd)
    if abs(turn) > min(gates.angle + gates.sigmas * turn_sd, 0.5) or abs(off) > gates.offset + gates.sigmas * off_sd:
        return math.inf
    return (off / (off_sd + gates.offset / gates.sigmas)) ** 2 + (turn / (turn_sd + gates.angle / gates.sigmas)) ** 2


@kernel
def overlap(e: Record, p: Record, gates: Gates) -> float:
    """Length that piece and wall share, metres; negative is a gap that may be bridged; -inf one that may not.

    Only an open end may be bridged: a corner ends its wall.
    """
    t = along(e, p.x, p.y)
    shared = min(t + p.end[1], tip_at(e, 1)) - max(t + p.end[0], tip_at(e, 0))
    if shared > 0:
        return shared
    side = 1 if t > 0.5 * (tip_at(e, 0) + tip_at(e, 1)) else 0
    bridge = gates.offset
    if e.label[side] == FRONTIER:
        bridge = gates.bridge
    elif e.label[side] != NOMINAL:
        bridge = gates.offset + e.slack[side]
    return shared if -shared <= bridge else -math.inf


@kernel
def associate(
    edges: Edges, count: int, pieces: NDArray[np.void], gates: Gates, dice: NDArray[np.float64]
) -> NDArray[np.int64]:
    """The wall of each piece, or -1: (k,).

    dice: (k,) in [0, 1): a piece that several walls would take is given to one of them with the probability that
    their chi-squares say; a die of exactly 0 takes the best, which is what a single hypothesis does.
    """
    out = np.full(len(pieces), -1)
    fits = np.empty(count)
    for k in range(len(pieces)):
        best = math.inf
        for e in range(count):
            fits[e] = math.inf
            if edges[e].alive != WALL:
                continue
            chi2 = cost(edges[e], pieces[k], gates)
            if not math.isfinite(chi2):
                continue
            shared = overlap(edges[e], pieces[k], gates)
            if math.isfinite(shared):
                fits[e] = chi2 + (0.0 if shared > 0 else 4.0)  # a bridge is the weaker claim
                if fits[e] < best:
                    best, out[k] = fits[e], e
        if dice[k] == 0.0 or not math.isfinite(best):
            continue
        total = 0.0
        for e in range(count):
            total += math.exp(-0.5 * (fits[e] - best))
        left = dice[k] * total
        for e in range(count):
            left -= math.exp(-0.5 * (fits[e] - best))
            if left < 0 and math.isfinite(fits[e]):
                out[k] = e
                break
    return out
