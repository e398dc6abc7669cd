"""`wireswarm run --view`: a view in a process of its own, so that the run pays nothing for it."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from typer import Exit

from deploy.launch.forks import searching_as_here
from deploy.launch.interrupts import on_interrupt
from protocol.command import say
from protocol.status import Status

READY = "ready"
"""First word of that process on its stdout."""


@contextmanager
def beside(run: Path) -> Iterator[None]:
    """A view of the run that is made inside, in a process of its own; after the run it stays until a signal.

    It has a session of its own, as Ctrl-C is the launcher's, and what ends that at once does not kill a view
    (`forks.kill`): it ends with its parent, and takes its temporary folder along.
    """
    command = [sys.executable, "-m", "wireswarm", "view", str(run), "--beside"]
    with searching_as_here():
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, start_new_session=True)
    assert process.stdout is not None
    try:
        process.stdout.readline()  # READY, so that it misses nothing; or its end
        yield
    except Exit as ended:
        if ended.exit_code not in (Status.INTERRUPTED, Status.USAGE) and process.poll() is None:
            with on_interrupt(process.terminate):
                say("the view stays until Ctrl-C")
                process.wait()
        raise
    finally:
        process.terminate()
        process.wait()
