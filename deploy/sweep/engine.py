"""Tasks on Dask: worker processes on this machine, or those of a cluster.

What a task gives is kept as soon as it arrives, and what is kept is not asked for, so nothing that dies costs more
than the tasks in hand. Dask gives those of a dead worker to another one. Where the scheduler dies, its clients lose
sight of their tasks, and ask for those that are missing when it is there again.
"""

import logging
import shlex
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import dask
from distributed import Client, KilledWorker, LocalCluster, Security, as_completed

from deploy.revision import sources
from deploy.sweep.work import FAILED, OtherSourcesError, Row, WorkerTask, work
from protocol.errors import InputError, LinkError
from protocol.files import UnwritableError
from protocol.temporary import temporary_folder

PATIENCE_S = 300.0
"""So long a scheduler that is gone, or has no worker, is waited for: a container is up again within a minute or two."""
CONNECT_S = 5.0
RETRY_S = 0.5
SETTINGS = {
    "distributed.comm.timeouts.connect": CONNECT_S,
    "distributed.admin.system-monitor.gil.enabled": False,  # asks for the interpreter's lock a thousand times a second
    "distributed.worker.profile.enabled": False,  # looks at the run's stack a hundred times a second
    "distributed.worker.daemon": False,  # else no task may start processes
}


@contextmanager
def local_workers(workers: int) -> Iterator[tuple[str, Security]]:
    """Processes of this machine; yields the address of their scheduler, in this process, and what it takes to connect.

    Workers run what they are sent, so the links are encrypted with certificates that nobody else has.
    """
    with temporary_folder() as path, dask.config.set(SETTINGS | {"temporary-directory": (folder := str(path))}):
        security = Security.temporary()
        with LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",  # else two sweeps at once argue about a port
            security=security,
            memory_limit=0,  # a run takes what it takes; a limit would kill it
            local_directory=folder,
            env={"TMPDIR": folder},  # so that nothing stays of workers that are killed
            silence_logs=logging.CRITICAL,
        ) as cluster:
            yield cluster.scheduler_address, security


@contextmanager
def cluster(address: str, certs: Path | None) -> Iterator[tuple[str, Security | None]]:
    """Check the address of a cluster's scheduler; the same as local_workers. Raises InputError."""
    security = None
    if certs is not None:
        files = {"tls_ca_file": "ca.pem", "tls_client_cert": "viewer.pem", "tls_client_key": "viewer.key"}
        for name in files.values():
            if not (certs / name).is_file():
                make = f"wireswarm certs {shlex.quote(str(certs))}"
                raise InputError(f"--certs {certs}: {name} is missing; `{make}` makes it")
        paths: Any = {part: str(certs / name) for part, name in files.items()}
        security = Security(require_encryption=True, **paths)
    local = address.startswith(("tcp://127.", "tcp://localhost:"))
    if not ((address.startswith("tls://") and security) or (local and security is None)):
        raise InputError(
            f"--scheduler {address:.200}: write tls://HOST:8786 with --certs DIR, since whoever reaches a scheduler "
            "can run programs on its workers; tcp://127.0.0.1:8786 will do for one on this machine"
        )
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with dask.config.set(SETTINGS):
        yield address, security


def run_all(
    tasks: Sequence[WorkerTask],
    address: str,
    security: Security | None,
    keep: Callable[[Row], None],
    say: Callable[[str], None],
) -> None:
    """Do all tasks, and hand each row to `keep` when it arrives; `say` is told what is waited for.

    Raises LinkError where the scheduler or its workers stay away, or the workers cannot do the tasks, and what `keep`
    raises.
    """
    left = {task.key: task for task in tasks}
    doubted = set[str]()
    since = time.monotonic()  # when a scheduler with a worker was last there
    while left:
        try:
            with Client(address, security=security, timeout=CONNECT_S, set_as_default=False) as client:
                client.wait_for_workers(1, timeout=PATIENCE_S)
                asked = [task for key, task in left.items() if key not in doubted] or list(left.values())[:1]
                try:
                    for row in _results(client, asked, doubted):
                        keep(row)
                        del left[row["key"]]
                finally:
                    since = time.monotonic()  # not at the last result: a run may take longer than the patience lasts
        except UnwritableError:  # an OSError, too, but no fault of the link
            raise
        except (OSError, TimeoutError) as error:
            if time.monotonic() - since > PATIENCE_S:
                raise LinkError(f"no scheduler with a worker at {address} for {PATIENCE_S:g} s: {error}") from None
            say(f"no scheduler at {address}; it is waited for")
            time.sleep(RETRY_S)


def _results(client: Client, tasks: Sequence[WorkerTask], doubted: set[str]) -> Iterator[Row]:
    """Rows as they come; those whose tasks were lost with the scheduler are missing.

    So are those on which Dask gave up, once: it blames a worker's death on the tasks that wait there, too. Their keys
    are put into `doubted`, and fail where it happens again when they are asked for alone.
    """
    code = sources()
    named = {f"{task.key}-{code}": task for task in tasks}  # Dask does what has one name once, for all its clients
    futures = client.map(work, tasks, code=code, key=list(named), retries=0)
    arriving = as_completed(futures, loop=client.loop)
    del futures  # a future that is kept pins its result to a worker, and has it computed again where that dies
    for future in arriving:
        if future.status == "finished":
            yield future.result()
        elif isinstance(error := future.exception() if future.status == "error" else None, KilledWorker):
            if (task := named[future.key]).key in doubted:
                yield task.row(FAILED, f"its worker died {2 * (error.allowed_failures + 1)} times")
            doubted.add(task.key)
        elif isinstance(error, OtherSourcesError):
            raise LinkError(str(error))
        elif error is not None:
            raise LinkError(f"the workers cannot run it; have they wireswarm[sweep]? {type(error).__name__}: {error}")
        future.release()
