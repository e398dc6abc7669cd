"""Plain iterated closest points over corners, one more baseline: from several turns, as nothing says how to begin."""

from __future__ import annotations

import math

import numpy as np

from agent.alignment.agreement import Walls
from agent.alignment.candidates import Candidates, by_corners
from agent.alignment.config import AlignmentConfig
from agent.alignment.feature import Corners
from agent.geometry.transform import fit, move
from agent.kernels import kernel
from protocol.arrays import Floats


def icp(
    mine: Corners,
    theirs: Corners,
    my_walls: Walls,
    their_walls: Walls,
    config: AlignmentConfig,
    rng: np.random.Generator,
) -> Candidates:
    """Transforms from the centres laid on each other at evenly spread turns; scores are the numbers of corners."""
    source, target = theirs.points[theirs.true], mine.points[mine.true]
    turns = np.linspace(0.0, 2.0 * math.pi, config.icp_starts, endpoint=False)
    found = _closest(source, target, turns, config.icp_gate_m, config.icp_rounds)
    return by_corners(found, mine, theirs, my_walls, their_walls, config)


@kernel
def _closest(source: Floats, target: Floats, turns: Floats, gate: float, rounds: int) -> Floats:
    """(k, 3) where the closest points settle from each turn."""
    out = np.empty((turns.shape[0], 3))
    here, there = np.empty(source.shape), np.empty(source.shape)
    sx, sy = source[:, 0].mean(), source[:, 1].mean()
    tx, ty = target[:, 0].mean(), target[:, 1].mean()
    for k in range(turns.shape[0]):
        c, s = math.cos(turns[k]), math.sin(turns[k])
        t = np.array([tx - c * sx + s * sy, ty - s * sx - c * sy, turns[k]])
        for _ in range(rounds):
            count = 0
            for j in range(source.shape[0]):
                x, y = move(t, source[j, 0], source[j, 1])
                best, nearest = gate * gate, -1
                for i in range(target.shape[0]):
                    d2 = (target[i, 0] - x) ** 2 + (target[i, 1] - y) ** 2
                    if d2 < best:
                        best, nearest = d2, i
                if nearest >= 0:
                    here[count], there[count] = source[j], target[nearest]
                    count += 1
            if count < 2:
                break
            new = fit(here, there, count)
            still = abs(new[0] - t[0]) + abs(new[1] - t[1]) + abs(new[2] - t[2]) < 1e-6
            t = new
            if still:
                break
        out[k] = t
    return out
