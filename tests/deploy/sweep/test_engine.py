"""A sweep's runs: made once, kept at once, and complete whatever is killed."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from deploy.revision import revision, sources
from deploy.sweep.command import sweep
from deploy.sweep.measure import task_of
from deploy.sweep.plan import Job, read_jobs
from deploy.sweep.store import Store, read_rows
from deploy.sweep.work import FAILED, work
from protocol.errors import InputError
from tests.deploy.sweep.sweeps import RUNS, comparable, write_sweep

SWEEP = [sys.executable, "-m", "wireswarm", "sweep"]


def undisturbed(folder: Path) -> dict[str, object]:
    """Results that no Dask was needed for."""
    store = Store(folder / "undisturbed", revision())
    for job in read_jobs(folder / "sweep.yaml"):
        store.keep(work(task_of(job), sources()))
    return dict(comparable(store.place))


@contextmanager
def started(*command: object) -> Iterator[psutil.Popen]:
    process = psutil.Popen([str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield process
    finally:
        for child in (*process.children(recursive=True), process) if process.is_running() else ():
            child.kill()
        process.wait(20)


def wait_until(true: Callable[[], object], limit_s: float = 100) -> None:
    end = time.monotonic() + limit_s
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def results(folder: Path) -> list[Path]:
    return list(folder.rglob("*.parquet"))


def a_worker(client: psutil.Process) -> psutil.Process:
    """One that is at work: the process that has spent the most time."""
    return max(client.children(recursive=True), key=lambda child: child.cpu_times().user)


def test_a_killed_worker_loses_nothing_and_a_second_start_runs_nothing(tmp_path: Path) -> None:
    file, out = write_sweep(tmp_path), tmp_path / "out"
    with started(*SWEEP, file, "--out", out, "--workers", 2) as client:
        wait_until(lambda: results(out))
        os.kill(a_worker(client).pid, signal.SIGKILL)
        told = client.communicate(timeout=100)[0]
    assert client.returncode == 0, told
    assert comparable(out) == undisturbed(tmp_path) and len(comparable(out)) == RUNS
    before = {path: path.stat().st_mtime_ns for path in results(out)}
    began = time.process_time()
    assert sweep(file, out, quiet=True)[:2] == (RUNS, 0)
    assert time.process_time() - began < 5
    assert before == {path: path.stat().st_mtime_ns for path in results(out)}


@pytest.mark.slow
def test_a_killed_client_loses_nothing_and_leaves_no_process(tmp_path: Path) -> None:
    file, out = write_sweep(tmp_path), tmp_path / "out"
    with started(*SWEEP, file, "--out", out, "--workers", 1) as client:
        wait_until(lambda: len(results(out)) >= 2)
        children = client.children(recursive=True)
        client.kill()
        psutil.wait_procs(children, timeout=20)
        assert not [child for child in children if child.is_running()]
    before = {path: path.stat().st_mtime_ns for path in results(out)}
    assert 2 <= len(before) < RUNS
    assert sweep(file, out, workers=1, quiet=True)[:2] == (RUNS, 0)
    assert before.items() <= {path: path.stat().st_mtime_ns for path in results(out)}.items()
    assert comparable(out) == undisturbed(tmp_path)


@pytest.mark.slow
def test_a_killed_scheduler_loses_nothing_where_it_comes_back(tmp_path: Path) -> None:
    file, out, address = write_sweep(tmp_path), tmp_path / "out", "tcp://127.0.0.1:18786"
    scheduler = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", 18786]
    scheduler += ["--no-dashboard"]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", 1, "--no-dashboard"]
    worker += ["--local-directory", tmp_path]
    with started(*SWEEP, file, "--out", out, "--scheduler", address) as client:
        with started(*scheduler) as first, started(*worker):
            wait_until(lambda: results(out))
            first.kill()
        assert len(results(out)) < RUNS
        with started(*scheduler), started(*worker):
            told = client.communicate(timeout=100)[0]
    assert client.returncode == 0, told
    assert comparable(out) == undisturbed(tmp_path)


def test_a_failed_run_is_a_row_with_its_reason_and_is_made_again_where_asked(tmp_path: Path) -> None:
    file = write_sweep(tmp_path, "worlds: [tiny.yaml]\nsettings: {until: 2, robots: 400}")
    assert sweep(file, tmp_path / "out", workers=1, quiet=True)[:2] == (1, 1)
    (row,) = read_rows(tmp_path / "out")
    assert row["status"] == FAILED and "WorldFileError" in row["reason"]
    (path,) = results(tmp_path / "out")
    before = path.stat().st_mtime_ns
    sweep(file, tmp_path / "out", workers=1, quiet=True)
    assert path.stat().st_mtime_ns == before
    sweep(file, tmp_path / "out", workers=1, quiet=True, retry_failed=True)
    assert path.stat().st_mtime_ns > before


def test_a_worker_with_other_sources_refuses() -> None:
    with pytest.raises(RuntimeError, match="another version"):
        work(task_of(Job("key", {}, {})), "0123")


@pytest.mark.parametrize("address", ["tls://10.0.0.1:8786", "tcp://10.0.0.1:8786", "10.0.0.1"])
def test_a_scheduler_that_anybody_could_reach_is_refused(tmp_path: Path, address: str) -> None:
    with pytest.raises(InputError, match="--certs DIR"):
        sweep(write_sweep(tmp_path), tmp_path / "out", scheduler=address)


def test_a_file_that_is_no_result_is_named(tmp_path: Path) -> None:
    (tmp_path / "bad.parquet").write_bytes(b"PAR1")
    with pytest.raises(InputError, match=r"bad\.parquet: no result of a sweep"):
        list(read_rows(tmp_path))
