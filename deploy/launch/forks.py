"""The server from which a run's world and robots are forked. It loads for a second, so it begins first of all."""

import json
import multiprocessing
import os
import signal
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import forkserver, resource_tracker, util
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from protocol import temporary

if TYPE_CHECKING:
    import psutil

PRELOAD = ["deploy.launch.preload", "__main__"]
"""What all of them have in common, and the script that was started, as a fork would import it, too: a robot takes 7 MiB
instead of 27, and is up after 10 ms of CPU instead of 70 (measured)."""

CONTEXT = multiprocessing.get_context("forkserver")

LAUNCHER = "WIRESWARM_LAUNCHER"
"""Tells the server in its environment who launches: where that is killed at once, it has another parent already."""

BEFORE = "WIRESWARM_BEFORE"
"""Tells a Python that is started in `searching_as_here` what that changed in its environment, as JSON."""

SOCKET_BYTES = 107 - len("/pymp-12345678/listener-12345678")
"""The longest path of a temporary folder in which its socket can have a name: Linux takes 107 bytes (unix(7))."""

KILLED_S = 1.0
"""So long killed processes are waited for."""


def begin() -> None:
    """Begin it, where it has not begun; it loads while its caller goes on, and ends with it. Raises OSError."""
    CONTEXT.set_forkserver_preload(PRELOAD)
    os.environ[LAUNCHER] = str(os.getpid())
    if len(os.fsencode(own := tempfile.gettempdir())) > SOCKET_BYTES:
        tempfile.tempdir = "/tmp"
    temporary.remove_with_process(util.get_temp_dir())  # of multiprocessing: the first who asks makes it
    tempfile.tempdir = own
    resource_tracker.ensure_running()  # the next line would do so, and unblock the signal
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # children inherit it: Ctrl-C is the launcher's
    try:
        with searching_as_here():
            forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


@contextmanager
def searching_as_here() -> Iterator[None]:
    """A Python that is started inside looks for modules first where this one does.

    With -c or -m it would look into the working folder, where somebody may have an `agent` or a `world` of his own.
    """
    there = os.pathsep.join([str(Path(sys.path[0]).absolute()), *filter(None, [os.environ.get("PYTHONPATH")])])
    changed = {"PYTHONSAFEPATH": "1", "PYTHONPATH": there}
    before = json.dumps({name: os.environ.get(name) for name in changed})
    os.environ.update(changed | {BEFORE: before})
    try:
        yield
    finally:
        search_as_before()


def search_as_before() -> None:
    """Undo `searching_as_here`, also in a Python that was started inside, for what that starts in turn."""
    for name, value in json.loads(os.environ.pop(BEFORE, "{}")).items():
        os.environ.pop(name, None)
        if value is not None:
            os.environ[name] = value


def kill() -> "list[psutil.Process]":
    """Kill all children of this process, with the server, in which a start of one may wait, and theirs; returns them.

    Those in a session of their own are left: a view ends by itself with this process, and a browser is the user's.
    """
    import psutil

    killed, session = [], os.getsid(0)
    for process in psutil.Process().children(recursive=True):
        with suppress(psutil.NoSuchProcess, ProcessLookupError):
            if os.getsid(process.pid) == session:
                process.kill()
                killed.append(process)
    return killed


def leave(status: int) -> NoReturn:
    """End at once, also from a signal's handler, with the children that `kill` kills; nothing stays of them."""
    import psutil

    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # other threads see their processes die, and would say so
    psutil.wait_procs(kill(), timeout=KILLED_S)  # one that still writes into a folder would keep it
    temporary.leave(status)
