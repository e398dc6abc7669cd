"""Ends the server that processes are forked from with its launcher, also while it imports and hears no pipe."""

import os
import signal

from deploy.launch.forks import LAUNCHER

POLL_S = 0.2


def _look(number: int, frame: object) -> None:
    if os.getppid() != int(os.environ[LAUNCHER]):
        os._exit(0)


def let_go() -> None:
    """Look no longer: from here on the server itself waits for the launcher's end."""
    signal.setitimer(signal.ITIMER_REAL, 0.0)


signal.signal(signal.SIGALRM, _look)
signal.setitimer(signal.ITIMER_REAL, POLL_S, POLL_S)
