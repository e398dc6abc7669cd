"""Kernels jump to large callees; numba would compile a copy of each callee's code into each of its callers.

So a compiled kernel is no longer whole: its callees are loaded before it. They find each other by symbols that are
the same in every process.
"""

from collections.abc import Iterable
from itertools import islice
from typing import Any, NamedTuple

from numba.core import codegen
from numba.core.bytecode import FunctionIdentity
from numba.core.compiler import Compiler
from numba.core.untyped_passes import ExtractByteCode

# Instructions of LLVM. It inlines at most about 55 (a cost of 275, 5 each), so what is larger runs at the same speed.
_LARGE = 100

_library: Any = codegen.CPUCodeLibrary  # untyped
_finalize = _library.finalize

by_name: dict[str, Any] = {}  # what kernels call, by module and name; filled where kernels are made


class Callee(NamedTuple):
    """Code that a kernel jumps to."""

    kernel: str
    arguments: tuple[Any, ...]  # types
    symbol: str


class NamedCompiler(Compiler):
    """Numba's own, which names the code by what it is made from, and not by a number that each process counts up."""

    def __init__(self, cache: Any, *context: Any) -> None:
        super().__init__(*context)
        self._cache = cache

    def compile_extra(self, func: Any) -> Any:
        """Compile a function."""
        state: Any = self.state
        state.func_id = FunctionIdentity.from_function(func)
        state.func_id.unique_id = self._cache.key(state.args, state.targetctx.codegen())
        ExtractByteCode().run_pass(state)
        state.lifted, state.lifted_from = (), None
        return self._compile_bytecode()


def callees(library: Any) -> list[Callee]:
    """Code that a library jumps to and does not contain, in a fixed order."""
    return list(getattr(library, "callees", ()))


def load(needed: Iterable[Callee]) -> None:
    """Load callees, or compile them.

    Raises:
        LookupError: where a callee is no longer made from the same sources.
    """
    for callee in needed:
        kernel = by_name[callee.kernel]
        kernel.compile(callee.arguments)
        if kernel.overloads[callee.arguments].fndesc.llvm_func_name != callee.symbol:
            raise LookupError(f"{callee.kernel} has changed")


def finalize(library: Any) -> None:
    """Link a library with copies of its small callees alone, then optimise and compile it."""
    copied, jumps = [], dict[Callee, None]()
    for linked in dict.fromkeys(library._linking_libraries):
        own = getattr(linked, "own", None)
        if own is not None and _is_large(linked, own):
            jumps[own] = None
        else:
            copied.append(linked)
            jumps.update(dict.fromkeys(callees(linked)))
    library._linking_libraries, library.callees = copied, list(jumps)
    _finalize(library)


def _is_large(library: Any, own: Callee) -> bool:
    function = library._get_module_for_linking().get_function(own.symbol)
    instructions = (instruction for block in function.blocks for instruction in block.instructions)
    return len(list(islice(instructions, _LARGE))) == _LARGE
