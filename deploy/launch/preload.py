"""What all processes of a run have in common; imported once, by the server that they are forked from."""

import gc
import sys
from pickle import UnpicklingError
from types import TracebackType

from deploy.launch import leash


def _untold(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """A launcher that is killed while it forks leaves a child that was told nothing: no mistake of any program."""
    if kind not in (EOFError, UnpicklingError):
        sys.__excepthook__(kind, error, trace)


def _load() -> None:
    """Import what all use, and load the kernels.

    All of it lives on: to look it through for garbage takes a seventh of the time here, and in forks copies memory.
    """
    gc.disable()
    import agent.shell.process  # noqa: F401
    import deploy.launch.processes  # noqa: F401
    from agent.warmup import rehearse
    from deploy.launch.forks import search_as_before

    rehearse()
    leash.let_go()
    search_as_before()  # what a mind starts finds modules as it is used to
    gc.freeze()
    gc.enable()


sys.excepthook = _untold  # of forks that have not begun; later ones print what is raised by themselves
_load()
