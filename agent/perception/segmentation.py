"""Lines through beams, and a scan cut into straight pieces by an optimal piecewise fit in 1/r (ours).

A straight wall a x + b y = 1 is linear in the beam's direction when written in u = 1/r: u = a cos + b sin.
With weights r^4 / sigma^2, prefix sums give fit and chi-square of any interval of beams in O(1), and dynamic
programming finds the cheapest cut. Grazing walls, dropouts and mixed pixels need no rule of their own.
"""

import math

import numpy as np

from agent.kernels import kernel
from protocol.arrays import Floats, Ints

MIN_HITS = 3  # beams of a line, at least: two fit any line, and the third tells whether there is one
LINE_COST = 18.0  # chi-square that one more line must save; noise alone saves it in 1 of 1000 cuts of a straight wall
STRAY_COST = 10.0  # chi-square of a beam on no wall: a hit 3.2 standard deviations off its line is rather a stray


@kernel
def beam_sums(ranges: Floats, bearings: Floats, noise: Floats) -> Floats:
    """(m + 1, 6) prefix sums of w (cos2, cos sin, sin2, u cos, u sin, u2) over points at finite distances.

    ranges, bearings, noise: (m,) distance in m, direction in rad, standard deviation of the distance in m.
    """
    sums = np.zeros((len(ranges) + 1, 6))
    for k in range(len(ranges)):
        r = ranges[k]
        c, s, u = math.cos(bearings[k]), math.sin(bearings[k]), 1.0 / r
        w = r**4 / noise[k] ** 2
        sums[k + 1, 0] = sums[k, 0] + w * c * c
        sums[k + 1, 1] = sums[k, 1] + w * c * s
        sums[k + 1, 2] = sums[k, 2] + w * s * s
        sums[k + 1, 3] = sums[k, 3] + w * u * c
        sums[k + 1, 4] = sums[k, 4] + w * u * s
        sums[k + 1, 5] = sums[k, 5] + w * u * u
    return sums


@kernel
def doubled_sums(ranges: Floats, bearings: Floats, noise: Floats) -> Floats:
    """(2 m + 1, 6) prefix sums over the ring and the same ring once more, so that a piece may wrap around."""
    m = len(ranges)
    once = beam_sums(ranges, bearings, noise)
    sums = np.empty((2 * m + 1, 6))
    sums[: m + 1] = once
    sums[m + 1 :] = once[1:] + once[m]
    return sums


@kernel
def fit_line(sums: Floats) -> tuple[float, float, float]:
    """Line a x + b y = 1 (a, b in 1 / m) and chi-square of six sums; chi-square is inf where the beams fix no line."""
    det = sums[0] * sums[2] - sums[1] * sums[1]
    if det <= 1e-12 * sums[0] * sums[2] + 1e-300:
        return 0.0, 0.0, math.inf
    a = (sums[3] * sums[2] - sums[4] * sums[1]) / det
    b = (sums[4] * sums[0] - sums[3] * sums[1]) / det
    return a, b, max(sums[5] - a * sums[3] - b * sums[4], 0.0)


@kernel
def chi2_of(sums: Floats, i: int, j: int) -> float:
    """Chi-square of the line through beams [i, j); as `fit_line`, without temporary arrays."""
    cc, cs, ss = sums[j, 0] - sums[i, 0], sums[j, 1] - sums[i, 1], sums[j, 2] - sums[i, 2]
    det = cc * ss - cs * cs
    if det <= 1e-12 * cc * ss + 1e-300:
        return math.inf
    uc, us = sums[j, 3] - sums[i, 3], sums[j, 4] - sums[i, 4]
    return max(sums[j, 5] - sums[i, 5] - (uc * uc * ss - 2 * uc * us * cs + us * us * cc) / det, 0.0)


@kernel
def _cheapest_cut(sums: Floats, first: int, last: int) -> Ints:
    """Cut beams first..last into lines and strays: (k, 2) first and one past the last beam of each line.

    Starts that can never win again are dropped (PELT), which makes the search nearly linear.
    """
    n = last - first
    cost = np.zeros(n + 1)
    start = np.full(n + 1, -1)  # of the piece that ends before each beam; -1 for strays
    live, n_live = np.empty(n + 1, np.int64), 0
    for j in range(1, n + 1):
        best, best_start = cost[j - 1] + STRAY_COST, -1
        live[n_live] = j - 1
        n_live += 1
        kept = 0
        for c in range(n_live):
            i = live[c]
            chi2 = chi2_of(sums, first + i, first + j) if j - i >= MIN_HITS else 0.0
            if j - i >= MIN_HITS and cost[i] + chi2 + LINE_COST < best:
                best, best_start = cost[i] + chi2 + LINE_COST, i
            if j - i < MIN_HITS or cost[i] + chi2 < best + LINE_COST:
                live[kept] = i
                kept += 1
        n_live, cost[j], start[j] = kept, best, best_start
    out = np.empty((n, 2), np.int64)
    k, j = 0, n
    while j > 0:
        if start[j] < 0:
            j -= 1
        else:
            out[k, 0], out[k, 1] = start[j] + first, j + first
            k, j = k + 1, start[j]
    return out[:k][::-1].copy()


@kernel
def piecewise(ranges: Floats, bearings: Floats, noise: Floats) -> tuple[Ints, Floats]:
    """Cut a ring of finite beams optimally.

    ranges, bearings, noise: (m,) distances in m in the order of the ring, their directions in rad, their standard
    deviations in m. Returns (k, 2) intervals [first, end) into the doubled ring (indices modulo m), which may wrap
    around, and the (2 m + 1, 6) prefix sums of the doubled ring.
    """
    m, sums = len(ranges), doubled_sums(ranges, bearings, noise)
    begin = _true_cut(sums, m // 4, m - m // 4)
    if begin < 0:
        begin = _true_cut(sums, 0, m)
    if begin < 0:
        begin = _after_widest_gap(bearings)
    return _cheapest_cut(sums, begin, begin + m), sums


@kernel
def _after_widest_gap(bearings: Floats) -> int:
    """The beam after the widest gap of a ring's (m,): where a lone post is all that is in view, it is cut behind it."""
    best, widest = 0, bearings[0] + 2.0 * math.pi - bearings[-1]
    for k in range(1, len(bearings)):
        gap = bearings[k] - bearings[k - 1]
        if gap > widest:
            best, widest = k, gap
    return best


@kernel
def _true_cut(sums: Floats, first: int, last: int) -> int:
    """A beam at which a line begins in any cut of the ring, or -1.

    Beams first..last are cut, and the line that begins nearest to their middle is taken: where the cut begins and ends
    has no influence there.
    """
    lines = _cheapest_cut(sums, first, last)
    middle, best, begin = (first + last) // 2, (last - first) // 4, -1
    for k in range(len(lines)):
        if abs(lines[k, 0] - middle) <= best:
            begin, best = lines[k, 0], abs(lines[k, 0] - middle)
    return begin
