"""A run of the tiny world that is to be disturbed, and a machine that is busy."""

import json
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil

from tests.tiny import ROOM

REPO = Path(__file__).parents[1]
BUSY = max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))  # how much longer this machine takes than one that is not
BEGUN_S = 100.0  # bound of waits for a phase to begin, on a machine that is busy with others
AS_TERMINAL = ("env", "--default-signal=INT")  # a shell's job in the background, and what it starts, ignores Ctrl-C


class Command:
    """`wireswarm run` in a session of its own, and the processes that it starts."""

    def __init__(self, folder: Path, *options: str) -> None:
        """Start it; the run directory is `out` in the folder."""
        (folder / "tiny.yaml").write_text(ROOM)
        self.out = folder / "out"
        self.popen = subprocess.Popen(
            [*AS_TERMINAL, sys.executable, "-m", "wireswarm", "run", "--world", "tiny.yaml", "--out", "out", *options],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(REPO)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self.processes: list[psutil.Process] = []

    def wait_for(self, file: str) -> None:
        """Wait until the run directory has a file, and note all processes."""
        end = time.monotonic() + BEGUN_S
        while not (self.out / file).exists():
            assert self.popen.poll() is None and time.monotonic() < end, f"there is no {file}"
            time.sleep(0.002)
        self.note()

    def note(self) -> None:
        """Remember the processes that there are now."""
        launcher = psutil.Process(self.popen.pid)
        self.processes = [launcher, *launcher.children(recursive=True)]

    def server(self) -> psutil.Process | None:
        """The server that children are forked from, of the processes that were noted."""
        direct = (process for process in self.processes[1:] if process.ppid() == self.popen.pid)
        return next((process for process in direct if "forkserver" in " ".join(process.cmdline())), None)

    def ended(self, within_s: float) -> tuple[int, str]:
        """Status and errors. Raises AssertionError or TimeoutExpired where it, or what was noted, runs on."""
        errors = self.popen.communicate(timeout=within_s)[1]
        assert not psutil.wait_procs(self.processes, timeout=within_s)[1]
        return self.popen.returncode, errors

    def end(self) -> None:
        """Kill what is left."""
        for process in self.processes:
            if process.is_running():
                process.kill()
        self.popen.kill()
        self.popen.communicate()

    def manifest(self) -> dict[str, Any]:
        """Its fields."""
        fields: dict[str, Any] = json.loads((self.out / "manifest.json").read_text())
        return fields


def handles(pid: int, number: int, how: str = "SigCgt") -> bool:
    """Whether a process handles a signal itself (SigCgt; Python alone does not SIGTERM), or ignores it (SigIgn).

    False where there is no such process.
    """
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return False
    signals = next(line for line in lines if line.startswith(how))
    return bool(int(signals.split()[1], 16) >> number - 1 & 1)


def spin() -> None:
    """Use a core."""
    while True:
        pass


@contextmanager
def loops(number: int) -> Iterator[None]:
    """So many endless loops beside what is done."""
    processes = [multiprocessing.Process(target=spin, daemon=True) for _ in range(number)]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.join()
