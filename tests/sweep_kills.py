"""`python -m tests.sweep_kills [KILLS] [RUNS]`: sweeps whose worker, scheduler or client is killed, at random moments.

One sweep a kind of victim, each with so many kills (10) over so many runs (60). A table of how many results there were
at each kill, and of what was lost. The status is 1 where results differ from the undisturbed ones, or one that was kept
was made again.
"""

import os
import random
import signal
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import psutil

from tests.deploy.sweep.sweeps import (
    FILE,
    SWEEP,
    a_worker,
    comparable,
    results,
    scheduler_of,
    started,
    undisturbed,
    wait_until,
    worker_of,
    write_sweep,
)

PORT = 18787
LATEST_S = 1.5
"""A kill comes so long after a new result, at most."""
STALL_S = 300.0


class Disturbed:
    """A sweep with a scheduler and two workers, all of them processes of this machine."""

    def __init__(self, folder: Path, runs: int) -> None:
        self.folder, self.runs, self.out = folder, runs, folder / "out"
        self._stack: dict[str, ExitStack] = {name: ExitStack() for name in ("client", "scheduler", "workers")}
        self.workers: list[psutil.Popen] = []
        self.start("scheduler")
        self.start("workers")
        self.start("client")

    def start(self, name: str) -> None:
        """Start a part, first or again."""
        enter = self._stack[name].enter_context
        match name:
            case "scheduler":
                self.scheduler = enter(started(*scheduler_of(PORT)))
            case "workers":
                self.workers = [enter(started(*worker_of(PORT, self.folder))) for _ in range(2)]
            case "client":
                address = f"tcp://127.0.0.1:{PORT}"
                command = [*SWEEP, self.folder / "sweep.yaml", "--out", self.out, "--scheduler", address, "--quiet"]
                self.client = enter(started(*command))

    def stop(self, *names: str) -> None:
        for name in names:
            self._stack[name].close()

    def kill_worker(self) -> None:
        """The process that works, which its keeper starts again."""
        os.kill(max(map(a_worker, self.workers), key=lambda one: one.cpu_times().user).pid, signal.SIGKILL)

    def kill_scheduler(self) -> None:
        """Its workers end with it; a cluster starts both again."""
        self.scheduler.kill()
        self.stop("scheduler", "workers")
        self.start("scheduler")
        self.start("workers")

    def kill_client(self) -> None:
        self.client.kill()
        self.stop("client")
        self.start("client")

    def complete(self) -> bool:
        return len(results(self.out)) == self.runs


def disturb(folder: Path, victim: str, kills: int, runs: int, rng: random.Random) -> list[int]:
    """Make a sweep with kills; how many results there were at each. Raises AssertionError for what was made again."""
    sweep = Disturbed(folder, runs)
    kill: Callable[[], None] = getattr(sweep, f"kill_{victim}")
    moments, kept = [], dict[Path, int]()
    try:
        for number in range(kills):
            due = max(len(kept) + 1, round(runs * (number + rng.random()) / (kills + 1)))
            wait_until(lambda due=due: len(results(sweep.out)) >= due, STALL_S)
            time.sleep(rng.uniform(0, LATEST_S))
            kept |= {path: path.stat().st_mtime_ns for path in results(sweep.out) if path not in kept}
            moments.append(len(kept))
            if sweep.complete():
                break
            kill()
        assert sweep.client.wait(STALL_S) == 0, sweep.client.stdout.read()
    finally:
        sweep.stop("client", "workers", "scheduler")
    again = [path.stem for path, written in kept.items() if path.stat().st_mtime_ns != written]
    assert not again, f"made again though kept: {again}"
    return moments


def main(kills: int = 10, runs: int = 60) -> int:
    """Kill, compare, and print a line for each kind of victim."""
    status = 0
    with TemporaryDirectory() as top:
        text = FILE.replace("seeds: 4", f"seeds: {runs // 2}")
        write_sweep(Path(top), text)
        due = undisturbed(Path(top))
        for victim in ("worker", "scheduler", "client"):
            folder = Path(top, victim)
            folder.mkdir()
            write_sweep(folder, text)
            began = time.monotonic()
            try:
                moments = disturb(folder, victim, kills, len(due), random.Random(victim))
                same = comparable(folder / "out") == due
                print(f"{victim}: {len(moments)} kills at {moments} of {len(due)}; ", end="")
                print(f"{'the same' if same else 'OTHER'} results, {time.monotonic() - began:.0f} s", flush=True)
                status |= not same
            except AssertionError as error:
                print(f"{victim}: {error}", flush=True)
                status = 1
    return status


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
