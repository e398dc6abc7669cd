"""`wireswarm view`: a finished run, one that is under way, or that of a world elsewhere."""

from __future__ import annotations

import os
import shlex
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path

from deploy import manifest
from deploy.launch import forks
from deploy.launch.interrupts import on_interrupt
from deploy.view import invitation
from deploy.view.beside import READY
from deploy.view.live import follow
from deploy.view.replay import record
from deploy.view.serving import Tape
from deploy.view.show import show
from protocol.command import say
from protocol.credentials import of_viewer
from protocol.errors import InputError, LinkError
from protocol.files import check_has_folder, has_other_than, write_whole
from protocol.inbox import Inbox
from protocol.status import Status
from protocol.temporary import temporary_folder
from world.checkpoint import is_left

RUNS = Path("runs")
SUMMARY = "summary.json"
"""Of a run that has ended."""
RECORDING = b"RRF"  # what a file of Rerun begins with
POLL_S = 0.1


def newest() -> Path:
    """The run directory in runs/ that began last. Raises InputError where there is none."""
    begun = list[tuple[str, Path]]()
    for file in (worlds := list(RUNS.glob("*/world.yaml"))):
        with suppress(InputError):
            if isinstance(start := manifest.read(file.parent).get("start"), str):  # else it is damaged
                begun.append((start, file.parent))
    if not begun:
        raise InputError(f"{RUNS}/ has no run{' whose manifest can be read' if worlds else ''}: name a run directory")
    return max(begun)[1]


def save(run: Path, file: Path) -> None:
    """Write the recording of a finished run. Raises InputError, also for a file of another kind; UnwritableError."""
    check_has_folder(file, "--save")
    if has_other_than(RECORDING, file):
        raise InputError(f"--save {file}: what is there already is no recording; name another file")
    with temporary_folder() as folder:
        record(run, made := folder / "run.rrd")
        write_whole(file, made.read_bytes())


def view(run: Path, browser: bool, beside: bool) -> None:
    """Show a run directory until a signal; beside: wait for its run to begin, and end with the command that runs it.

    Raises InputError where there is nothing to show, LinkError where a run does not answer.
    """
    asked = os.getppid()
    if beside:
        forks.search_as_before()  # as the browser is used to
        try:
            print(READY, flush=True)
        except BrokenPipeError:  # that command is gone already
            forks.leave(Status.OK)
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # the run's own words alone are on its stdout

    def play(tape: Tape, inbox: Inbox) -> None:
        while beside and not (_is_under_way(run) or (run / SUMMARY).exists()):
            time.sleep(POLL_S)
        if _is_under_way(run):
            try:
                follow(*invitation.invited(run), tape, inbox)
            except (InputError, LinkError):
                if not (run / SUMMARY).exists():  # else it ended meanwhile
                    raise
            else:
                return
        if is_left(run):
            end = f"wireswarm finish {shlex.quote(str(run))}"
            say(f"{run}: its world was killed; this is what there is of it, and `{end}` ends it")
        record(run, tape.file)

    _show(play, browser, lambda: beside and os.getppid() != asked)


def view_elsewhere(endpoint: str, secrets: Path | None, certs: Path | None, browser: bool) -> None:
    """Show the run of a world at an endpoint until a signal. Raises InputError, LinkError."""
    credentials = of_viewer(secrets, certs)
    _show(lambda tape, inbox: follow(endpoint, credentials, tape, inbox), browser)


def _show(play: Callable[[Tape, Inbox], None], browser: bool, over: Callable[[], bool] = lambda: False) -> None:
    """Show what is played onto a tape until it is over; the page is there once there is something to be seen.

    At its end and at a signal this process ends at once: a long run takes a while to record, which nobody waits for.
    """
    leave = partial(forks.leave, Status.OK)
    with on_interrupt(leave), temporary_folder() as folder, ThreadPoolExecutor(1) as pool:
        tape, inbox = Tape(folder / "run.rrd"), Inbox()
        playing = pool.submit(play, tape, inbox)
        playing.add_done_callback(lambda done: tape.end())

        def wait_while(goes_on: Callable[[], bool]) -> None:
            while goes_on():
                if over():
                    leave()
                time.sleep(POLL_S)

        try:
            wait_while(lambda: not playing.done() and tape.file.stat().st_size == 0)
            if playing.done():
                playing.result()
            with show(tape, browser):
                wait_while(lambda: not (playing.done() and playing.exception()))
        finally:
            inbox.stop()  # the pool waits for what plays
        playing.result()


def _is_under_way(run: Path) -> bool:
    return (run / invitation.FILE).exists() and not (run / SUMMARY).exists() and not is_left(run)
