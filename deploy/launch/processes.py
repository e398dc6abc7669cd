"""What runs in each child of the launcher: a world or a robot. Both end when the launcher ends."""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deploy import manifest
from deploy.config import RunConfig
from deploy.launch.faults import doomed, schedule
from deploy.launch.logs import speak_into
from deploy.view.invitation import withdraw
from protocol.errors import InputError, LinkError, ProtocolError
from protocol.files import UnwritableError
from protocol.inbox import Inbox
from protocol.secrets import Secrets

if TYPE_CHECKING:
    from agent.shell.mind import MakeMind

GRACE_S = 3.0  # a child has this long to end by itself once its launcher is dead; all are to be gone after 5 s

# First item of what a child sends to its launcher; the second is a value.
OPENED, PROGRESS, ENDED, REFUSED, FAILED = "opened", "progress", "ended", "refused", "failed"

STOP = ""
"""What the launcher says to a child to stop it. It says a robot's name to the world where that process has ended."""


def world_process(
    launcher: Connection, log: Connection, config: RunConfig, out: Path, secrets: Secrets | None, resume: bool = False
) -> None:
    """Run the world, or go on with one that was killed (resume).

    Tells OPENED endpoint, PROGRESS, and last ENDED how, REFUSED or FAILED why.
    """
    speak_into(log)
    from world.shell.inbox import WorldInbox
    from world.shell.server import serve

    inbox = WorldInbox()
    _obey(launcher, inbox, robot_ended=inbox.end)
    told: dict[str, Any] = {
        "opened": partial(_tell, launcher, OPENED),
        "progress": partial(_tell, launcher, PROGRESS),
        "written": lambda how: manifest.finish(out, ended=how),  # here, because the launcher may be dead
    }
    with _last_words(launcher, InputError, OSError) as ended:
        try:
            ended(serve(config, config.server, out, credentials=secrets, inbox=inbox, resume=resume, **told))
        finally:
            withdraw(out)  # the launcher, which wrote it, may be dead


def agent_process(
    launcher: Connection,
    log: Connection,
    robot: str,
    endpoint: str,
    secret: str | None,
    config: RunConfig,
    make_mind: MakeMind | None,
    checkpoints: Path | None = None,
) -> None:
    """Run one robot; tells ENDED how, or FAILED why.

    It looks for the world as long as the world waits for it: with 100 robots on two busy cores that takes over 10 s. A
    world that is gone it waits for without limit: that stands still, as the launcher ends the robots of one that died.
    """
    speak_into(log)
    from agent.shell.process import AgentInbox, run_agent

    inbox = AgentInbox()
    patience = max(config.join_timeout_s, config.server.join_timeout_s)
    _obey(launcher, inbox, orphan_s=GRACE_S / 2)  # the world ends before, and tells the robots
    with _last_words(launcher) as ended:
        how = run_agent(
            robot,
            endpoint,
            config.agent,
            credentials=None if secret is None else Secrets({robot: secret}),
            patience=config.model_copy(update={"join_timeout_s": patience, "reconnect_s": math.inf}),
            make_mind=doomed(schedule(config.robot_ids, config.faults)[robot], make_mind),
            inbox=inbox,
            checkpoints=checkpoints,
        )
        ended(how)


@contextmanager
def _last_words(launcher: Connection, *refusals: type[Exception]) -> Iterator[Callable[[str], None]]:
    """Tell the launcher how a child ended: as the yielded function is told, or by what was raised.

    refusals: errors of the user's input.
    """
    try:
        yield partial(_tell, launcher, ENDED)
    except (LinkError, ProtocolError, UnwritableError) as error:
        _tell(launcher, FAILED, str(error))
    except refusals as error:
        _tell(launcher, REFUSED, str(error))
    except Exception as error:
        traceback.print_exc()  # before the launcher looks whether anything is in the log
        _tell(launcher, FAILED, f"stopped by a mistake in its program: {type(error).__name__}: {error}")
        sys.exit(1)


def _obey(
    launcher: Connection, inbox: Inbox, orphan_s: float = 0.0, robot_ended: Callable[[str], None] = lambda robot: None
) -> None:
    """Stop on SIGTERM, on the launcher's message, and orphan_s after its end; Ctrl-C is left to the launcher."""

    def watch() -> None:
        with suppress(EOFError, OSError):  # raised where the launcher is dead
            while True:
                robot = launcher.recv()
                if robot == STOP:
                    inbox.stop()
                else:
                    robot_ended(robot)
        time.sleep(orphan_s)
        inbox.stop()
        time.sleep(GRACE_S - orphan_s)
        os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: inbox.stop())
    threading.Thread(target=watch, daemon=True).start()


def _tell(launcher: Connection, what: str, value: Any) -> None:
    """Tell the launcher; where it is dead, the thread of `_obey` ends this process."""
    try:
        launcher.send((what, value))
    except OSError:
        if what in (REFUSED, FAILED):
            print(value, file=sys.stderr)
