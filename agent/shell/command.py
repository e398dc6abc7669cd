"""The command of one robot: `python -m agent`, and `wireswarm agent` where the world is installed, too."""

from __future__ import annotations

import os
import re
import signal
import socket
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Annotated, Never

from typer import Exit, Option

from protocol.command import SIGNALS, tell
from protocol.status import ENDINGS, Status

if TYPE_CHECKING:
    from agent.shell.process import AgentInbox

Certs = Annotated[Path | None, Option(help="Folder of `wireswarm certs`; links are encrypted.", metavar="DIR")]

LAST_TICK_S = 1.0
"""How long a robot that is asked to stop may take for its tick. One takes some ms, and containers are killed after 2 s
or more."""


def agent(
    connect: Annotated[
        str | None,
        Option(help="Endpoint of the world, or of the router of ROS 2.", show_default="with --ros2 tcp/127.0.0.1:7447"),
    ] = None,
    id_: Annotated[
        str | None,
        Option("--id", help="Name of the robot.", show_default="with --certs or --secrets, the first that is free"),
    ] = None,
    secrets: Annotated[Path | None, Option(help="File of secrets with this robot's line.")] = None,
    certs: Certs = None,
    reconnect_s: Annotated[
        float | None, Option("--reconnect", help="Seconds to wait for a world that is gone.", show_default="60")
    ] = None,
    checkpoints: Annotated[
        Path | None, Option(help="Folder where the robot keeps its map, and goes on from when started again.")
    ] = None,
    ros2: Annotated[
        str | None, Option(help="Live on the ROS 2 robot in this namespace, / for none.", metavar="NAMESPACE")
    ] = None,
    config: Annotated[Path | None, Option(help="YAML file with settings, those of a whole run or a robot's.")] = None,
    set_: Annotated[
        list[str] | None, Option("--set", help="One setting, such as join_timeout_s=60.", metavar="KEY=VALUE")
    ] = None,
) -> None:
    """Run one robot."""
    from agent.config import ProcessConfig
    from agent.shell.mind import minds_of
    from agent.shell.process import AgentInbox, run_agent
    from protocol.configuration import load
    from protocol.credentials import of_robot
    from protocol.errors import InputError
    from protocol.messages import ID

    if id_ is not None and not re.fullmatch(ID, id_):
        raise InputError(f"--id {id_}: a name has up to 16 small letters, digits, - and _, and begins with a letter")
    if ros2 is not None:
        if secrets or certs or checkpoints or reconnect_s is not None:
            raise InputError("--ros2: it goes without --secrets, --certs, --checkpoints and --reconnect")
        _live_on_ros2(ros2, id_, connect, config, set_ or ())
    settings = load(ProcessConfig, config, {"reconnect_s": reconnect_s}, set_ or (), shared=True)
    if connect is None:
        raise InputError("--connect: name the endpoint of the world, such as tcp/127.0.0.1:7447")
    if id_ is None and secrets is None and certs is None:
        raise InputError(
            "--id: name the robot, such as r1, or give --certs or --secrets to take the first that is free"
        )
    known = of_robot(id_, secrets, certs)
    _heed_signals(inbox := AgentInbox())
    ended = run_agent(
        id_,
        connect,
        settings.agent,
        credentials=known,
        patience=settings,
        make_mind=minds_of(settings.mind),
        inbox=inbox,
        checkpoints=checkpoints,
        by_hand=True,
    )
    tell(f"{inbox.robot}: {ended}")
    raise Exit(ENDINGS.get(ended, Status.FAILURE))


def _live_on_ros2(
    namespace: str, id_: str | None, connect: str | None, config: Path | None, set_: Sequence[str]
) -> Never:
    """Run the robot of a namespace such as r1, /fleet/r1 or /, and exit."""
    from agent.shell.mind import minds_of
    from agent.shell.ros2.config import Ros2ProcessConfig, is_namespace
    from protocol.configuration import load
    from protocol.errors import InputError
    from protocol.messages import ID

    try:
        from agent.shell.ros2.process import RosInbox, run_ros2
    except ModuleNotFoundError as error:
        if error.name != "rosbags":
            raise
        raise InputError("--ros2: it needs rosbags: install it with `pip install 'wireswarm[ros2]'`") from None

    settings = load(Ros2ProcessConfig, config, None, set_, shared=True)
    namespace = f"/{namespace.strip('/')}"
    if not is_namespace(namespace):
        raise InputError(f"--ros2 {namespace:.100}: it is no namespace of ROS 2, such as /r1 or / for none")
    robot = id_ or namespace.rsplit("/", 1)[-1]
    if not re.fullmatch(ID, robot):
        raise InputError(f"--ros2 {namespace:.100}: name the robot, such as --id r1, as its namespace names none")
    _heed_signals(inbox := RosInbox())
    ended = run_ros2(robot, namespace, settings, connect=connect, make_mind=minds_of(settings.mind), inbox=inbox)
    tell(f"{robot}: {ended}")
    raise Exit(ENDINGS.get(ended, Status.FAILURE))


def _heed_signals(inbox: AgentInbox) -> None:
    """End at the next tick on Ctrl-C or SIGTERM, after LAST_TICK_S at most; at once on a second, and before it drives.

    A thread hears of them, since Zenoh does not return to the main thread while it looks for a world or asks it.
    """
    heard, told = socket.socketpair()
    told.setblocking(False)
    signal.set_wakeup_fd(told.fileno())
    for number in SIGNALS:
        signal.signal(number, lambda number, frame: None)

    def wait() -> None:
        with heard, told:
            heard.recv(1)
            if inbox.robot and not inbox.busy:
                inbox.stop()
                heard.settimeout(LAST_TICK_S)
                with suppress(TimeoutError):  # a second signal
                    heard.recv(1)
            inbox.last_words()
            os._exit(Status.INTERRUPTED)

    Thread(target=wait, daemon=True).start()
