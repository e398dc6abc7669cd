"""Work that numba repeats or does for nobody, left out: the code that kernels are compiled to stays the same."""

from typing import Any

import llvmlite.binding as llvm
import numba.core.codegen
import numba.core.compiler
import numba.core.compiler_machinery
import numba.core.ir
import numba.core.postproc
import numba.core.runtime.context
import numba.core.transforms
import numba.core.types.functions
import numba.np.arrayobj
from numba.extending import overload

from agent.kernels import linking

_core: Any = numba.core  # untyped
_llvm: Any = llvm
_function: Any = _core.types.functions.BaseFunction
_instruction: Any = _core.ir.Inst
_variable: Any = _core.ir.Var
_passes: Any = _core.compiler_machinery._pass_registry
_find_call_type = _function.get_call_type
_call_types: dict[tuple[Any, tuple[Any, ...]], Any] = {}
_counted: dict[Any, bool] = {}  # by type, whether its values may hold a counter of references
_sizes: dict[str, int] = {}  # in bytes, by type of LLVM


def reduce() -> None:
    """Change numba for the rest of this process."""
    _core.compiler.Flags.values = _changed
    _core.postproc.PostProcessor.run = _find_lifetimes
    _core.compiler_machinery.PassManager._runPass = _run_pass
    _function.get_call_type = _call_type
    _core.codegen.CPUCodeLibrary._optimize_functions = _lay_out
    linking.reduce()
    _core.runtime.context.NRTContext.get_meminfos = _counters
    _instruction._rec_list_vars = _variables
    numba.np.arrayobj.raise_with_shape_context = _sizes_differ
    _core.compiler.Flags.options["no_cfunc_wrapper"]._default = True  # C calls no kernel
    _core.base.BaseContext.get_abi_sizeof = _size
    _llvm.ffi.lib._lock._cblist.clear()  # of timers, which are told of each call of LLVM


def _changed(flags: Any) -> dict[str, Any]:
    """Options of a compilation that are not the defaults, by name: flags are compared a hundred thousand times.

    They are equal where only the wrapper for Python differs, since numba compiles its own functions, such as np.empty,
    once for each different set of flags of their callers.
    """
    changed = {name: value for name, value in flags._values.items() if value != flags.options[name].default}
    return {**changed, "no_cpython_wrapper": True}


def _run_pass(self: Any, index: int, each: Any, state: Any) -> None:
    """Numba's own, without the words that it makes of all types before each of forty passes for listeners to events,
    without times, and without checks of what its own passes leave.
    """
    each.analysis = self._analysis
    each.run_initialization(state)
    mutated = each.run_pass(state)
    each.run_finalizer(state)
    if mutated and _passes.get(type(each)).mutates_CFG:
        _core.postproc.PostProcessor(state.func_ir).run()


def _find_lifetimes(self: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
    """Numba's own, without the variables alive at each block's entry: only generators and object mode ask for them.

    It runs nine times a function.
    """
    ir = self.func_ir
    ir.blocks = _core.transforms.canonicalize_cfg(ir.blocks)
    ir.variable_lifetime = _core.postproc.VariableLifetime(ir.blocks)
    ir.generator_info = None
    if emit_dels:
        self._insert_var_dels(extend_lifetimes=extend_lifetimes)


def _call_type(self: Any, context: Any, args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
    """Numba's own, asked once for the same types: a sum of two numbers is held against a dozen templates."""
    if kws:
        return _find_call_type(self, context, args, kws)
    if (self, args) not in _call_types:
        _call_types[self, args] = _find_call_type(self, context, args, kws)
    return _call_types[self, args]


def _lay_out(self: Any, module: Any) -> None:
    """Numba's own, without the passes over each function: those over the whole module do all that again."""
    module.data_layout = self._codegen._data_layout


def _counters(self: Any, builder: Any, kind: Any, value: Any) -> list[tuple[Any, Any]]:
    """The counters of references in a value, with their types: numba's own, which unpacks only what may hold one.

    Numba takes arrays apart to the last number of their shape whenever they are counted: a fifth of the code that LLVM
    reads, all of which it drops again.
    """
    models = self._context.data_model_manager
    model = models[kind]
    found = [(kind, model.get_nrt_meminfo(builder, value))] if model.has_nrt_meminfo() else []
    for inner, take in model.traverse(builder):
        if inner not in _counted:
            _counted[inner] = models[inner].contains_nrt_meminfo()
        if _counted[inner]:
            found += _counters(self, builder, inner, take(value))
    return found


def _variables(self: Any, value: Any) -> list[Any]:
    """The variables in what an instruction holds: numba's own, which asks a name, too, whether it is one of five."""
    kind = type(value)
    if kind is _variable:
        return [value]
    if kind is dict:
        return [variable for item in value.values() for variable in _variables(self, item)]
    if kind is list or kind is tuple:
        return [variable for item in value for variable in _variables(self, item)]
    return value.list_vars() if isinstance(value, _instruction) else []


def _size(self: Any, kind: Any) -> int:
    """Bytes of a type of LLVM: numba's own, asked once for each type: LLVM reads a module of text for an answer."""
    name = str(kind)
    if name not in _sizes:
        _sizes[name] = kind.get_abi_size(self.target_data)
    return _sizes[name]


def _sizes_differ(source: Any, target: Any) -> None:
    """Refuse an array where a slice of another size is assigned.

    Numba's own message names both sizes. The text functions for that take a tenth of the compile time of all kernels.
    """


@overload(_sizes_differ)
def _sizes_differ_compiled(source: Any, target: Any) -> Any:
    def refuse(source: Any, target: Any) -> None:
        raise ValueError("a slice is assigned an array of another size")

    return refuse
