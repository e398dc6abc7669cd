"""How loops over walls and beams are compiled: one decorator for all kernels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit
from numba.extending import register_jitable

from agent.kernel_cache import KernelCache
from protocol.geometry import wrapped

Function = TypeVar("Function", bound=Callable[..., Any])

OPTIONS: dict[str, Any] = {"no_cfunc_wrapper": True}
"""No kernel is called from C, so that wrapper is not compiled."""


def kernel(function: Function) -> Function:
    """Compile a function when it is first called with arguments of some types, or load it where it was kept."""
    compiled: Any = njit(**OPTIONS)(function)
    compiled._cache = KernelCache(function, OPTIONS)
    result: Function = compiled
    return result


register_jitable(wrapped)  # plain Python for the world, which compiles nothing, and part of kernels here
