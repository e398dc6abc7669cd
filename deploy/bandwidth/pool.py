"""Processes among which a measurement is divided: one a core, which end with the one that began them."""

import multiprocessing
import os
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager

from deploy.launch import forks


@contextmanager
def processes() -> Iterator[Executor]:
    """As many as there are cores. Where something is raised, they are killed rather than waited for."""
    forks.begin()
    with ProcessPoolExecutor(len(os.sched_getaffinity(0)), forks.CONTEXT, _end_with_parent) as pool:
        try:
            yield pool
        except BaseException:
            for process in multiprocessing.active_children():
                process.kill()
            raise


def _end_with_parent() -> None:
    """End at once where the process that asks is killed: nobody else would say so."""

    def wait() -> None:
        parent = multiprocessing.parent_process()
        assert parent is not None
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
