"""`wireswarm run`: one process for the world, one for each robot, and a run directory at the end."""

from __future__ import annotations

import itertools
import json
import multiprocessing as mp
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import version
from multiprocessing import forkserver
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from deploy.config import ConfigError, RunConfig
from deploy.processes import ENDED, FAILED, LISTENING, PROGRESS, REFUSED, agent_process, world_process
from deploy.status import ENDINGS, Status
from protocol.access import new_secrets
from protocol.messages import Progress
from world.worldfile import load

if TYPE_CHECKING:
    from agent.shell.process import RobotFactory

PRELOAD = ["numpy", "zenoh", "msgpack", "pydantic", "numba", "shapely", "agent.shell.process", "deploy.preload"]
"""Loaded once for all robots, kernels too: 7 MiB each instead of 27, and 30 are up in 0.2 s (facts/zenoh.md)."""

LEAVE_S = 5.0
"""What the children have to end by themselves once the run is over, before they are killed."""


class Result(NamedTuple):
    """How a run went."""

    status: Status
    ended: str
    errors: list[str]


class Child(NamedTuple):
    """A process and the pipe to it; its closing ends the process."""

    name: str
    process: ForkServerProcess
    pipe: Connection


def run_directory(asked: Path | None, world: str, seed: int) -> Path:
    """Make the run directory: the one asked for, which must be empty, or runs/WORLD-SEED, -2, -3, ...

    Raises ConfigError where that asked for is taken.
    """
    if asked is not None:
        if asked.exists() and not (asked.is_dir() and not any(asked.iterdir())):
            raise ConfigError(f"--out {asked}: something is there already; name an empty or a new directory")
        asked.mkdir(parents=True, exist_ok=True)
        return asked
    stem = Path("runs") / f"{Path(world).stem}-{seed}"
    for out in itertools.chain([stem], (stem.with_name(f"{stem.name}-{count}") for count in itertools.count(2))):
        with suppress(FileExistsError):  # perhaps made just now, by a run that starts at the same time
            out.mkdir(parents=True)
            return out
    raise AssertionError("unreachable")


def launch(
    config: RunConfig,
    out: Path,
    *,
    command_line: list[str],
    show: Callable[[Progress], None] = lambda progress: None,
    robot_factory: RobotFactory | None = None,
) -> Result:
    """Run to the end and write the run directory `out` with its manifest; leaves no process behind.

    Raises WorldFileError for a world that cannot be loaded, before anything is started.
    """
    manifest = {
        "version": version("wireswarm"),
        "command_line": command_line,
        "config": config.model_dump(mode="json"),
        "seed": config.seed,
        "world_hash": load(config.world).hash,
        "start": _now(),
    }
    out.mkdir(parents=True, exist_ok=True)
    with Run(config, out, show, robot_factory) as run:
        result = run.follow()
    manifest |= {"end": _now(), "ended": result.ended, "exit_status": result.status}
    if result.errors:
        manifest["errors"] = result.errors
    (out / "manifest.json").write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")
    return result


class Run:
    """The children of one run, from their start to their end."""

    def __init__(
        self, config: RunConfig, out: Path, show: Callable[[Progress], None], factory: RobotFactory | None
    ) -> None:
        self._config, self._out, self._show, self._factory = config, out, show, factory
        self._context = mp.get_context("forkserver")
        self._secrets = new_secrets(self._robots) if config.server.access_control else None
        """Of this run alone; they reach the children by their pipes, and are written nowhere else."""
        self._children: list[Child] = []
        self._talking: dict[Any, Child] = {}
        """Children whose pipe is open, by our end of it."""
        self._progress: Progress | None = None
        self._ended: str | None = None
        self._errors: list[str] = []
        self._last_words: set[str] = set()
        """Children that said how they ended."""
        self._refused = self._interrupted = self._stillborn = False

    def __enter__(self) -> Self:
        """Start the world; its robots follow when it listens."""
        self._context.set_forkserver_preload(PRELOAD)
        ctrl_c = signal.signal(signal.SIGINT, signal.SIG_IGN)  # inherited: it is ours alone
        try:
            forkserver.ensure_running()
        finally:
            signal.signal(signal.SIGINT, ctrl_c)
        self._start("world", world_process, self._config, self._out, self._secrets)
        return self

    def __exit__(self, *_: object) -> None:
        """Wait for all children to go, and see to it that they do."""
        for child in self._children:
            child.pipe.close()  # which tells one that is still there
        deadline = time.monotonic() + LEAVE_S
        for child in self._children:
            child.process.join(max(0.0, deadline - time.monotonic()))
            if child.process.is_alive():
                child.process.kill()
                child.process.join()

    def follow(self) -> Result:
        """Listen to the children until all have gone; Ctrl-C or SIGTERM once ends the run, twice at once."""
        before = {number: signal.signal(number, self._stop) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            deadline = None
            while self._talking and (deadline is None or time.monotonic() < deadline):
                for pipe in wait(list(self._talking), timeout=None if deadline is None else 0.1):
                    self._listen(self._talking[pipe])
                if deadline is None and not any(child.name == "world" for child in self._talking.values()):
                    deadline = time.monotonic() + self._config.reconnect_s + LEAVE_S
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
        return Result(self._status(), self._ended or "failed", self._errors)

    @property
    def _robots(self) -> list[str]:
        return [f"r{number + 1}" for number in range(self._config.robots)]

    def _start(self, name: str, target: Callable[..., None], *arguments: Any) -> None:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(target=target, args=(theirs, *arguments), name=name, daemon=True)
        process.start()
        theirs.close()
        child = Child(name, process, ours)
        self._children.append(child)
        self._talking[ours] = child

    def _listen(self, child: Child) -> None:
        try:
            what, value = child.pipe.recv()
        except (EOFError, OSError):
            del self._talking[child.pipe]
            if child.name == "world" and self._interrupted:
                self._tell_all()
            if child.name not in self._last_words:
                child.process.join(1.0)
                self._errors.append(f"{child.name}: its process died ({_exit_of(child.process.exitcode)})")
                self._end_unless_begun(child)
            return
        if what == LISTENING:
            for robot in self._robots:
                secret = self._secrets and self._secrets[robot]
                self._start(robot, agent_process, robot, value, secret, self._config, self._factory)
            return
        if what == PROGRESS:
            self._progress = value
            self._show(value)
            return
        self._last_words.add(child.name)
        if what == ENDED and child.name == "world":
            self._ended = value
        elif what in (REFUSED, FAILED) or value not in ENDINGS:
            self._refused |= what == REFUSED
            self._errors.append(value if child.name == "world" else f"{child.name}: {value}")
            self._end_unless_begun(child)

    def _end_unless_begun(self, child: Child) -> None:
        """End a run that waits for a robot that will never join."""
        if self._progress is None and child.name != "world":
            self._stillborn = True
            self._tell_all()

    def _stop(self, number: int, frame: object) -> None:
        if self._interrupted:
            for child in self._children:
                child.process.kill()
        self._interrupted = True
        with suppress(OSError):
            self._children[0].pipe.send("stop")  # which tells the robots; those not there yet hear it from us

    def _tell_all(self) -> None:
        for child in self._talking.values():
            with suppress(OSError):
                child.pipe.send("stop")

    def _status(self) -> Status:
        if self._interrupted or (self._ended == "interrupted" and not self._stillborn):
            return Status.INTERRUPTED
        if self._refused:
            return Status.USAGE
        if self._stillborn:
            return Status.FAILURE
        if self._ended is None or self._progress is None:
            return Status.FAILURE
        states = set(self._progress.clock.status.values())
        fine = {"complete"} if self._config.until == "complete" else {"complete", "exploring"}
        return Status.OK if states <= fine else Status.INCOMPLETE


def _exit_of(code: int | None) -> str:
    return f"signal {-code}" if code is not None and code < 0 else f"exit status {code}"


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
