"""`wireswarm view`: a finished run, one that is under way, or that of a world elsewhere."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from deploy.view import invitation
from deploy.view.beside import READY
from deploy.view.live import follow
from deploy.view.replay import record
from deploy.view.serving import Tape
from deploy.view.show import show
from protocol.command import say, stop_on_signals
from protocol.credentials import of_viewer
from protocol.errors import InputError
from protocol.files import has_other_than, write_whole
from protocol.inbox import Inbox
from protocol.temporary import temporary_folder
from world.checkpoint import is_left

RUNS = Path("runs")
SUMMARY = "summary.json"
"""Of a run that has ended."""
RECORDING = b"RRF"  # what a file of Rerun begins with
POLL_S = 0.1


def newest() -> Path:
    """The run directory in runs/ that began last. Raises InputError where there is none."""
    begun = [file for file in RUNS.glob("*/world.yaml") if (file.parent / "manifest.json").is_file()]
    if not begun:
        raise InputError(f"{RUNS}/ has no run: name a run directory")
    return max(begun, key=lambda file: file.stat().st_mtime).parent


def save(run: Path, file: Path) -> None:
    """Write the recording of a finished run. Raises InputError, also for a file of another kind; UnwritableError."""
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
    stop_on_signals(inbox := Inbox())
    if beside:
        print(READY, flush=True)
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # the run's own words alone are on its stdout

    def over() -> bool:
        return inbox.stopped or (beside and os.getppid() != asked)

    def play(tape: Tape) -> None:
        while beside and not over() and not (_is_under_way(run) or (run / SUMMARY).exists()):
            time.sleep(POLL_S)
        if _is_under_way(run):
            follow(*invitation.invited(run), tape, inbox)
        elif not over():
            if is_left(run):
                say(f"{run}: its world was killed; this is what there is of it, and `wireswarm finish {run}` ends it")
            record(run, tape.file)

    _show(play, browser, inbox, over)


def view_elsewhere(endpoint: str, secrets: Path | None, certs: Path | None, browser: bool) -> None:
    """Show the run of a world at an endpoint until a signal. Raises InputError, LinkError."""
    credentials = of_viewer(secrets, certs)
    stop_on_signals(inbox := Inbox())
    _show(lambda tape: follow(endpoint, credentials, tape, inbox), browser, inbox, lambda: inbox.stopped)


def _show(play: Callable[[Tape], None], browser: bool, inbox: Inbox, over: Callable[[], bool]) -> None:
    """Show what is played onto a tape until it is over; the page is there once there is something to be seen."""
    with temporary_folder() as folder, ThreadPoolExecutor(1) as pool:
        tape = Tape(folder / "run.rrd")
        playing = pool.submit(play, tape)
        playing.add_done_callback(lambda done: tape.end())
        try:
            while not playing.done() and tape.file.stat().st_size == 0:
                time.sleep(POLL_S)
            if playing.done():
                playing.result()
            if over():
                return
            with show(tape, browser):
                while not over() and not (playing.done() and playing.exception()):
                    time.sleep(POLL_S)
        finally:
            inbox.stop()  # the pool waits for what plays
        playing.result()


def _is_under_way(run: Path) -> bool:
    return (run / invitation.FILE).exists() and not (run / SUMMARY).exists() and not is_left(run)
