"""How loops over walls and beams are compiled: one decorator for all kernels."""

from __future__ import annotations

from numba import njit

kernel = njit(cache=True)
