"""`wireswarm run`: one process for the world, one for each robot, and a run directory at the end."""

from __future__ import annotations

import errno
import math
import os
import signal
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import Any, NamedTuple, cast

from agent.shell.mind import MakeMind, minds_of
from deploy import manifest
from deploy.config import RunConfig
from deploy.finish import finish
from deploy.launch import capacity, forks
from deploy.launch.faults import schedule
from deploy.launch.interrupts import on_interrupt
from deploy.launch.logs import Log
from deploy.launch.processes import ENDED, FAILED, OPENED, PROGRESS, REFUSED, STOP, agent_process, world_process
from deploy.view.invitation import invite, withdraw
from protocol.configuration import ConfigError
from protocol.errors import InputError
from protocol.files import UnwritableError, remove_empty, remove_parts
from protocol.inbox import SIGNAL_S
from protocol.messages import Progress
from protocol.secrets import new_secrets
from protocol.status import ENDINGS, Status, of_run
from world.checkpoint import CHECKPOINT_FILE
from world.worldfile import load

RESTARTS = 3  # of a process with --restart: what dies more often has a mistake in it
LEAVE_S = 5.0  # children that have not ended this long after the run are killed
FAREWELL_S = 1.0  # likewise after an interrupted one, which is to be gone within 5 s
LAST_S = 10.0  # a world that has not ended so long after it was interrupted hangs, and is killed

MAX_RUNS = 100_000  # directories runs/WORLD-SEED, -2, -3, ... of one world and seed


Show = Callable[[Progress], None]


class Result(NamedTuple):
    """How a run went."""

    status: Status
    ended: str
    errors: list[str]


class Child(NamedTuple):
    """A process, and the pipe to it; the process ends when the pipe closes."""

    name: str
    process: ForkServerProcess
    pipe: Connection
    log: Log


@contextmanager
def run_directory(asked: Path | None, world: str, seed: int) -> Iterator[tuple[Path, list[Path]]]:
    """Make the run directory: the one asked for, which must be empty, or runs/WORLD-SEED, -2, -3, ...

    With it come the folders that were made, from the inside out; those that stay empty are removed at the end, and are
    to be removed by who ends the process before. Raises ConfigError where it is taken or cannot be made.
    """
    default = (Path("runs", f"{Path(world).stem}-{seed}" + (f"-{k}" if k > 1 else "")) for k in range(1, MAX_RUNS))
    try:
        if asked is not None and asked.exists() and (not asked.is_dir() or any(asked.iterdir())):
            raise ConfigError(f"--out {asked}: something is there already; name an empty or a new directory")
        for out in default if asked is None else [asked]:
            made = [folder for folder in (out, *out.parents) if not folder.exists()]
            if any(folder.name == ".." for folder in made):  # mkdir makes what it leaves, and may find `out`
                raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
            # a run that starts at the same time may have made it just now; what was asked for is a link to nothing
            with suppress(FileExistsError) if asked is None else nullcontext():
                out.mkdir(parents=True, exist_ok=asked is not None)
                break
        if not os.access(out, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise ConfigError(f"--out {asked or out}: {error.strerror}; name a directory that can be written") from None
    try:
        yield out, made
    finally:
        remove_empty(made)


def launch(
    config: RunConfig, out: Path, *, show: Show = lambda progress: None, make_mind: MakeMind | None = None
) -> Result:
    """Run to the end and write the run directory `out` with its manifest; leaves no process behind.

    Ctrl-C or SIGTERM ends the run; a second one kills it, as does LAST_S after the first; when it has ended, both are
    the caller's again. A run that cannot begin, because an option or a file is wrong, leaves nothing in it. Raises
    WorldFileError for a world that cannot be loaded, and ConfigError for more robots than this machine has room for,
    before anything is started;
    UnwritableError where the run directory cannot be written.
    """
    capacity.check(config.robots)
    children = Children(config, out, show, make_mind or minds_of(config.mind))
    with on_interrupt(children.interrupt):
        begun = manifest.begun(config, load(config.world))
        out.mkdir(parents=True, exist_ok=True)
        manifest.begin(out, begun)
        children.follow()
    children.finish()
    status, ended, errors = children.result()
    if status == Status.INTERRUPTED and ended != "interrupted":
        errors.append("interrupted while the run ended")
    try:
        remove_parts(out)
        if status == Status.USAGE:
            manifest.withdraw(out)
        else:
            manifest.finish(out, ended=ended, exit_status=status, **({"errors": errors} if errors else {}))
    except OSError as error:
        errors += [] if str(error) in errors else [str(error)]
        status = status or Status.FAILURE
    return Result(status, ended, errors)


class Children:
    """The processes of one run, from their start to their end."""

    def __init__(self, config: RunConfig, out: Path, show: Show, make_mind: MakeMind | None) -> None:
        """Nothing is started yet."""
        self._config, self._out, self._show, self._make_mind = config, out, show, make_mind
        # secrets are drawn for this run, reach the children by their pipes, and are written nowhere else
        self._secrets = new_secrets(config.robot_ids) if config.server.access_control else None
        self._children: list[Child] = []
        self._talking: dict[Any, Child] = {}  # children whose pipe is open, by our end of it
        self._progress: Progress | None = None
        self._ended: str | None = None
        self._errors: list[str] = []
        self._last_words: set[str] = set()  # names of children that said how they ended
        self._refused = self._interrupted = self._never_began = False
        restarts, faults = RESTARTS if config.restart else 0, schedule(config.robot_ids, config.faults)
        self._restarts = {"world": restarts} | {robot: restarts + len(ticks) for robot, ticks in faults.items()}
        self._checkpoints = out / "checkpoints" if config.restart or config.faults else None
        self._gone: set[str] = set()  # robots that do not come back
        self._endpoint = ""

    def follow(self) -> None:
        """Start the world, its robots when it listens, and listen to all until they have ended; kill those that do not.

        A child's end of its pipe closes when it ends. The server that they are forked from tells a sentinel how they
        ended: a sentinel that is ready while the pipe is open tells the end of that server.
        """
        try:
            forks.begin()
            self._start("world", world_process, self._config, self._out, self._secrets)
            if self._interrupted:  # while the world started
                self._stop_all()
            deadline, hangs_at = None, math.inf
            while self._talking and (deadline is None or time.monotonic() < deadline):
                world = self._world()
                if self._interrupted and world:
                    hangs_at = min(hangs_at, time.monotonic() + LAST_S)
                    if time.monotonic() >= hangs_at:
                        hangs_at = math.inf
                        self._errors.append(f"world: it did not end within {LAST_S:g} s and was killed")
                        self._kill(world)
                if deadline is None and not world:
                    self._stop_all()  # nobody needs to wait for a world that has ended
                    deadline = time.monotonic() + (FAREWELL_S if self._interrupted else LEAVE_S)
                logs = {child.log.pipe: child.log for child in self._children if not child.log.pipe.closed}
                sentinels = [] if self._interrupted else [child.process.sentinel for child in world]
                for ready in wait([*self._talking, *logs, *sentinels], timeout=SIGNAL_S):
                    if ready in logs:
                        logs[ready].read()
                    elif ready in self._talking:
                        self._listen(self._talking[ready])
                    elif not world[0].pipe.poll():
                        self._end_without_server()
            self._kill(self._talking.values())
        finally:
            self._leave()

    def result(self) -> Result:
        """How the run went, once it has ended; a world that died may have written how, or somebody for it."""
        ended = self._ended or manifest.ended(self._out) or "interrupted"
        return Result(self._status(), ended, self._errors)

    def finish(self) -> None:
        """Finish what a world left that was killed, or failed. One that was told to stop is to be gone soon."""
        if self._interrupted or not (self._out / CHECKPOINT_FILE).exists():
            return
        try:
            finish(self._out)
        except (InputError, OSError) as error:
            self._errors += [] if str(error) in self._errors else [str(error)]

    def interrupt(self) -> None:
        """End the run: in order where it has begun, else at once, as a second call does."""
        if self._interrupted or self._progress is None:
            forks.kill()
            self._kill(self._talking.values())
        self._interrupted = True
        for world in self._world():  # it tells its robots; those not there yet are told at its end
            with suppress(OSError):
                world.pipe.send(STOP)

    def _world(self) -> list[Child]:
        """The world, while it runs."""
        return [child for child in self._talking.values() if child.name == "world"]

    def _end_without_server(self) -> None:
        if not self._interrupted:
            self._errors.append("interrupted: the server from which world and robots are forked was killed")
        self._interrupted = True
        self._stop_all()

    def _kill(self, children: Iterable[Child]) -> None:
        """Kill processes by their number, as multiprocessing cannot where the server is dead."""
        for child in children:
            with suppress(ProcessLookupError):
                os.kill(cast(int, child.process.pid), signal.SIGKILL)

    def _leave(self) -> None:
        withdraw(self._out)
        for child in self._children:
            child.pipe.close()
        deadline = time.monotonic() + LEAVE_S
        for child in self._children:
            child.process.join(max(0.0, deadline - time.monotonic()))
            if child.process.is_alive():
                child.process.kill()
                child.process.join(LEAVE_S)
            child.log.read()
            child.log.pipe.close()

    def _start(self, name: str, target: Callable[..., None], *arguments: Any) -> None:
        if self._interrupted:
            return
        ours, theirs = forks.CONTEXT.Pipe()
        said, says = forks.CONTEXT.Pipe(duplex=False)
        log = Log(self._out / "logs" / f"{name}.log", said)
        process = forks.CONTEXT.Process(target=target, args=(theirs, says, *arguments), name=name, daemon=True)
        try:
            process.start()
        except (EOFError, OSError):
            self._end_without_server()
        else:
            self._talking[ours] = child = Child(name, process, ours, log)
            self._children.append(child)
        theirs.close()
        says.close()

    def _start_robot(self, robot: str) -> None:
        secret = self._secrets and self._secrets[robot]
        config, mind = self._config, self._make_mind
        self._start(robot, agent_process, robot, self._endpoint, secret, config, mind, self._checkpoints)

    def _may_start_again(self, name: str) -> bool:
        return self._progress is not None and self._ended is None and self._restarts[name] > 0

    def _start_again(self, name: str) -> None:
        self._restarts[name] -= 1
        if name != "world":
            return self._start_robot(name)
        server = self._config.server.model_copy(update={"listen": self._endpoint})  # where the robots look for it
        config = self._config.model_copy(update={"server": server})
        return self._start("world", world_process, config, self._out, self._secrets, True)

    def _listen(self, child: Child) -> None:
        try:
            what, value = child.pipe.recv()
        except (EOFError, OSError):
            del self._talking[child.pipe]
            if child.name not in self._last_words and not self._interrupted:
                child.process.join(1.0)
                if child.name == "world":
                    self._ended = manifest.ended(self._out)  # it was killed between this and its last word
                code = child.process.exitcode
                how = f"signal {-code}" if code is not None and code < 0 else f"exit status {code}"
                again = self._may_start_again(child.name)
                child.log.read()
                again_ = " and was started again" if again else ""
                self._errors.append(f"{child.name}: its process died ({how}){again_}{child.log.where()}")
                if again:
                    self._start_again(child.name)
                    return
                self._end_unless_begun(child)
            self._gone.add(child.name)
            self._tell_world(child.name)
            return
        if what == OPENED:
            if not self._endpoint:
                self._endpoint = value
                with suppress(UnwritableError):  # the run goes on without viewers
                    invite(self._out, value, self._secrets)
                for robot in self._config.robot_ids:
                    self._start_robot(robot)
            for robot in self._gone:  # a world that is there again may not know
                self._tell_world(robot)
        elif what == PROGRESS:
            if self._progress is None:  # before its first tick a world takes no robot's end for good
                for robot in self._gone:
                    self._tell_world(robot)
            self._progress = value
            self._show(value)
        else:
            self._last_words.add(child.name)
            if what == ENDED and child.name == "world":
                self._ended = value
            elif what in (REFUSED, FAILED) or value not in ENDINGS:
                self._refused |= what == REFUSED
                child.log.read()
                self._errors.append((value if child.name == "world" else f"{child.name}: {value}") + child.log.where())
                self._end_unless_begun(child)

    def _end_unless_begun(self, child: Child) -> None:
        """End a run that would wait for robots that cannot join any more."""
        config = self._config
        may_join = len({*config.robot_ids} - self._gone - self._last_words - {child.name})
        enough = may_join >= (config.server.begin_with or config.robots)
        if self._progress is None and child.name != "world" and not enough:
            self._never_began = True
            self._stop_all()

    def _tell_world(self, robot: str) -> None:
        """Tell the world that a robot's process has ended, as a link that is lost may come back."""
        for world in self._world():
            with suppress(OSError):
                world.pipe.send(robot)

    def _stop_all(self) -> None:
        for child in self._talking.values():
            with suppress(OSError):
                child.pipe.send(STOP)

    def _status(self) -> Status:
        if self._interrupted or (self._ended == "interrupted" and not self._never_began):
            return Status.INTERRUPTED
        if self._refused and self._progress is None:
            return Status.USAGE
        if self._never_began or self._ended is None or self._progress is None:
            return Status.FAILURE
        return of_run(self._ended, self._config.until, self._progress.clock.status.values())
