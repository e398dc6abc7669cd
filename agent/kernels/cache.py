"""Where compiled kernels are kept: a file for each kernel and types of arguments, named after all it was made from.

Numba's own cache knows a kernel by its file's time and line, so an edited comment compiles a file anew, and an edited
callee in another file goes unnoticed. Here a kernel is known by its bytecode, and by those kernels, constants and
records that it reads: the same in every checkout, image and time, and nothing stale is ever loaded.
"""

import hashlib
import os
import pickle
import sys
import zlib
from collections.abc import Callable, Iterator
from functools import cache, cached_property
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core import serialize, types
from numba.core.caching import CompileResultCacheImpl, _Cache
from numba.core.runtime.nrt import rtsys

from agent.kernels import linking
from protocol.files import write_whole

IN_PACKAGE = Path(__file__).parents[1] / "__pycache__" / "kernels"  # filled at installation, and found by all users

FORMAT = 3
"""Of what is kept: a file of another one has another name."""

COMPRESSION = 1
"""Level of zlib: 2.0 of 4.4 MB are left of all kernels, which 20 ms unpack; level 9 leaves 1.9."""


class KernelCache(_Cache):
    """What one kernel was compiled to, by the types of its arguments; in the form that numba's dispatcher asks for."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        self._function = function
        self.name = f"{function.__module__}.{function.__qualname__}".replace("<locals>.", "")
        self._options = options
        self._impl: Any = _Reduced(function)

    @property
    def cache_path(self) -> str:
        """The folder that is looked at first."""
        return str(folders()[0])

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what was compiled for a signature, or None where it is kept nowhere or cannot be read."""
        rtsys.initialize(target_context)  # arrays are counted; all that compiling needs besides is not looked up
        name = self._file(sig, target_context.codegen())
        for folder in folders():
            try:
                return self._impl.rebuild(target_context, pickle.loads(zlib.decompress((folder / name).read_bytes())))
            except Exception:  # not there, cut off, or of another build of numba
                continue
        announce()
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled in the first folder that can be written, instead of that kernel's older versions."""
        if not self._impl.check_cachable(data):
            return
        name = self._file(sig, data.codegen)
        content = zlib.compress(serialize.dumps(self._impl.reduce(data)), COMPRESSION)
        for folder in folders():
            try:
                folder.mkdir(parents=True, exist_ok=True)
                write_whole(folder / name, content)
                for old in folder.glob(f"{self.name}-*"):
                    if not old.name.startswith(f"{self.name}-{self.version}-"):
                        old.unlink(missing_ok=True)
            except OSError:
                continue
            return
        _warn()

    def flush(self) -> None:
        """Do nothing: the cache is always on, and what was made from other sources has another name."""

    enable = disable = flush

    @cached_property
    def version(self) -> str:
        """Hash of the kernel and all that it reads. Asked for at the first call, when all modules are complete."""
        made_by = FORMAT, sys.version_info[:2], numba.__version__, llvmlite.__version__
        texts = "".join([*map(repr, made_by), *_sources(self._function, set())])
        return hashlib.sha256(texts.encode()).hexdigest()[:16]

    def key(self, sig: Any, codegen: Any) -> str:
        """Hash of all that makes the compiled kernel what it is, for a signature and a processor."""
        built_for = "".join(map(_described, sig)) + repr((codegen.magic_tuple(), sorted(self._options.items())))
        return f"{self.version}-{hashlib.sha256(built_for.encode()).hexdigest()[:16]}"

    def _file(self, sig: Any, codegen: Any) -> str:
        return f"{self.name}-{self.key(sig, codegen)}"


class _Reduced(CompileResultCacheImpl):
    """How numba makes a compiled kernel into bytes and back, with its callees, and without its choice of a folder."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._lineno = function.__code__.co_firstlineno
        self._locator = self
        self._py_file = function.__code__.co_filename

    def reduce(self, cres: Any) -> Any:
        readable = cres._replace(type_annotation="")  # numba keeps half of a file of text for people
        return linking.callees(cres.library), cres.library.large, super().reduce(readable)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        callees, large, compiled = payload
        linking.load(callees)
        cres: Any = super().rebuild(target_context, compiled)
        cres.library.callees, cres.library.large = callees, large
        return cres


def folders() -> list[Path]:
    """Where compiled kernels are looked for, best first: NUMBA_CACHE_DIR alone, else the package's and the user's."""
    if asked := os.environ.get("NUMBA_CACHE_DIR"):
        return [Path(asked)]
    users = Path(os.environ.get("XDG_CACHE_HOME") or Path(os.path.expanduser("~"), ".cache"))  # noqa: PTH111
    return [IN_PACKAGE, users / "wireswarm" / "kernels"]


@cache  # once, and not in forks
def announce() -> None:
    """Say on stderr why nothing else happens for a while."""
    print("wireswarm: compiling kernels, about half a minute of two cores", file=sys.stderr, flush=True)


@cache  # once
def _warn() -> None:
    places = " nor ".join(map(str, folders()))
    print(f"wireswarm compiles its kernels at every start: it can write neither {places}.", file=sys.stderr)


def _sources(value: Any, met: set[Any]) -> Iterator[str]:
    """All that a value brings into a kernel: code, and what that reads of its module; each once, in a fixed order."""
    value = getattr(value, "py_func", value)
    if isinstance(value, ModuleType | BuiltinFunctionType | np.ufunc):
        yield value.__name__
    elif isinstance(value, FunctionType | type):
        yield f"{value.__module__}.{value.__qualname__}"
        if value in met or value.__module__.partition(".")[0] in ("numba", "numpy"):
            return
        met.add(value)
        if isinstance(value, FunctionType):
            yield _text(value)
            yield from _sources(value.__defaults__, met)
            for name, read in _read(value):
                yield name
                yield from _sources(read, met)
        else:
            yield f"{getattr(value, '_fields', ())}{getattr(value, '_field_defaults', {})}"
    elif isinstance(value, tuple):
        yield from _sources(type(value), met)
        for item in value:
            yield from _sources(item, met)
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype}{value.shape}{value.tobytes().hex()}"
    else:
        yield repr(value)


@cache  # most functions are read by many kernels
def _read(function: FunctionType) -> list[tuple[str, Any]]:
    """What a function reads of its module, of modules of this project that it names, and of functions around it."""
    read = []
    names = list(_names(function.__code__))
    for name in names:
        value = function.__globals__.get(name)
        read.append((name, value))
        if isinstance(value, ModuleType) and value.__name__.partition(".")[0] not in ("numba", "numpy", "math"):
            read += [(other, vars(value)[other]) for other in names if other in vars(value)]
    return read + [("", cell.cell_contents) for cell in function.__closure__ or ()]


@cache  # likewise
def _text(function: FunctionType) -> str:
    return "".join(_code(function.__code__, function.__doc__))


def _code(code: CodeType, docstring: str | None) -> Iterator[str]:
    """What a function does and how it is called, without its docstring and the numbers of its lines."""
    yield f"{code.co_code.hex()}{code.co_names}{code.co_varnames}{code.co_argcount}{code.co_kwonlyargcount}"
    for index, const in enumerate(code.co_consts):
        if isinstance(const, CodeType):
            yield from _code(const, None)
        elif index or docstring is None or const != docstring:
            yield f"{const!r};"


def _names(code: CodeType) -> Iterator[str]:
    """Names that a function may read, those of functions in it too."""
    yield from code.co_names
    for const in code.co_consts:
        if isinstance(const, CodeType):
            yield from _names(const)


def _described(argument: Any) -> str:
    """The type of an argument; of a NamedTuple with its fields, which numba's name for it leaves out."""
    if isinstance(argument, types.NamedTuple | types.NamedUniTuple):
        made = argument.instance_class
        return f"{made.__module__}.{made.__qualname__}{argument.fields}({', '.join(map(_described, argument.types))})"
    return f"{argument};"
