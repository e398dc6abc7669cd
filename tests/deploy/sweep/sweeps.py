"""A sweep of short runs in a small room, its processes, and what its results must have in common however disturbed."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil

from deploy.revision import revision, sources
from deploy.sweep.measure import task_of
from deploy.sweep.plan import read_jobs
from deploy.sweep.store import Store, read_rows
from deploy.sweep.work import Row, work
from tests.tiny import ROOM

RUNS = 8
FILE = """\
worlds: [tiny.yaml]
seeds: 4
settings: {until: 4, starts: random}
grid:
  robots: [1, 2]
"""
LIMIT_S = 100.0


def write_sweep(folder: Path, text: str = FILE) -> Path:
    (folder / "tiny.yaml").write_text(ROOM)
    file = folder / "sweep.yaml"
    file.write_text(text)
    return file


def comparable(folder: Path) -> dict[str, Row]:
    """Rows by key, without what depends on the machine."""
    rows = {row["key"]: row for row in read_rows(folder)}
    return {
        key: {name: value for name, value in row.items() if not name.startswith("machine.")}
        for key, row in rows.items()
    }


SWEEP = [sys.executable, "-m", "wireswarm", "sweep"]


def undisturbed(folder: Path) -> dict[str, Row]:
    """Results that no Dask was needed for."""
    store = Store(folder / "undisturbed", revision())
    for job in read_jobs(folder / "sweep.yaml"):
        store.keep(work(task_of(job), sources()))
    return comparable(store.place)


@contextmanager
def started(*command: object) -> Iterator[psutil.Popen]:
    process = psutil.Popen([str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield process
    finally:
        for child in (*process.children(recursive=True), process) if process.is_running() else ():
            child.kill()
        process.wait(20)


def wait_until(true: Callable[[], object], limit_s: float = LIMIT_S) -> None:
    end = time.monotonic() + limit_s
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def results(folder: Path) -> list[Path]:
    return list(folder.rglob("*.parquet"))


def a_worker(client: psutil.Process) -> psutil.Process:
    """One that is at work: the process that has spent the most time."""
    return max(client.children(recursive=True), key=lambda child: child.cpu_times().user)


def scheduler_of(port: int) -> list[object]:
    """Command of a scheduler on this machine."""
    module = "distributed.cli.dask_scheduler"
    return [sys.executable, "-m", module, "--host", "127.0.0.1", "--port", port, "--no-dashboard"]


def worker_of(port: int, folder: Path) -> list[object]:
    """Command of a worker of that scheduler."""
    module, address = "distributed.cli.dask_worker", f"tcp://127.0.0.1:{port}"
    options = ["--nthreads", 1, "--no-dashboard", "--local-directory", folder]
    return [sys.executable, "-m", module, address, *options]
