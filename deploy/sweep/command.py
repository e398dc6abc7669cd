"""`wireswarm sweep`: plan, leave out what is there, run the rest, keep each result."""

import json
import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from agent.limits import INCOMPLETE, doubts
from deploy.launch import forks
from deploy.launch.interrupts import on_interrupt
from deploy.revision import revision
from deploy.sweep.measure import task_of
from deploy.sweep.plan import Job, read_jobs
from deploy.sweep.progress import SweepProgress
from deploy.sweep.store import Store
from deploy.sweep.work import Row, WorkerTask
from protocol.command import say
from protocol.errors import InputError
from protocol.messages import RobotSpec
from protocol.status import Status

MOST_DOUBTS = 10
"""So many are said: drawn settings may make a robot, and a doubt, for each run."""


def sweep(
    file: Path,
    out: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    certs: Path | None = None,
    retry_failed: bool = False,
    quiet: bool = False,
) -> tuple[int, int, Path]:
    """Run what `out` lacks; returns how many results it has of the file's runs, how many of them failed, and where.

    Raises ConfigError, WorldFileError, InputError, LinkError and OSError.
    """
    if certs and not scheduler:
        raise InputError(f"--certs {certs}: they are for a cluster, so name its --scheduler, too")
    if workers and scheduler:
        raise InputError(f"--workers {workers}: a cluster has its own, so leave out this or --scheduler")
    jobs = read_jobs(file)
    _say_doubts(jobs)
    tasks = [task_of(job) for job in jobs]
    code = revision()
    try:
        store = Store(out / code, code)
    except OSError as error:
        raise InputError(f"--out {out}: {error.strerror}; name a directory that can be written") from None
    fill(store, tasks, workers, scheduler=scheduler, certs=certs, retry_failed=retry_failed, quiet=quiet)
    return len(tasks), len(store.failed() & {task.key for task in tasks}), store.place


def fill(
    store: Store,
    tasks: Sequence[WorkerTask],
    workers: int | None = None,
    *,
    scheduler: str | None = None,
    certs: Path | None = None,
    retry_failed: bool = False,
    quiet: bool = False,
) -> None:
    """Do those tasks of which the store has no result. Raises InputError, LinkError and OSError."""
    if not _left(store, tasks, retry_failed):
        return  # a store that is full may be read by many at a time
    with store.alone():
        if not (left := _left(store, tasks, retry_failed)):
            return
        from deploy.sweep.engine import cluster, local_workers, run_all

        with SweepProgress(len(left), quiet) as progress, on_interrupt(lambda: _leave(progress)):
            if len(left) < len(tasks):
                progress.say(f"{len(tasks) - len(left)} of {len(tasks)} results are in {store.place}")
            ours = local_workers(min(workers or os.cpu_count() or 1, len(left)))

            def keep(row: Row) -> None:
                store.keep(row)
                progress.arrived(row)

            with cluster(scheduler, certs) if scheduler else ours as (address, security):
                run_all(left, address, security, keep, progress.say)


def _left(store: Store, tasks: Sequence[WorkerTask], retry_failed: bool) -> list[WorkerTask]:
    """Tasks of which the store has no result."""
    kept = store.kept() - (store.failed() if retry_failed else set())
    return [task for task in tasks if task.key not in kept]


def _say_doubts(jobs: Sequence[Job]) -> None:
    """Tell why complete maps are not to be expected, and of how many runs, before they are made."""
    robots, found = Counter(json.dumps(job.config["spec"]) for job in jobs), Counter[str]()
    for spec, runs in robots.items():
        for doubt in doubts(RobotSpec.model_validate_json(spec)):
            found[doubt] += runs
    for doubt, runs in found.most_common(MOST_DOUBTS):
        say(f"{INCOMPLETE} of {runs} runs of {len(jobs)}: {doubt}")
    if len(found) > MOST_DOUBTS:
        say(f"doubts of this kind that are not listed: {len(found) - MOST_DOUBTS}")


def _leave(progress: SweepProgress) -> None:
    """End at once, with the workers: what has arrived is kept, and a run under way is made again."""
    progress.__exit__()
    progress.say("interrupted; the same command goes on from here")
    forks.leave(Status.INTERRUPTED)
