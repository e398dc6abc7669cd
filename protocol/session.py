"""How sessions are opened: the world is an embedded router, robots and viewers are clients of its endpoint.

Reasons and measurements for every setting: docs/design.md.
"""

from __future__ import annotations

import json
import re
import resource
import socket
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import zenoh

from protocol.access import VIEWER, Secrets, access_control, session_id, write_secrets
from protocol.codec import MAX_FRAME_BYTES
from protocol.errors import InputError, LinkError

# Zenoh's log is never initialised, because it would go to stdout, which is for tables and JSON.

FREE_PORT_TRIES = 8
"""Another run may take a free port between its being found and being used; then another port is tried."""
MAX_STRANGERS = 4000
"""Connections that have not said who they are yet; Zenoh closes further ones at once, robots' ones, too. By default it
takes 100, which one idle program fills. Each takes 11 kB."""
INTRODUCTION_MS = 3000
"""A connection that has not said by then who it is is closed: a robot's takes some ms, under load some hundred."""
RETRY_S = 0.2
"""Pause before all names are tried again."""
OTHER_FILES = 2000
"""Files and connections of a world beside: 1000 sessions, the files of 500 robots."""


def _config(mode: str, settings: dict[str, object]) -> zenoh.Config:
    common = {
        "mode": mode,
        "scouting/multicast/enabled": False,  # two runs on one machine must not find each other
        "scouting/gossip/enabled": False,
        # 26 B a message, and from the wall clock, so not reproducible
        "timestamping/enabled": {"router": False, "peer": False, "client": False},
        "adminspace/enabled": False,
        "transport/shared_memory/enabled": False,  # no gain at these sizes, and a race (zenoh #2628)
        # ms until the link to a stopped process ends; each side announces its own. A dead process closes its link at
        # once, so the lease is for stopped machines and cut networks, and a short stall costs nothing.
        "transport/link/tx/lease": 5000,
        "transport/link/tx/keep_alive": 4,
        # us that a blocking put waits for a receiver that does not read; the default of 5 s stalls all other robots
        "transport/link/tx/queue/congestion_control/block/wait_before_close": 300_000,
        "transport/link/rx/max_message_size": MAX_FRAME_BYTES,  # 1 GiB by default
    }
    config = zenoh.Config()
    for key, value in (common | settings).items():
        config.insert_json5(key, json.dumps(value))
    return config


def check_endpoint(endpoint: str) -> None:
    """Raise InputError unless endpoint looks like tcp/127.0.0.1:7447."""
    match = re.fullmatch(r"[a-z][a-z0-9-]*/\S+:(\d{1,5})", endpoint)
    if not match or int(match[1]) > 65535:
        raise InputError(f"{endpoint!r:.200} is no endpoint: write it like tcp/127.0.0.1:7447")


def _free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def open_router(listen: str | None = None, secrets: Secrets | None = None) -> Iterator[tuple[zenoh.Session, str]]:
    """Open the world's session, an embedded router, and yield it with its endpoint.

    listen: an endpoint such as tcp/0.0.0.0:7447; None for a free port of 127.0.0.1. secrets: of all that may
    connect, each with its own rights (protocol.access); None gives everybody all rights.
    Raises InputError where the endpoint cannot be listened on.
    """
    if listen:
        check_endpoint(listen)
    for left in reversed(range(1 if listen else FREE_PORT_TRIES)):
        endpoint = listen or _free_endpoint()
        try:
            with _guarded(secrets) as guard:
                session = zenoh.open(_config("router", {"listen/endpoints": [endpoint], **_doors(), **guard}))
        except zenoh.ZError as error:
            if left:
                continue
            raise InputError(f"cannot listen on {endpoint}: {_cause(error)}; choose another address") from None
        with session:  # closes it: a process with callbacks would hang at its exit
            yield session, endpoint
        return


def _doors() -> dict[str, object]:
    """Settings of a router that keeps room for robots while many connect and say nothing."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    files = MAX_STRANGERS + OTHER_FILES
    if soft != resource.RLIM_INFINITY and soft < files:
        soft = files if hard == resource.RLIM_INFINITY else min(hard, files)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        files = soft
    strangers = min(MAX_STRANGERS, max(files - OTHER_FILES, files // 2))
    return {"transport/unicast/accept_pending": strangers, "transport/unicast/accept_timeout": INTRODUCTION_MS}


@contextmanager
def _guarded(secrets: Secrets | None) -> Iterator[dict[str, object]]:
    """Settings of a router that knows these secrets, valid while it is opened."""
    if secrets is None:
        yield {}
        return
    with tempfile.TemporaryDirectory() as folder:  # only its owner can read it
        dictionary = Path(folder, "secrets")
        write_secrets(dictionary, secrets)
        yield {"transport/auth/usrpwd/dictionary_file": str(dictionary), "access_control": access_control(secrets)}


@contextmanager
def open_client(
    connect: str, timeout_s: float, name: str | None = None, secret: str | None = None
) -> Iterator[zenoh.Session]:
    """Open a session with the world's router at an endpoint such as tcp/127.0.0.1:7447.

    name and secret: of this robot or viewer, where the world asks for them. Raises LinkError when no world answers
    within timeout_s seconds (0: tried once), which is also what a wrong secret looks like, and where another session
    has this robot's secret.
    """
    check_endpoint(connect)
    identity = {} if name is None or secret is None or name == VIEWER else {"id": session_id(name, secret)}
    settings = _to(connect, timeout_s, name, secret)
    try:
        session = zenoh.open(_config("client", settings | identity))
    except zenoh.ZError as error:
        if "nable to connect" not in str(error):
            raise LinkError(f"cannot connect to {connect}: {_cause(error)}") from None
        if identity and _opens(settings | {"connect/timeout_ms": 0}):
            raise LinkError(f"another session is {name} at {connect}: end it, or use another name") from None
        raise LinkError(
            f"no world answers at {connect} within {timeout_s:g} s: check that it runs, that the address and "
            "port are right, that no firewall is between, and that the secret is the world's"
        ) from None
    with session:
        yield session


@contextmanager
def open_as_first(connect: str, timeout_s: float, secrets: Secrets) -> Iterator[tuple[str, zenoh.Session]]:
    """Open a robot's session with the world's router by the first of these names that nobody else has taken.

    Raises LinkError where no world answers within timeout_s seconds, or all names are taken.
    """
    check_endpoint(connect)
    deadline = time.monotonic() + timeout_s
    while True:
        for name, secret in secrets.items():
            settings = _to(connect, 0, name, secret) | {"id": session_id(name, secret)}
            try:  # Zenoh refuses a second session of an ID, so opening one is taking it
                session = zenoh.open(_config("client", settings))
            except zenoh.ZError:
                continue
            with session:
                yield name, session
            return
        if time.monotonic() > deadline:
            raise LinkError(
                f"within {timeout_s:g} s no world answers at {connect}, or each of its {len(secrets)} robots is there "
                "already: check the address, or start a world with more robots"
            )
        time.sleep(RETRY_S)


def _to(connect: str, timeout_s: float, name: str | None, secret: str | None) -> dict[str, object]:
    """Settings of a client of this endpoint, which tries to reach it for so long, by a name where it has a secret."""
    user = {"transport/auth/usrpwd/user": name, "transport/auth/usrpwd/password": secret}
    return ({} if name is None or secret is None else user) | {
        "listen/endpoints": [],
        "connect/endpoints": [connect],
        "connect/timeout_ms": int(timeout_s * 1000),
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 400, "period_increase_factor": 2},
    }


def _opens(settings: dict[str, object]) -> bool:
    """Whether a client's session opens with these settings; Zenoh tells no client why it refuses one."""
    try:
        with zenoh.open(_config("client", settings)):
            return True
    except zenoh.ZError:
        return False


def _cause(error: Exception) -> str:
    """What a zenoh error says last, without its source locations."""
    return str(error).split(" at /")[0].rsplit("[", 1)[-1].strip().rstrip(".")


def at_once(hear: Callable[[zenoh.Sample], None]) -> zenoh.handlers.Callback[zenoh.Sample]:
    """A callback that runs on the receiving thread; it must do no more than queue the sample.

    So all samples of one sender come in the order in which they were sent, whichever subscriber takes them.
    """
    return zenoh.handlers.Callback(hear, indirect=False)


def wait_for_matching(publishers: Iterable[zenoh.Publisher], timeout_s: float) -> None:
    """Wait until each publisher has a subscriber, as its messages are lost before. LinkError on a time-out."""
    deadline = time.monotonic() + timeout_s
    for publisher in publishers:
        while not publisher.matching_status:
            if time.monotonic() > deadline:
                raise LinkError(f"nobody reads {publisher.key_expr} within {timeout_s:g} s")
            time.sleep(0.002)
