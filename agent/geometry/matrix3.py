"""Inverse and product of 3 x 3 matrices inside kernels, where numba would want all of scipy."""

import numpy as np

from agent.kernels import kernel, shared_kernel
from protocol.arrays import Floats


@shared_kernel
def inverse(m: Floats) -> Floats:
    """Inverse of a regular (3, 3) matrix, by cofactors."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a, b, c, d = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            out[i, j] = m[a, c] * m[b, d] - m[a, d] * m[b, c]
    return out / (m[0, 0] * out[0, 0] + m[0, 1] * out[1, 0] + m[0, 2] * out[2, 0])


@kernel
def times(m: Floats, v: Floats) -> Floats:
    """Product of a (3, 3) matrix and a (3,) vector."""
    out = np.zeros(3)
    for i in range(3):
        for j in range(3):
            out[i] += m[i, j] * v[j]
    return out
