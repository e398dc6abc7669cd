"""The world as a server: an embedded router or a client of one, the robots that come, and a run among them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from secrets import token_hex

import zenoh

from protocol import keys
from protocol.access import WORLD, Credentials
from protocol.errors import InputError, Interrupted
from protocol.session import open_client, open_router, place
from world.config import ServerConfig, WorldConfig
from world.episode import Episode
from world.shell.gathering import OnAwaited
from world.shell.inbox import WorldInbox
from world.shell.roll_call import count
from world.shell.shell import OnWritten, Shell
from world.shell.voice import OnProgress

OTHER_WORLD_S = 2.0
"""How long a router may take to say whether a world is there already; it takes some ms."""


def serve(
    config: WorldConfig,
    server: ServerConfig,
    out: Path | None,
    *,
    credentials: Credentials | None = None,
    inbox: WorldInbox | None = None,
    resume: bool = False,
    settle_s: float | None = None,
    counted: Callable[[WorldConfig], None] = lambda config: None,
    opened: Callable[[str], None] = lambda endpoint: None,
    listening: Callable[[str], None] = lambda endpoint: None,
    awaited: OnAwaited = lambda awaited: None,
    progress: OnProgress = lambda progress: None,
    written: OnWritten = lambda ended: None,
) -> str:
    """Run one episode for robots that join over the network; returns how it ended.

    out: the run directory. credentials: of the robots and viewers that may connect; None lets everybody connect.
    resume: go on with the run that a killed world left in `out`. settle_s: the run is for as many robots, config.robots
    at most, as have come when no further one has for so many seconds; `counted` is told the settings with their number.
    `opened` is told the endpoint once robots may connect, `listening` once the world is built and they may join;
    `awaited` whom the run waits for, when one has come and every AWAITED_S; `progress` is called some times a second.
    `written` is told how the run ended, before its checkpoint goes (`Episode.close`), also where it did not begin.
    Raises InputError where the world cannot listen or cannot be run, before anything is written; LinkError where robots
    do not join, CheckpointError where no run can go on.
    """
    inbox = inbox or WorldInbox()
    with suppress(Interrupted), _opened(server, credentials, inbox) as (session, endpoint):
        known = None if credentials is None else credentials.session_id
        opened(endpoint)
        if settle_s is not None:
            listening(endpoint)
            robots = count(session, inbox, config.robot_ids, settle_s, server.join_timeout_s, known)
            if robots is None:
                raise Interrupted
            config = config.model_copy(update={"robots": robots})
            counted(config)
        run = token_hex(8)  # drawn, as robots may keep minds of a run that had the very same settings
        episode = Episode.resume(config, out) if resume and out is not None else Episode(config, out, run=run)
        with Shell(episode, server, session, inbox, progress, known, awaited, written) as shell:
            if settle_s is None:
                listening(endpoint)
            try:
                shell.gather(endpoint)
                shell.run()
            except Interrupted:
                pass
            finally:
                ended = shell.close()
        return ended
    written("interrupted")
    return "interrupted"


@contextmanager
def _opened(
    server: ServerConfig, credentials: Credentials | None, inbox: WorldInbox
) -> Iterator[tuple[zenoh.Session, str]]:
    """The world's session, a router or a client of one, with the endpoint where robots find it.

    Raises Interrupted where the world is to stop before it has one.
    """
    if server.connect is None:
        with open_router(server.listen, credentials, insecure=server.insecure) as opened:
            yield opened
        return
    client = open_client(server.connect, server.join_timeout_s, WORLD, credentials, lambda: inbox.stopped)
    # with credentials a world has its place by these; one at a router that is linked to this one shows its token
    with client as session, place(server.connect, WORLD) if credentials is None else nullcontext(True) as ours:
        if not ours or any(reply.ok for reply in session.liveliness().get(keys.WORLD_ALIVE, timeout=OTHER_WORLD_S)):
            raise InputError(f"a world is at {server.connect} already: a router serves one at a time")
        yield session, server.connect
