"""Iterated closest points over corners, from several turns."""

import math

import numpy as np

from agent.geometry.transform import fit, move
from agent.kernels import kernel
from protocol.arrays import Floats

STARTS = 24
"""Evenly spread turns to begin from; it turns by up to 10 degrees by itself."""
GATE_M = 1.5
"""Corners farther apart are no pair, as the maps overlap only in part."""
ROUNDS = 40
"""Iterations at most."""


def closest_points(source: Floats, target: Floats) -> Floats:
    """(k, 3) where the source points (n, 2) settle on the targets (m, 2) from each turn; both centres lie together."""
    return _closest(source, target, np.linspace(0.0, 2.0 * math.pi, STARTS, endpoint=False))


@kernel
def _closest(source: Floats, target: Floats, turns: Floats) -> Floats:
    """(k, 3) where the closest points settle from each turn."""
    out = np.empty((turns.shape[0], 3))
    here, there = np.empty(source.shape), np.empty(source.shape)
    sx, sy = source[:, 0].mean(), source[:, 1].mean()
    tx, ty = target[:, 0].mean(), target[:, 1].mean()
    for k in range(turns.shape[0]):
        c, s = math.cos(turns[k]), math.sin(turns[k])
        t = np.array([tx - c * sx + s * sy, ty - s * sx - c * sy, turns[k]])
        for _ in range(ROUNDS):
            count = 0
            for j in range(source.shape[0]):
                x, y = move(t, source[j, 0], source[j, 1])
                best, nearest = GATE_M * GATE_M, -1
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
