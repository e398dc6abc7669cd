"""wireswarm for notebooks and scripts: run robots in one process, load run directories, see their maps as arrays.

    import wireswarm
    run = wireswarm.run(world="apartment", robots=2, seed=0, until=60)
    run.map("r1", frame="world").vertices      # (n, 2), metres
    run.plot()

docs/notebook.md is a worked example. Numpy, numba, pymunk and matplotlib are imported when they are needed.
"""

from __future__ import annotations

import sys
from pathlib import Path

from wireswarm.interrupts import leave_at_once

# Programs of others keep their Ctrl-C. While a package is imported for -m, argv[0] is that, whatever package it is.
_PROGRAM = sys.orig_argv[-len(sys.argv) :][0] if sys.argv[0] == "-m" else Path(sys.argv[0]).name
_IS_OURS = _PROGRAM.removeprefix("-m") == "wireswarm"
if _IS_OURS:
    leave_at_once()  # before more is imported

from importlib import import_module
from typing import TYPE_CHECKING, Any

from wireswarm.guard import ForeignPackageError, check_packages

if TYPE_CHECKING:
    from deploy.report.rundir import Map, Run
    from protocol.wireframe import Label
    from wireswarm.environment import parallel_env, vector_env
    from wireswarm.runs import load, run, worlds

__all__ = [
    "ForeignPackageError", "Label", "Map", "Run", "load", "parallel_env", "run", "vector_env", "worlds",
]  # fmt: skip

# modules that are imported at their first use
_HOMES = {"Label": "protocol.wireframe"} | dict.fromkeys(("Map", "Run"), "deploy.report.rundir")
_HOMES |= dict.fromkeys(("load", "run", "worlds"), "wireswarm.runs")
_HOMES |= dict.fromkeys(("parallel_env", "vector_env"), "wireswarm.environment")

try:
    check_packages()
except ForeignPackageError as _error:
    if not _IS_OURS:
        raise
    print(f"wireswarm: {_error}", file=sys.stderr)  # the command imports this package before anything else
    sys.exit(2)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'wireswarm' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
