"""What runs in each child of the launcher: a world, or a robot; both end when the launcher does."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from deploy.config import RunConfig

if TYPE_CHECKING:
    from agent.shell.process import RobotFactory

GRACE_S = 3.0
"""What a child has left to end by itself once its launcher is dead; the promise is 5 s for all."""

# What a child tells its launcher, with one value each.
LISTENING, PROGRESS, ENDED, REFUSED, FAILED = "listening", "progress", "ended", "refused", "failed"


class Stoppable(Protocol):
    """An inbox of a world or of a robot."""

    def stop(self) -> None:
        """End the run."""
        ...


def world_process(launcher: Connection, config: RunConfig, out: Path, secrets: dict[str, str] | None) -> None:
    """Run the world; tells LISTENING endpoint, PROGRESS, and last ENDED how, REFUSED or FAILED why."""
    from protocol.errors import LinkError
    from world.server import Inbox, serve
    from world.worldfile import WorldFileError

    inbox = Inbox()
    _obey(launcher, inbox)
    try:
        ended = serve(
            config,
            config.server,
            out,
            secrets=secrets,
            inbox=inbox,
            listening=lambda endpoint: _tell(launcher, LISTENING, endpoint),
            progress=lambda progress: _tell(launcher, PROGRESS, progress),
        )
    except (WorldFileError, OSError) as error:
        _tell(launcher, REFUSED, str(error))
    except LinkError as error:
        _tell(launcher, FAILED, str(error))
    except Exception as error:
        _tell(launcher, FAILED, f"stopped by a mistake in its program: {type(error).__name__}: {error}")
        raise
    else:
        _tell(launcher, ENDED, ended)


def agent_process(
    launcher: Connection,
    robot: str,
    endpoint: str,
    secret: str | None,
    config: RunConfig,
    robot_factory: RobotFactory | None,
) -> None:
    """Run one robot; tells ENDED how, or FAILED why."""
    from agent.shell.process import Inbox, run_agent
    from protocol.errors import LinkError, ProtocolError

    inbox = Inbox()
    _obey(launcher, inbox, orphan_s=GRACE_S / 2)  # the world ends first, and tells the robots
    try:
        ended = run_agent(
            robot,
            endpoint,
            config.agent,
            secret=secret,
            reconnect_s=config.reconnect_s,
            join_timeout_s=config.join_timeout_s,
            robot_factory=robot_factory,
            inbox=inbox,
        )
    except (LinkError, ProtocolError) as error:
        _tell(launcher, FAILED, str(error))
    except Exception as error:
        _tell(launcher, FAILED, f"stopped by a mistake in its program: {type(error).__name__}: {error}")
        raise
    else:
        _tell(launcher, ENDED, ended)


def _obey(launcher: Connection, inbox: Stoppable, orphan_s: float = 0.0) -> None:
    """Stop on SIGTERM, on the launcher's word, and orphan_s after its end.

    Ctrl-C is the launcher's, which tells the world.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: inbox.stop())
    threading.Thread(target=_watch, args=(launcher, inbox, orphan_s), daemon=True).start()


def _watch(launcher: Connection, inbox: Stoppable, orphan_s: float) -> None:
    try:
        while True:
            launcher.recv()
            inbox.stop()
    except (EOFError, OSError):  # the launcher is dead
        time.sleep(orphan_s)
        inbox.stop()
        time.sleep(GRACE_S - orphan_s)
        os._exit(1)


def _tell(launcher: Connection, what: str, value: Any) -> None:
    """Tell the launcher; where it is dead, the watch ends this process."""
    try:
        launcher.send((what, value))
    except OSError:
        if what in (REFUSED, FAILED):
            print(value, file=sys.stderr)
