"""How loops over walls and beams are compiled: one decorator for all kernels."""

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar, cast

from numba import types
from numba.core.registry import CPUDispatcher
from numba.extending import register_jitable

from agent.kernels import compile_time
from agent.kernels.cache import KernelCache
from agent.kernels.linking import Callee, NamedCompiler, by_name, is_large, make_machine_code
from protocol.geometry import compose, relative, wrapped

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compile a function for the types that it is first called with, or load what was compiled before."""
    return cast(Function, Kernel(function))


def shared_kernel(function: Function) -> Function:
    """A kernel that Python calls, and kernels with the same types: one form of it serves both."""
    return cast(Function, Compiled(function, called_by_python=True, called_by_kernels=True))


class Compiled(CPUDispatcher):
    """A function compiled for each combination of types that it is called with, once, and kept (`cache.py`)."""

    def __init__(self, function: Callable[..., Any], *, called_by_python: bool, called_by_kernels: bool) -> None:
        options = {"nopython": True, "error_model": "numpy", "no_cpython_wrapper": not called_by_python}
        cache = KernelCache(function, options)
        compiler: Any = partial(NamedCompiler, cache)
        super().__init__(function, targetoptions=options, pipeline_class=compiler)
        self._cache = cache
        if called_by_kernels:
            by_name[cache.name] = self

    def add_overload(self, cres: Any) -> None:
        """Take up what was compiled or loaded."""
        own = cres.library.own = Callee(self._cache.name, cres.signature.args, cres.fndesc.llvm_func_name)
        if is_large(cres.library, own):
            make_machine_code(cres.library)
        super().add_overload(cres)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Types of a call in another kernel, where a literal counts as any number of its type.

        Numba would compile a kernel anew for each number that a call writes as a literal.
        """
        unliteral: Any = types.unliteral
        plain = {name: unliteral(kind) for name, kind in kws.items()}
        return super().get_call_template(tuple(map(unliteral, args)), plain)


class Kernel(Compiled):
    """A kernel as Python calls it, and another form as kernels call it.

    Most kernels are called by kernels alone: they are spared the wrapper that unpacks Python's objects.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function, called_by_python=True, called_by_kernels=False)
        self._for_kernels = Compiled(function, called_by_python=False, called_by_kernels=True)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Types of a call in another kernel."""
        return self._for_kernels.get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        """The code that a call in another kernel jumps to."""
        return self._for_kernels.get_overload(sig)


compile_time.reduce()
for plain in (wrapped, compose, relative):
    register_jitable(plain)  # plain Python for the world, which compiles nothing, and part of kernels here
