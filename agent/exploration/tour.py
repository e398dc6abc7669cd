"""In which order to visit several places (ours): nearest first, improved by moves and reversals."""

import math

import numpy as np

from agent.kernels import kernel
from protocol.arrays import Bools, Floats, Ints

_LEAST_GAIN = 1e-9
"""A change of the order must make the tour this much cheaper, or rounding errors could go on for ever."""


@kernel
def tour_cost(order: Ints, cost: Floats, waits: Bools, haste: float) -> float:
    """Cost of a tour: its length where haste is 0, twice the mean way to the places that wait where haste is 1.

    order: (k,) rows of cost (n, n); waits: (n,) the places whose ways are averaged. Where no place waits, the cost
    is the length times 1 - haste.
    """
    left = 0
    for k in range(1, order.shape[0]):
        left += waits[order[k]]
    each = 2.0 * haste / max(left, 1)
    total = 0.0
    for k in range(order.shape[0] - 1):
        total += cost[order[k], order[k + 1]] * (1.0 - haste + each * left)
        left -= waits[order[k + 1]]
    return total


@kernel
def _nearest_neighbours(cost: Floats) -> Ints:
    """Order (n,) that goes from row 0 of cost (n, n) to the cheapest row left, and so on."""
    n = cost.shape[0]
    order = np.zeros(n, np.int64)
    left = np.ones(n, np.bool_)
    left[0] = False
    for k in range(1, n):
        best, which = math.inf, -1
        for j in range(n):
            if left[j] and (which < 0 or cost[order[k - 1], j] < best):
                best, which = cost[order[k - 1], j], j
        order[k] = which
        left[which] = False
    return order


@kernel
def _with_reversed(order: Ints, i: int, j: int) -> Ints:
    """The order with its stretch from i to j reversed; i < j."""
    new = order.copy()
    for k in range(i, j + 1):
        new[k] = order[j - (k - i)]
    return new


@kernel
def _with_moved(order: Ints, i: int, j: int) -> Ints:
    """The order with its place i moved to j."""
    new = order.copy()
    for k in range(i, j):
        new[k] = order[k + 1]
    for k in range(j, i):
        new[k + 1] = order[k]
    new[j] = order[i]
    return new


@kernel
def open_tour(cost: Floats, waits: Bools, haste: float) -> Ints:
    """Order (n,) in which to visit all rows of cost (n, n), starting from row 0 and ending anywhere.

    Nearest neighbour, then reversals of stretches (2-opt) and moves of single places until none makes the tour
    cheaper by `tour_cost`.
    """
    n = cost.shape[0]
    order = _nearest_neighbours(cost)
    best = tour_cost(order, cost, waits, haste)
    improved = True
    while improved:
        improved = False
        for i in range(1, n):
            for j in range(1, n):
                for reverses in (True, False):
                    if i == j or (reverses and i > j):
                        continue
                    new = _with_reversed(order, i, j) if reverses else _with_moved(order, i, j)
                    total = tour_cost(new, cost, waits, haste)
                    if total < best - _LEAST_GAIN:
                        order, best, improved = new, total, True
                        break
    return order
