"""Teammates in a scan: discs of known radius, whose beams tell nothing about walls (ours, facts/mapping.md rule 11)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agent.kernels import kernel
from agent.perception.segmentation import beam_sums, fit
from protocol.arrays import Floats
from protocol.geometry import wrapped

FEW_BEAMS = 3
"""Any circle fits so many beams, and so does any line; beyond, what fits better decides (ours)."""


@kernel
def _off(r: float, c: float, s: float, distance: float, radius: float) -> float:
    """By how much a range exceeds that of a disc whose centre lies off the beam by an angle of cosine c and sine s."""
    side = distance * s
    if c < 0 or abs(side) >= radius:
        return -math.inf
    return r - distance * c + math.sqrt(radius * radius - side * side)


@kernel
def _span(distance: float, bearing: float, radius: float, step: float) -> tuple[int, int]:
    """First and last beam well inside a disc."""
    half = 0.9 * math.asin(min(radius / distance, 1.0))
    return math.ceil((bearing - half) / step), math.floor((bearing + half) / step)


@kernel
def _residuals(
    ranges: Floats, beams: Floats, distance: float, bearing: float, radius: float, near: float
) -> tuple[int, int, float, int, int]:
    """Over the beams well inside a disc: all, those on it, their squared residuals, the first and the last of them.

    beams: (n, 2) cosine and sine of each beam's bearing.
    """
    n = len(ranges)
    low, high = _span(distance, bearing, radius, 2 * math.pi / n)
    cb, sb = math.cos(bearing), math.sin(bearing)
    on, total, first, last = 0, 0.0, high + 1, low - 1
    for k in range(low, high + 1):
        i = k % n
        c, s = beams[i, 0] * cb + beams[i, 1] * sb, beams[i, 1] * cb - beams[i, 0] * sb
        off = _off(ranges[i], c, s, distance, radius)
        if abs(off) < near:
            on += 1
            total += off * off
            first, last = min(first, k), max(last, k)
    return high - low + 1, on, total, first, last


@kernel
def find_discs(ranges: Floats, radius: float, noise: float, max_chi2: float, sigmas: float) -> Floats:
    """Discs in a full turn of ranges (inf: nothing): (d, 2) metres, centres in the robot's frame.

    A disc is a run of beams that fit a circle of the radius, fit no line as well, and end at a jump or at
    another disc. Far posts and wall ends pass now and then, which only hides them until the robot is nearer.
    """
    n = len(ranges)
    step = 2 * math.pi / n
    near = sigmas * noise + 0.1 * radius
    beams = np.empty((n, 2))
    for k in range(n):
        beams[k, 0], beams[k, 1] = math.cos(k * step), math.sin(k * step)
    found = np.empty((n, 3))
    count = 0
    for i in range(n):
        if not math.isfinite(ranges[i]):
            continue
        distance, bearing = ranges[i] + radius, i * step
        beside = math.ceil(math.asin(radius / distance) / step) + 1
        # most beams end on walls, which go on beside: no need to look closer
        before, after = ranges[(i - beside) % n], ranges[(i + beside) % n]
        far, near_by = ranges[i] + 0.5 * radius, ranges[i] - near
        if near_by <= before <= far or near_by <= after <= far:
            continue
        inside, on, total, first, last = _residuals(ranges, beams, distance, bearing, radius, near)
        if on < 3 or 2 * on < inside:
            continue
        for _ in range(3):  # Gauss-Newton with the two exact derivatives of the range
            a11, a12, a22, b1, b2 = 1e-12, 0.0, 1e-12, 0.0, 0.0
            cb, sb = math.cos(bearing), math.sin(bearing)
            low, high = _span(distance, bearing, radius, step)
            for k in range(low, high + 1):
                c, s = beams[k % n, 0] * cb + beams[k % n, 1] * sb, beams[k % n, 1] * cb - beams[k % n, 0] * sb
                off = _off(ranges[k % n], c, s, distance, radius)
                if abs(off) > near:
                    continue
                side = distance * s
                root = math.sqrt(radius * radius - side * side)
                by_distance = c + side * s / root
                by_bearing = side - side * distance * c / root
                a11 += by_distance**2
                a12 += by_distance * by_bearing
                a22 += by_bearing**2
                b1 += by_distance * off
                b2 += by_bearing * off
            det = a11 * a22 - a12 * a12
            if det > 1e-9 * a11 * a22:
                d_distance, d_bearing = (b1 * a22 - b2 * a12) / det, (b2 * a11 - b1 * a12) / det
            else:
                d_distance, d_bearing = b1 / a11, 0.0
            distance = max(distance + max(-radius, min(radius, d_distance)), 1.05 * radius)
            bearing += max(-step, min(step, d_bearing))
        inside, on, total, first, last = _residuals(ranges, beams, distance, bearing, radius, near)
        if on < 3 or 2 * on < inside or total / noise**2 > max_chi2 * on:
            continue
        run = np.empty(last - first + 1)
        angle = np.empty(last - first + 1)
        m = 0
        cb, sb = math.cos(bearing), math.sin(bearing)
        for k in range(first, last + 1):
            c, s = beams[k % n, 0] * cb + beams[k % n, 1] * sb, beams[k % n, 1] * cb - beams[k % n, 0] * sb
            if abs(_off(ranges[k % n], c, s, distance, radius)) < near:
                run[m], angle[m] = ranges[k % n], k * step
                m += 1
        line = fit(beam_sums(run[:m], angle[:m], noise)[m])[2]
        if m > FEW_BEAMS and line < total / noise**2:
            continue
        better = True
        for c in range(count):  # of those on the same spot, the first that fits best stays
            apart = math.hypot(
                found[c, 0] * math.cos(found[c, 1]) - distance * math.cos(bearing),
                found[c, 0] * math.sin(found[c, 1]) - distance * math.sin(bearing),
            )
            if apart < radius:
                if total / on < found[c, 2]:
                    found[c, 0], found[c, 1], found[c, 2] = distance, bearing, total / on
                better = False
                break
        if better:
            found[count, 0], found[count, 1], found[count, 2] = distance, bearing, total / on
            count += 1
    jump = np.zeros((count, 2), np.bool_)
    for c in range(count):
        half = math.asin(min(radius / found[c, 0], 1.0))
        for side in range(2):
            r = ranges[round((found[c, 1] + (2 * side - 1) * (half + step)) / step) % n]
            jump[c, side] = r > found[c, 0] + 0.3 * radius or r < found[c, 0] - radius - near
    kept = np.empty((count, 2))
    n_kept = 0
    for c in range(count):
        distance, bearing = found[c, 0], found[c, 1]
        half = math.asin(min(radius / distance, 1.0))
        bounded = True
        for side in range(2):
            beside = jump[c, side]
            for other in range(count):  # a row of them is a wall, so one with both ends hidden does not count
                if other != c and (jump[other, 0] or jump[other, 1]) and not beside:
                    gap = wrapped(bearing + (2 * side - 1) * (half + step) - found[other, 1])
                    beside = abs(gap) <= math.asin(min(radius / found[other, 0], 1.0)) + step
            bounded = bounded and beside
        if bounded and (jump[c, 0] or jump[c, 1]):
            kept[n_kept, 0], kept[n_kept, 1] = distance * math.cos(bearing), distance * math.sin(bearing)
            n_kept += 1
    return kept[:n_kept].copy()


@kernel
def hidden_beams(n: int, discs: Floats, radius: float) -> NDArray[np.bool_]:
    """(n,) which beams of a full turn meet one of the discs, or pass within one beam of it."""
    out = np.zeros(n, np.bool_)
    step = 2 * math.pi / n
    for d in range(len(discs)):
        distance = max(math.hypot(discs[d, 0], discs[d, 1]), 1.001 * radius)
        bearing = math.atan2(discs[d, 1], discs[d, 0])
        half = math.asin(radius / distance) + step
        for k in range(math.ceil((bearing - half) / step), math.floor((bearing + half) / step) + 1):
            out[k % n] = True
    return out


@kernel
def beams_on(ranges: Floats, expected: Floats, radius: float) -> NDArray[np.bool_]:
    """(n,) which beams of a full turn end on a disc expected at (k, 3) centre and slack, metres, robot's frame."""
    n = len(ranges)
    out = np.zeros(n, np.bool_)
    step = 2 * math.pi / n
    for d in range(len(expected)):
        reach = radius + expected[d, 2]
        distance = math.hypot(expected[d, 0], expected[d, 1])
        bearing = math.atan2(expected[d, 1], expected[d, 0])
        half = math.asin(min(reach / max(distance, 1e-9), 1.0))
        for k in range(math.ceil((bearing - half) / step), math.floor((bearing + half) / step) + 1):
            r = ranges[k % n]
            apart = math.hypot(r * math.cos(k * step) - expected[d, 0], r * math.sin(k * step) - expected[d, 1])
            if math.isfinite(r) and apart < reach:
                out[k % n] = True
    return out
