"""What a worker does for a sweep or a benchmark: one task, whose result is a row."""

import socket
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from deploy.revision import sources

Row = dict[str, Any]
"""Numbers, texts and None by the name of their column."""

OK, FAILED = "ok", "failed"
"""How it went with a task, in the column `status`; of a failed one, `reason` says why."""


class OtherSourcesError(RuntimeError):
    """The worker's code, or a mind of your own on it, is not that of the command that asks it for a task."""


class WorkerTask(NamedTuple):
    """A call of a function that other processes find by its name."""

    key: str
    """Hash of all that decides its result."""
    label: Row
    """Columns that tell which task it is; `settings` among them, as JSON."""
    call: Callable[..., Row]
    """Makes the other columns."""
    arguments: tuple[Any, ...]

    def row(self, status: str, reason: str = "") -> Row:
        """The columns of every task's row."""
        return {"key": self.key, "status": status, "reason": reason, **self.label}


def work(task: WorkerTask, code: str) -> Row:
    """Do a task in this process. What it raises makes a row that says so. Raises OtherSourcesError.

    code: what `deploy.revision.sources` is on the machine that asks.
    """
    if sources() != code:
        raise OtherSourcesError(f"{socket.gethostname()} has another version of wireswarm: install the same there")
    began, cpu = time.perf_counter(), time.thread_time()
    try:
        row = task.row(OK) | task.call(*task.arguments)
    except OtherSourcesError:
        raise
    except Exception as error:
        said = f"{type(error).__name__}: {error}"  # it may quote a file's name, which need not be UTF-8
        row = task.row(FAILED, said.encode(errors="backslashreplace").decode())
    took = {"cpu_s": time.thread_time() - cpu, "wall_s": time.perf_counter() - began}
    return row | {f"machine.{name}": round(value, 3) for name, value in took.items()}
