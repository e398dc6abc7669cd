"""Poses of submaps from what was measured between them: robust Gauss-Newton on a pose graph (ours).

Edges of the way hold neighbours; a loop's edge has a Cauchy weight, so that a wrong one bends the way little.
"""

import heapq
import math
from typing import NamedTuple

import numpy as np

from agent.kernels import kernel
from protocol.arrays import Bools, Floats, Ints
from protocol.geometry import wrapped

ROUNDS = 8  # Gauss-Newton steps at most; from poses that were relaxed before two or three do
SETTLED = 1e-4  # m and rad: a step smaller than this ends them
CAUCHY = 3.0  # standard deviations at which a loop's edge has half its weight


class Edges(NamedTuple):
    """Measured poses of nodes in the frames of others."""

    ends: Ints  # (m, 2) the node in whose frame, and the node
    measured: Floats  # (m, 3) m, m, rad
    information: Floats  # (m, 3, 3)
    loop: Bools  # (m,) whether it closes a loop


@kernel
def normal_equations(poses: Floats, edges: Edges) -> tuple[Floats, Floats]:
    """Hessian (3 n, 3 n) and gradient (3 n,) of the edges at poses (n, 3)."""
    n = len(poses)
    h, g = np.zeros((3 * n, 3 * n)), np.zeros(3 * n)
    ja, jb, r = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    for k in range(len(edges.ends)):
        a, b = edges.ends[k, 0], edges.ends[k, 1]
        c, s = math.cos(poses[a, 2]), math.sin(poses[a, 2])
        dx, dy = poses[b, 0] - poses[a, 0], poses[b, 1] - poses[a, 1]
        r[0] = c * dx + s * dy - edges.measured[k, 0]
        r[1] = c * dy - s * dx - edges.measured[k, 1]
        r[2] = wrapped(poses[b, 2] - poses[a, 2] - edges.measured[k, 2])
        ja[0, 0], ja[0, 1], ja[0, 2] = -c, -s, c * dy - s * dx
        ja[1, 0], ja[1, 1], ja[1, 2] = s, -c, -c * dx - s * dy
        ja[2, 2] = -1.0
        jb[0, 0], jb[0, 1], jb[1, 0], jb[1, 1], jb[2, 2] = c, s, -s, c, 1.0
        w = edges.information[k]
        weight = 1.0
        if edges.loop[k]:
            chi2 = 0.0
            for i in range(3):
                for j in range(3):
                    chi2 += r[i] * w[i, j] * r[j]
            weight = 1.0 / (1.0 + chi2 / CAUCHY**2)
        for i in range(3):
            for j in range(3):
                aa, ab, bb = 0.0, 0.0, 0.0
                for p in range(3):
                    for q in range(3):
                        v = weight * w[p, q]
                        aa += ja[p, i] * v * ja[q, j]
                        ab += ja[p, i] * v * jb[q, j]
                        bb += jb[p, i] * v * jb[q, j]
                h[3 * a + i, 3 * a + j] += aa
                h[3 * a + i, 3 * b + j] += ab
                h[3 * b + j, 3 * a + i] += ab
                h[3 * b + i, 3 * b + j] += bb
            for p in range(3):
                for q in range(3):
                    g[3 * a + i] -= weight * ja[p, i] * w[p, q] * r[q]
                    g[3 * b + i] -= weight * jb[p, i] * w[p, q] * r[q]
    return h, g


def relaxed(poses: Floats, edges: Edges) -> Floats:
    """Poses (n, 3) at which the edges fit best, near to the given ones; the first is held."""
    poses = poses.copy()
    for _ in range(ROUNDS):
        h, g = normal_equations(poses, edges)
        step = np.linalg.solve(h[3:, 3:], g[3:]).reshape(-1, 3)
        poses[1:] += step
        if np.abs(step).max() < SETTLED:
            break
    poses[:, 2] = wrapped(poses[:, 2])
    return poses


def covariances_from(node: int, poses: Floats, edges: Edges) -> Floats:
    """(n, 3, 3) covariance of each node's pose as seen from one node, along the surest way through the edges.

    An upper bound, as other ways are left away; in the graph's frame, infinite where there is no way.
    """
    out = np.full((len(poses), 3, 3), np.inf)
    at: list[list[tuple[int, int]]] = [[] for _ in poses]
    for k, (a, b) in enumerate(edges.ends.tolist()):
        at[a].append((k, b))
        at[b].append((k, a))
    inverses = np.linalg.inv(edges.information)
    done, queue = np.zeros(len(poses), np.bool_), [(0.0, node, 0)]
    out[node] = 0.0
    while queue:
        _, here, _ = heapq.heappop(queue)
        if done[here]:
            continue
        done[here] = True
        for k, there in at[here]:
            if done[there]:
                continue
            dx, dy = (poses[there, :2] - poses[here, :2]).tolist()
            swing = np.array(((1.0, 0.0, -dy), (0.0, 1.0, dx), (0.0, 0.0, 1.0)))
            c, s = math.cos(poses[edges.ends[k, 0], 2]), math.sin(poses[edges.ends[k, 0], 2])
            turn = np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
            edge = turn @ inverses[k] @ turn.T  # at the edge's second end
            if edges.ends[k, 0] == here:
                found = swing @ out[here] @ swing.T + edge
            else:
                found = swing @ (out[here] + edge) @ swing.T
            if found[0, 0] + found[1, 1] < out[there, 0, 0] + out[there, 1, 1]:
                out[there] = found
                heapq.heappush(queue, (float(found[0, 0] + found[1, 1]), there, k))
    return out
