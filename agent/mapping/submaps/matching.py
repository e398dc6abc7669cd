"""Where a scan or a submap lies against walls: points along its pieces, point to line, robust, with a prior (ours)."""

import math
from typing import NamedTuple

import numpy as np

from agent.geometry.lines import ALIKE_COSINE, above, along, placed
from agent.geometry.matrix3 import inverse, times
from agent.geometry.wall_tiles import boxes_at
from agent.kernels import kernel, shared_kernel
from agent.mapping.submaps.segments import samples_along
from agent.mapping.submaps.tiles import SegmentTiles, tiled
from protocol.arrays import Floats, Records
from protocol.geometry import wrapped

SUBMAP_GATES_M = np.array((0.6, 0.3))
"""Of a pose's two refinements: the first finds walls from afar, the second is accurate."""
COARSE_GATE_M = 0.4  # of the search before them, among poses up to so far apart
BEYOND_END_M = 0.2  # a sample may lie so far beyond a wall's end: the wall goes on there, unseen so far
SAMPLE_SD_M = 0.06
"""Standard deviation of a sample's distance from its wall, against the odometry's. The most sensitive setting: with
0.1 the path follows bad odometry, with 0.03 one wrong step runs away."""
LINE_SD_M = 0.03
"""The same of a point of a segment beside the segment's own line. What a wall is off by, all points of a segment are,
so its direction is known better than SAMPLE_SD_M lets them tell: where a few walls hold the heading, as at doorways, a
sixth of the odometry's error came in. With 0.04 csail-drift gains half as much, with 0.02 nothing."""
LINE_M = 3.0  # of a segment, at most, that tell its direction: without, csail-drift with 91 beams gains a third less
LINE_GATE = math.sin(math.radians(5.0))  # the sine of a turn beyond which a direction counts little: of another wall
TRUST = 0.25  # weight of a match's information: samples are not independent


class Match(NamedTuple):
    """A pose (3,) of samples among walls."""

    pose: Floats
    information: Floats  # (3, 3) of that pose, with the prior's


@shared_kernel
def tiles_of(walls: Records) -> SegmentTiles:
    """Walls (n,) as all below takes them, with gates of up to `SUBMAP_GATES_M[0]`."""
    return tiled(walls, math.hypot(SUBMAP_GATES_M[0], BEYOND_END_M))


@kernel
def nearest_wall(tiles: SegmentTiles, x: float, y: float, ux: float, uy: float, gate: float) -> tuple[int, float]:
    """Wall that a sample lies on, or -1, and its signed distance from that wall's line, metres."""
    best, found, distance = gate, -1, 0.0
    for k in boxes_at(tiles.tiles, x, y):
        w = tiles.walls[k]
        if w.ux * ux + w.uy * uy < ALIKE_COSINE:
            continue
        off = above(w, x, y)
        if abs(off) < best:
            t = along(w, x, y)
            if w.low - BEYOND_END_M <= t <= w.high + BEYOND_END_M:
                best, found, distance = abs(off), k, off
    return found, distance


@kernel
def refine(samples: Floats, tiles: SegmentTiles, start: Floats, prior: Floats, gates: Floats, rounds: int) -> Match:
    """Gauss-Newton on the samples (k, 5) of `samples_along` from a start (3,), with an information (3, 3) about it.

    gates: metres, a distance beyond which a sample counts little, one after the other, `rounds` steps each.
    """
    pose, h = start.copy(), prior.copy()
    for gate in gates:
        for _ in range(rounds):
            h = prior.copy()
            g = -times(prior, np.array((pose[0] - start[0], pose[1] - start[1], wrapped(pose[2] - start[2]))))
            c, s = math.cos(pose[2]), math.sin(pose[2])
            for k in range(len(samples)):
                rx, ry = c * samples[k, 0] - s * samples[k, 1], s * samples[k, 0] + c * samples[k, 1]
                ux, uy = c * samples[k, 2] - s * samples[k, 3], s * samples[k, 2] + c * samples[k, 3]
                e, off = nearest_wall(tiles, pose[0] + rx, pose[1] + ry, ux, uy, gate)
                if e < 0:
                    continue
                wall = tiles.walls[e]
                w = 1.0 / (SAMPLE_SD_M * (1.0 + (2.0 * off / gate) ** 2)) ** 2
                j = (-wall.uy, wall.ux, wall.uy * ry + wall.ux * rx)
                for row in range(3):
                    g[row] -= w * j[row] * off
                    for column in range(3):
                        h[row, column] += w * j[row] * j[column]
                # n points of a line of a length tell its direction with a variance of 12 sd^2 / (n length^2)
                length, sine = min(samples[k, 4], wall.high - wall.low, LINE_M), wall.ux * uy - wall.uy * ux
                turn = w * SAMPLE_SD_M**2 * length**2 / (12.0 * (LINE_SD_M * (1.0 + (sine / LINE_GATE) ** 2)) ** 2)
                g[2] -= turn * sine
                h[2, 2] += turn
            step = times(inverse(h), g)
            pose = pose + step
            pose[2] = wrapped(pose[2])
            if abs(step[0]) + abs(step[1]) + abs(step[2]) < 1e-3:
                break
    return Match(pose, h)


@kernel
def share_beside(tiles: SegmentTiles, segments: Records, gate: float) -> float:
    """Share of the length of segments (k,) that lies beside walls of their frame, within the gate, metres."""
    samples, on = samples_along(segments), 0
    for k in range(len(samples)):
        on += nearest_wall(tiles, samples[k, 0], samples[k, 1], samples[k, 2], samples[k, 3], gate)[0] >= 0
    return on / max(len(samples), 1)


@kernel
def truncated_cost(samples: Floats, tiles: SegmentTiles, pose: Floats, gate: float) -> float:
    """Sum over the samples of their squared distance from walls over the gate's, at most 1 each."""
    total = 0.0
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in range(len(samples)):
        x, y, ux, uy = placed(samples[k, 0], samples[k, 1], samples[k, 2], samples[k, 3], pose, c, s)
        e, off = nearest_wall(tiles, x, y, ux, uy, gate)
        total += 1.0 if e < 0 else (off / gate) ** 2
    return total


@kernel
def costs_around(samples: Floats, tiles: SegmentTiles, poses: Floats, gate: float) -> Floats:
    """(n,) truncated costs at poses (n, 3)."""
    out = np.empty(len(poses))
    for n in range(len(poses)):
        out[n] = truncated_cost(samples, tiles, poses[n], gate)
    return out


def poses_around(middle: Floats, window: Floats, step: Floats) -> Floats:
    """(n, 3) poses on a grid about one (3,), as far as `window` (3,) to either side: metres and radians."""
    axes = [np.arange(-n, n + 1) * by for n, by in zip(np.ceil(window / step).astype(int), step, strict=True)]
    return np.asarray(middle + np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3), np.float64)
