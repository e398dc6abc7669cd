"""From a lidar scan to a corner scan (paper II): straight pieces, their corners, and the labels of their ends."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agent.corner_scan import PIECE, CornerScan, Sight, range_noise
from agent.geometry.clearance import distances_to_walls
from agent.geometry.lines import Record
from agent.kernels import kernel
from agent.perception.config import PerceptionConfig
from agent.perception.discs import beams_on, find_discs, hidden_beams
from agent.perception.segmentation import fit, piecewise, split_and_merge
from protocol.arrays import Floats, Ints
from protocol.messages import LidarSpec
from protocol.wireframe import Label

NOMINAL, OCCLUSION, FRONTIER = int(Label.NOMINAL), int(Label.OCCLUSION), int(Label.FRONTIER)

LOOK_PAST = 3
"""Beams beyond an end that may be asked: the next, and two more where dropouts or strays say nothing."""


@kernel
def _split_at_gaps(cuts: Ints, ranges: Floats, bearings: Floats, min_hits: int, max_gap: float) -> Ints:
    """Cut pieces where neighbouring hits are farther apart on the wall than max_gap."""
    m = len(ranges)
    out = np.empty((m + 1, 2), np.int64)
    count = 0
    for k in range(len(cuts)):
        begin = cuts[k, 0]
        for j in range(cuts[k, 0] + 1, cuts[k, 1] + 1):
            if j < cuts[k, 1]:
                turn = bearings[j % m] - bearings[(j - 1) % m]
                r, q = ranges[j % m], ranges[(j - 1) % m]
                if r * r + q * q - 2 * r * q * math.cos(turn) <= max_gap * max_gap:
                    continue
            if j - begin >= min_hits:
                out[count, 0], out[count, 1] = begin, j
                count += 1
            begin = j
    return out[:count].copy()


@kernel
def _join_across_strays(
    cuts: Ints, sums: Floats, ranges: Floats, bearings: Floats, line_cost: float, max_gap: float, margin: float
) -> tuple[Ints, Floats]:
    """Join neighbouring pieces on one line that only a stray or two part; returns pieces and their sums.

    A stray is noise: what stands out farther than the margin (metres) is a post or the edge of a thin wall, whose
    corners the pieces may end at.
    """
    m = len(ranges)
    out = np.empty_like(cuts)
    total = np.empty((len(cuts), 6))
    count = 0
    for k in range(len(cuts)):
        own = sums[cuts[k, 1]] - sums[cuts[k, 0]]
        if count:
            before, strays = total[count - 1], cuts[k, 0] - out[count - 1, 1]
            a, b, joint = fit(before + own)
            if strays <= 2 and joint < fit(before)[2] + fit(own)[2] + line_cost:
                p, q = (out[count - 1, 1] - 1) % m, cuts[k, 0] % m
                gap = math.hypot(
                    ranges[p] * math.cos(bearings[p]) - ranges[q] * math.cos(bearings[q]),
                    ranges[p] * math.sin(bearings[p]) - ranges[q] * math.sin(bearings[q]),
                )
                noise_only = True
                for j in range(out[count - 1, 1], cuts[k, 0]):
                    u = a * math.cos(bearings[j % m]) + b * math.sin(bearings[j % m])
                    noise_only = noise_only and abs(ranges[j % m] * u - 1.0) < margin * u
                if gap <= max_gap and noise_only:
                    out[count - 1, 1] = cuts[k, 1]
                    total[count - 1] = before + own
                    continue
        out[count], total[count] = cuts[k], own
        count += 1
    return out[:count].copy(), total[:count].copy()


@kernel
def _end_label(
    ranges: Floats,
    hidden: NDArray[np.bool_],
    beam: int,
    side: int,
    sums: Floats,
    noise: float,
    range_max: float,
    sigmas: float,
    silence: int,
) -> tuple[int, int]:
    """Label of a piece's end by prediction, and the beam that decided.

    The fitted line is prolonged to the next beam: if that went farther, the wall ends before it; if it hit
    something nearer, or nothing could be seen there, the wall is merely hidden or out of range. silence: silent
    beams in a row that show that a wall is not there.
    """
    n = len(ranges)
    a, b, _ = fit(sums)
    det = sums[0] * sums[2] - sums[1] * sums[1]
    silent = 0
    before = ranges[beam % n]
    for ahead in range(1, LOOK_PAST + 1):
        k = beam + side * ahead
        c, s = math.cos(2 * math.pi * k / n), math.sin(2 * math.pi * k / n)
        u = a * c + b * s
        if hidden[k % n] or u <= 1.0 / range_max:
            return FRONTIER, k
        predicted = 1.0 / u
        spread = predicted**2 * math.sqrt((c * c * sums[2] - 2 * c * s * sums[1] + s * s * sums[0]) / det)
        margin = sigmas * math.hypot(noise, spread)
        r = ranges[k % n]
        if not math.isfinite(r):
            if predicted > range_max - 1.5 * math.hypot(noise, spread):
                return FRONTIER, k
            silent += 1
            if silent == silence:
                return OCCLUSION, k
        elif r > predicted + margin:
            return OCCLUSION, k
        elif r < predicted - margin:
            apart = math.sqrt(max(predicted**2 + before**2 - 2 * predicted * before * math.cos(2 * math.pi / n), 0.0))
            if ahead == 1 and predicted - r < apart:
                return OCCLUSION, k  # no nearer than the beams are apart: it meets the wall, and ends it
            return FRONTIER, k
    return FRONTIER, beam + side * LOOK_PAST


@kernel
def _along(piece: Record, bearing: float) -> float:
    """Where a ray at the bearing meets the piece's line, metres from its centroid; inf where it does not."""
    c, s = math.cos(bearing), math.sin(bearing)
    cross = c * piece.uy - s * piece.ux
    if abs(cross) < 1e-6:
        return math.inf
    return -(c * piece.y - s * piece.x) / cross


@kernel
def _meet(p: Record, q: Record) -> tuple[float, float, float]:
    """Sine of the angle between two pieces, and where their lines meet along p and along q (metres)."""
    sine = p.ux * q.uy - p.uy * q.ux
    if abs(sine) < 1e-6:
        return 0.0, 0.0, 0.0
    dx, dy = q.x - p.x, q.y - p.y
    return sine, (dx * q.uy - dy * q.ux) / sine, (dx * p.uy - dy * p.ux) / sine


@kernel
def _assemble(
    pieces: NDArray[np.void],
    cuts: Ints,
    totals: Floats,
    beams: Ints,
    ranges: Floats,
    hidden: NDArray[np.bool_],
    noise: float,
    range_max: float,
    sigmas: float,
    silence: int,
    min_sine: float,
    max_slack: float,
) -> None:
    """Fill the pieces of a scan: lines, corners, labels. `beams` are the indices of the finite beams."""
    n, m = len(ranges), len(beams)
    step = 2 * math.pi / n
    count = len(cuts)
    first, last = np.empty(count, np.int64), np.empty(count, np.int64)
    for k in range(count):
        first[k] = beams[cuts[k, 0] % m] + n * (cuts[k, 0] // m)
        last[k] = beams[(cuts[k, 1] - 1) % m] + n * ((cuts[k, 1] - 1) // m)
        a, b, _ = fit(totals[k])
        norm = math.hypot(a, b)
        piece = pieces[k]
        piece.ux, piece.uy = -b / norm, a / norm
        hits, sum_t, sum_tt, residual = 0.0, 0.0, 0.0, 0.0
        for j in range(cuts[k, 0], cuts[k, 1]):
            angle, r = beams[j % m] * step, ranges[beams[j % m]]
            off = (r * (a * math.cos(angle) + b * math.sin(angle)) - 1.0) / norm
            if abs(off) > 10 * noise:
                continue  # a stray that the piece was joined across
            t = r * (math.cos(angle) * piece.ux + math.sin(angle) * piece.uy)
            hits += 1.0
            sum_t += t
            sum_tt += t * t
            residual += off * off
        t = sum_t / hits
        piece.hits, piece.spread = hits, max(sum_tt - hits * t * t, 1e-9)
        piece.residual = residual
        piece.x, piece.y = a / norm**2 + t * piece.ux, b / norm**2 + t * piece.uy
        piece.bearing[0], piece.bearing[1] = first[k] * step, last[k] * step
        piece.end[0], piece.end[1] = _along(piece, first[k] * step), _along(piece, last[k] * step)
        for side in range(2):
            piece.label[side], piece.link[side], piece.slack[side], piece.gap[side] = FRONTIER, -1, 0.0, 0.0
    for k in range(count):
        p, q = pieces[k], pieces[(k + 1) % count]
        begins = first[(k + 1) % count] + (n if k + 1 == count else 0)
        if count < 2 or begins - last[k] > LOOK_PAST:
            continue
        sine, along_p, along_q = _meet(p, q)
        if abs(sine) < min_sine:
            continue
        off_p = sigmas * noise * math.sqrt(1 / p.hits + along_p**2 / p.spread)
        off_q = sigmas * noise * math.sqrt(1 / q.hits + along_q**2 / q.spread)
        slack = min(math.hypot(off_p, off_q) / abs(sine), max_slack)
        next_p, next_q = _along(p, begins * step), _along(q, last[k] * step)
        next_p = next_p if next_p > p.end[1] else math.inf  # the ray runs away from the line
        next_q = next_q if next_q < q.end[0] else -math.inf
        if p.end[1] - slack <= along_p <= next_p + slack and next_q - slack <= along_q <= q.end[0] + slack:
            p.label[1], q.label[0] = NOMINAL, NOMINAL
            p.link[1], q.link[0] = (k + 1) % count, k
            p.gap[1], q.gap[0] = max(along_p - p.end[1], 0.0), max(q.end[0] - along_q, 0.0)
            p.end[1], q.end[0] = along_p, along_q
    for k in range(count):
        p = pieces[k]
        for side in range(2):
            if p.label[side] == NOMINAL:
                continue
            beam = first[k] if side == 0 else last[k]
            label, decided = _end_label(
                ranges, hidden, beam, 2 * side - 1, totals[k], noise, range_max, sigmas, silence
            )
            p.label[side] = label
            if label == OCCLUSION:
                p.slack[side] = abs(_along(p, decided * step) - p.end[side])


@kernel
def _sectors(marked: NDArray[np.bool_], least: int) -> Floats:
    """(s, 2) rad: runs of at least so many marked beams of a full turn."""
    n = len(marked)
    step = 2 * math.pi / n
    out = np.empty((n, 2))
    count = 0
    start = -1
    for k in range(n):
        if not marked[k]:
            start = k
            break
    if start < 0:
        out[0, 0], out[0, 1] = 0.0, 2 * math.pi
        return out[:1].copy()
    run = 0
    for k in range(start, start + n + 1):
        if marked[k % n]:
            run += 1
            continue
        if run >= least:
            out[count, 0], out[count, 1] = (k - run) * step, (k - 1) * step
            count += 1
        run = 0
    return out[:count].copy()


@kernel
def _explained(cuts: Ints, beams: Ints, n: int) -> NDArray[np.bool_]:
    """(n,) which beams of a full turn belong to a piece. cuts: first and last of each among `beams`."""
    out = np.zeros(n, np.bool_)
    for k in range(len(cuts)):
        for j in range(cuts[k, 0], cuts[k, 1]):
            out[beams[j % len(beams)]] = True
    return out


def perceive(
    ranges: Floats,
    spec: LidarSpec,
    config: PerceptionConfig,
    expected: Floats | None = None,
    known: Floats | None = None,
    posts: Floats | None = None,
) -> CornerScan:
    """Corner scan of a full turn.

    ranges: (beams,) float64 metres, inf where nothing came back. Anything else that is no positive number is
    treated as silent. expected: (k, 3) metres, teammates seen a moment ago, centre and slack
    (agent.perception.seen_discs). known: (m, 4) metres, walls of the map, in which no teammate stands. posts: (p, 2)
    metres, what is round and no teammate (agent.perception.posts). All in the robot's frame.
    """
    ranges = np.where(np.isfinite(ranges) & (ranges > 0) & (ranges <= spec.range_max_m + 1.0), ranges, np.inf)
    noise, half_beam = range_noise(spec), math.pi / len(ranges)
    sigmas = config.range_margin_sigmas
    reach = spec.range_max_m - sigmas * noise
    discs = find_discs(ranges, config.teammate_radius_m, noise, config.disc_fit, sigmas)
    if known is not None and len(known):
        discs = discs[distances_to_walls(discs, known) > config.disc_in_wall_m]
    if posts is not None and len(posts) and len(discs):
        discs = discs[np.hypot(*(discs[:, None] - posts).transpose(2, 0, 1)).min(1) > config.teammate_radius_m]
    hidden = hidden_beams(len(ranges), discs, config.teammate_radius_m)
    if expected is not None and len(expected):
        slack = np.array([0.0, 0.0, config.disc_margin_m])
        hidden |= beams_on(ranges, expected + slack, config.teammate_radius_m)
    returned = np.isfinite(ranges)
    opened = _sectors(~returned & ~hidden, 3)  # fewer may have dropped out
    beams = np.flatnonzero(returned & ~hidden)
    if len(beams) < config.min_hits:
        return CornerScan(np.zeros(0, PIECE), Sight(opened, _sectors(returned, 1), reach, half_beam), discs)
    cut = piecewise if config.method == "piecewise" else split_and_merge
    finite = ranges[beams].astype(np.float64)
    bearings = (beams * (2 * math.pi / len(ranges))).astype(np.float64)
    cuts, sums = cut(finite, bearings, noise, config.min_hits, config.line_cost, config.stray_cost)
    cuts = _split_at_gaps(cuts, finite, bearings, config.min_hits, config.max_gap_m)
    blind = _sectors((returned | hidden) & ~_explained(cuts, beams, len(ranges)), 1)
    cuts, totals = _join_across_strays(cuts, sums, finite, bearings, config.line_cost, config.max_gap_m, sigmas * noise)
    pieces = np.zeros(len(cuts), PIECE)
    _assemble(
        pieces,
        cuts,
        totals,
        beams,
        ranges,
        hidden,
        noise,
        spec.range_max_m,
        sigmas,
        1 if spec.dropout == 0 else 2,  # one may have dropped out, two in a row went through
        math.sin(math.radians(config.min_corner_deg)),
        config.corner_slack_m,
    )
    return CornerScan(pieces, Sight(opened, blind, reach, half_beam), discs)
