"""Inverse and square root of symmetric 3 x 3 matrices inside kernels, where numba would want all of scipy."""

import math

import numpy as np

from agent.kernels import kernel
from protocol.arrays import Floats


@kernel
def inverse(m: Floats) -> Floats:
    """Inverse of a regular (3, 3) matrix, by cofactors."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a, b, c, d = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            out[i, j] = m[a, c] * m[b, d] - m[a, d] * m[b, c]
    return out / (m[0, 0] * out[0, 0] + m[0, 1] * out[1, 0] + m[0, 2] * out[2, 0])


@kernel
def lower_root(m: Floats) -> Floats:
    """Cholesky factor of a positive definite (3, 3) matrix."""
    out = np.zeros((3, 3))
    for i in range(3):
        for j in range(i + 1):
            rest = m[i, j]
            for k in range(j):
                rest -= out[i, k] * out[j, k]
            out[i, j] = math.sqrt(max(rest, 1e-18)) if i == j else rest / out[j, j]
    return out


@kernel
def times(m: Floats, v: Floats) -> Floats:
    """Product of a (3, 3) matrix and a (3,) vector."""
    out = np.zeros(3)
    for i in range(3):
        for j in range(3):
            out[i] += m[i, j] * v[j]
    return out
