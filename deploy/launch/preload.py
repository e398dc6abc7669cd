"""What all processes of a run have in common; imported once, by the server that they are forked from."""

import sys
from pickle import UnpicklingError
from types import TracebackType

from agent.warmup import rehearse
from deploy.launch import leash


def _untold(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """A launcher that is killed while it forks leaves a child that was told nothing: no mistake of any program."""
    if kind not in (EOFError, UnpicklingError):
        sys.__excepthook__(kind, error, trace)


sys.excepthook = _untold  # of forks that have not begun; later ones print what is raised by themselves
rehearse()
leash.let_go()
