"""Split and merge: the paper's way to cut a scan into straight pieces (paper II, its ref. 17)."""

import math

import numpy as np

from agent.kernels import kernel
from agent.perception.segmentation import LINE_COST, MIN_HITS, chi2_of, doubled_sums
from protocol.arrays import Floats, Ints

CHI2_PER_BEAM = 2.0  # chi-square that a beam may have on its line before the piece is split; 1 is the mean of the noise
JUMP = 4.0  # a step between beams this many times the greatest distance from the chord is a gap: the split is there


@kernel
def split_and_merge(ranges: Floats, bearings: Floats, noise: Floats) -> tuple[Ints, Floats]:
    """Cut a ring of finite beams; same arguments and result as `segmentation.piecewise`.

    Splits at the beam farthest from the chord, then merges neighbours whose common fit costs less than a line.
    """
    m = len(ranges)
    doubled_ranges = np.concatenate((ranges, ranges))
    doubled_bearings = np.concatenate((bearings, bearings + 2 * math.pi))
    sums = doubled_sums(ranges, bearings, noise)
    x, y = doubled_ranges * np.cos(doubled_bearings), doubled_ranges * np.sin(doubled_bearings)
    begin, _ = _widest_step(x, y, 0, m + 1)  # a cut in any case
    stack = np.empty((2 * m + 2, 2), np.int64)
    stack[0, 0], stack[0, 1] = begin, begin + m
    out, depth, k = np.empty((m, 2), np.int64), 1, 0
    while depth > 0:
        depth -= 1
        i, j = stack[depth, 0], stack[depth, 1]
        if j - i < MIN_HITS:
            continue
        off, at = _farthest_from_chord(x, y, i, j)
        if chi2_of(sums, i, j) > LINE_COST + CHI2_PER_BEAM * (j - i) and at >= 0:
            step_at, step = _widest_step(x, y, i, j)
            cut = step_at if step > JUMP * off else at
            stack[depth, 0], stack[depth, 1] = cut, j  # right half below the left one, so that output rises
            stack[depth + 1, 0], stack[depth + 1, 1] = i, cut
            depth += 2
        else:
            out[k, 0], out[k, 1] = i, j
            k += 1
    return out[: _merge_neighbours(out, k, sums)].copy(), sums


@kernel
def _widest_step(x: Floats, y: Floats, first: int, end: int) -> tuple[int, float]:
    """The beam in (first, end) that is farthest from the one before it, and how far, metres."""
    at, widest = -1, -1.0
    for b in range(first + 1, end):
        step = math.hypot(x[b] - x[b - 1], y[b] - y[b - 1])
        if step > widest:
            at, widest = b, step
    return at, widest


@kernel
def _farthest_from_chord(x: Floats, y: Floats, i: int, j: int) -> tuple[float, int]:
    """Greatest distance, metres, of the beams [i, j) from the line between the outer two, and the beam; -1 if none."""
    dx, dy = x[j - 1] - x[i], y[j - 1] - y[i]
    length = max(math.hypot(dx, dy), 1e-9)
    worst, at = 0.0, -1
    for b in range(i + 1, j - 1):
        off = abs((x[b] - x[i]) * dy - (y[b] - y[i]) * dx) / length
        if off > worst:
            worst, at = off, b
    return worst, at


@kernel
def _merge_neighbours(pieces: Ints, count: int, sums: Floats) -> int:
    """Merge neighbouring pieces (k, 2) in place where one line costs less than two; returns how many are left."""
    merged = 0
    for p in range(1, count):
        i, mid, j = pieces[merged, 0], pieces[merged, 1], pieces[p, 1]
        apart = chi2_of(sums, i, mid) + chi2_of(sums, pieces[p, 0], j)
        if pieces[p, 0] == mid and chi2_of(sums, i, j) < apart + LINE_COST:
            pieces[merged, 1] = j
        else:
            merged += 1
            pieces[merged, 0], pieces[merged, 1] = pieces[p, 0], j
    return min(count, merged + 1)
