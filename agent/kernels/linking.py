"""Kernels jump to large callees; numba would compile a copy of each callee's code into each of its callers.

So a compiled kernel is no longer whole: its callees are loaded before it. They find each other by symbols that are
the same in every process. What is only copied gets no machine code of its own.
"""

from collections.abc import Iterable
from itertools import islice
from typing import Any, NamedTuple

from numba.core import codegen
from numba.core.bytecode import FunctionIdentity
from numba.core.compiler import Compiler
from numba.core.environment import lookup_environment
from numba.core.untyped_passes import ExtractByteCode

# Instructions of LLVM. It inlines at most about 55 (a cost of 275, 5 each), so what is larger runs at the same speed.
_LARGE = 100

_library: Any = codegen.JITCodeLibrary  # untyped
_codegen: Any = codegen.JITCPUCodegen
_finalize = _library.finalize
_compile = _library._finalize_final_module
_address = _library.get_pointer_to_function
_with_object_code = _library.serialize_using_object_code
_set_environment = _codegen.set_env

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
        if own is not None and is_large(linked, own):
            jumps[own] = None
        else:
            copied.append(linked)
            jumps.update(dict.fromkeys(callees(linked)))
    library._linking_libraries, library.callees = copied, list(jumps)
    _finalize(library)


def is_large(library: Any, own: Callee) -> bool:
    """Whether callers jump to the code of a library, and do not copy it. Counted once, and kept with the library."""
    if not hasattr(library, "large"):
        function = library._get_module_for_linking().get_function(own.symbol)
        instructions = (instruction for block in function.blocks for instruction in block.instructions)
        library.large = len(list(islice(instructions, _LARGE))) == _LARGE
    return bool(library.large)


def reduce() -> None:
    """Change numba for the rest of this process."""
    _library.finalize = finalize
    _library._finalize_final_module = _leave_without_machine_code
    _library.get_pointer_to_function = _address_of
    _library.serialize_using_object_code = _serialized
    _codegen.set_env = _set_environment_where_read


def make_machine_code(library: Any) -> None:
    """Compile a library, or load its machine code, for calls from Python and jumps."""
    if hasattr(library, "made"):
        return
    library.made = True
    _compile(library)
    for module in (library._final_module, library._shared_module):
        for variable in () if module is None else module.global_variables:
            environment = lookup_environment(variable.name)
            if environment is not None:
                library.codegen.set_env(variable.name, environment)


def _leave_without_machine_code(library: Any) -> None:
    """Finish a library whose callers may all copy it."""
    library._finalize_dynamic_globals()
    library._finalized = True
    if getattr(library, "_compiled_object", None) is not None:  # it was loaded with its machine code
        make_machine_code(library)


def _address_of(library: Any, name: str) -> int:
    """The address of a function that Python is about to call, or 0 where the library does not hold it."""
    library._ensure_finalized()
    module = library._shared_module or library._final_module
    if any(function.name == name and not function.is_declaration for function in module.functions):
        make_machine_code(library)
    return int(_address(library, name))


def _serialized(library: Any) -> Any:
    """A library for the cache; without machine code where it has none."""
    if hasattr(library, "made"):
        return _with_object_code(library)
    return library.name, "bitcode", library._get_module_for_linking().as_bitcode()


def _set_environment_where_read(self: Any, name: str, environment: Any) -> None:
    """Tell machine code where its constants that are Python objects are."""
    if self._engine.is_symbol_defined(name):
        _set_environment(self, name, environment)
