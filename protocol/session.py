"""How sessions are opened: the world is an embedded router, robots and viewers are clients of its endpoint.

Reasons and measurements for every setting: docs/design.md.
"""

from __future__ import annotations

import hashlib
import ipaddress
import json
import re
import resource
import socket
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, wait
from contextlib import contextmanager, nullcontext, suppress
from functools import reduce
from threading import Thread
from typing import Any

import zenoh

from protocol.access import WORLD, Credentials, zenoh_id
from protocol.codec import MAX_FRAME_BYTES
from protocol.errors import InputError, Interrupted, LinkError
from protocol.inbox import SIGNAL_S

# Zenoh's log is never initialised, because it would go to stdout, which is for tables and JSON.

FREE_PORT_TRIES = 8
"""Another run may take a free port between its being found and being used; then another port is tried."""
MAX_STRANGERS = 4000
"""Connections that may be open and have not said yet who they are. Zenoh closes further ones at once, also those of
robots. Its default is 100, which one idle program fills. Each takes 11 kB."""
INTRODUCTION_MS = 3000
"""A connection that has not said by then who it is is closed: a robot's takes some ms, under load some hundred."""
RETRY_S = 0.2
"""Pause before all names are tried again."""
UNREACHED = "check that it runs and asks for no secret or certificate, the address, the port and firewalls between"
MAX_FILES = 1 << 20
"""As many as a process of Linux may open where nothing else is set."""
OTHER_FILES = 2000
"""Files and connections that a world needs beside strangers: 1000 sessions, and the files of 500 robots."""


def _config(mode: str, settings: dict[str, object]) -> str:
    """Zenoh's configuration as JSON, from settings by key/below/key."""
    common: dict[str, object] = {
        "mode": mode,
        "scouting/multicast/enabled": False,  # two runs on one machine must not find each other
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,  # ms that a router waits for others while it opens; 500 by default
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
    tree: dict[str, Any] = {}
    for key, value in (common | settings).items():
        *branches, leaf = key.split("/")
        reduce(lambda below, branch: below.setdefault(branch, {}), branches, tree)[leaf] = value
    return json.dumps(tree, indent=1)


def _open(settings: dict[str, object]) -> zenoh.Session:
    """A client's session. Raises ZError."""
    return zenoh.open(zenoh.Config.from_json5(_config("client", settings)))


def _open_unless(stopped: Callable[[], bool], settings: dict[str, object]) -> zenoh.Session:
    """The same; raises Interrupted when `stopped` says so.

    Zenoh does not return before a router that says nothing is given up, and no handler of a signal runs until then: so
    it waits in a thread, which ends with the process.
    """
    opened: Future[zenoh.Session] = Future()

    def work() -> None:
        try:
            opened.set_result(_open(settings))
        except zenoh.ZError as error:
            opened.set_exception(error)

    Thread(target=work, daemon=True).start()
    while not wait([opened], SIGNAL_S).done:
        if stopped():
            raise Interrupted
    return opened.result()


def check_endpoint(endpoint: str, credentials: Credentials | None = None) -> None:
    """Raise InputError unless endpoint looks like tcp/127.0.0.1:7447, or tls/... with certificates."""
    match = re.fullmatch(r"([a-z][a-z0-9-]*)/\S+:(\d{1,5})", endpoint)
    if not match or int(match[2]) > 65535:
        raise InputError(f"{endpoint!r:.200} is no endpoint: write it like tcp/127.0.0.1:7447")
    encrypted = credentials is not None and credentials.encrypted
    if (match[1] == "tls") != encrypted:
        wish = "write it as tls/..., as there are certificates" if encrypted else "tls needs --certs DIR"
        raise InputError(f"{endpoint:.200}: {wish}")


def check_reach(endpoint: str) -> None:
    """Raise InputError where others than this machine can connect to an endpoint."""
    host = endpoint.partition("/")[2].rpartition(":")[0].strip("[]")
    try:
        local = host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        local = False
    if not local:
        raise InputError(
            f"{endpoint:.200}: whoever reaches this address could take part: give --certs DIR or --secrets FILE, or "
            "--insecure in a network of your own"
        )


def _free_endpoint(protocol: str) -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"{protocol}/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def open_router(
    listen: str | None = None, credentials: Credentials | None = None, *, insecure: bool = False
) -> Iterator[tuple[zenoh.Session, str]]:
    """Open a session that is a router, such as the world's, and yield it with its endpoint.

    listen: an endpoint such as tcp/0.0.0.0:7447; None for a free port of 127.0.0.1. credentials: of all that may
    connect, each with its own rights (protocol.access); None gives everybody all rights, which insecure allows beyond
    this machine, too. Raises InputError where the endpoint cannot be listened on.
    """
    protocol = "tls" if credentials is not None and credentials.encrypted else "tcp"
    if listen:
        check_endpoint(listen, credentials)
        if credentials is None and not insecure:
            check_reach(listen)
    for left in reversed(range(1 if listen else FREE_PORT_TRIES)):
        endpoint = listen or _free_endpoint(protocol)
        try:
            with credentials.listening() if credentials is not None else nullcontext({}) as guard:
                session = zenoh.open(zenoh.Config.from_json5(router_config(endpoint, guard)))
        except zenoh.ZError as error:
            if left:
                continue
            raise InputError(f"cannot listen on {endpoint}: {_cause(error)}; choose another address") from None
        try:
            yield session, endpoint
        finally:  # a process with callbacks would hang at its exit
            with suppress(zenoh.ZError):  # a time-out, where strangers stand in the door
                session.close()  # type: ignore[no-untyped-call]
        return


def router_config(listen: str, guard: Mapping[str, object]) -> str:
    """Configuration of a router as JSON, with the settings of `Credentials.listening`; also for a router of others."""
    return _config("router", {"listen/endpoints": [listen], **_doors(), **guard})


def _doors() -> dict[str, object]:
    """Settings of a router that keeps room for robots while many connect and say nothing.

    Of TLS, Zenoh counts connections only when they have shaken hands. So this process may have as many files as the
    system lets it: else those who only connect would keep a world from writing its files.
    """
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    files = MAX_FILES if hard == resource.RLIM_INFINITY else min(hard, MAX_FILES)
    resource.setrlimit(resource.RLIMIT_NOFILE, (files, hard))
    strangers = min(MAX_STRANGERS, max(files - OTHER_FILES, files // 2))
    return {"transport/unicast/accept_pending": strangers, "transport/unicast/accept_timeout": INTRODUCTION_MS}


@contextmanager
def open_client(
    connect: str,
    timeout_s: float,
    name: str = "",
    credentials: Credentials | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> Iterator[zenoh.Session]:
    """Open a session with the world's router at an endpoint such as tcp/127.0.0.1:7447.

    name and credentials: of this robot, viewer or world, where the router asks for them. Raises LinkError when no
    session opens within timeout_s seconds (0: tried once), with the cause as far as it can be known, and where another
    session has this name's place; Interrupted where `stopped` becomes true before.
    """
    check_endpoint(connect, credentials)
    settings = _to(connect, timeout_s, name, credentials)
    try:
        session = _open_unless(stopped, settings)
    except zenoh.ZError as error:
        if "nable to connect" not in str(error):
            raise LinkError(f"cannot connect to {connect}: {_cause(error)}") from None
        if settings.pop("id", None) and _opens(settings | {"connect/timeout_ms": 0}):
            raise LinkError(f"another session is {name} at {connect}: end it, or use another name") from None
        hint = UNREACHED if credentials is None else credentials.refused(name, connect)
        whom = "router" if name == WORLD else "world"
        raise LinkError(f"no {whom} answers at {connect} within {timeout_s:g} s: {hint}") from None
    with session:
        yield session


@contextmanager
def place(connect: str, name: str) -> Iterator[bool]:
    """Hold the place of a name, such as the world's, at a router that asks nobody who they are, by one more session.

    Yields whether it was free.
    """
    zid = zenoh_id(hashlib.sha256(name.encode()).hexdigest())
    try:  # Zenoh refuses a second session of an ID, so opening one is taking it
        holder = _open(_to(connect, 0, name, None) | {"id": zid})
    except zenoh.ZError:
        yield False
    else:
        with holder:
            yield True


@contextmanager
def open_ros2_client(connect: str, timeout_s: float) -> Iterator[zenoh.Session]:
    """Open a session with the router of ROS 2 nodes, such as rmw_zenohd's, at an endpoint such as tcp/127.0.0.1:7447.

    Raises LinkError where none answers within timeout_s seconds.
    """
    check_endpoint(connect)
    stamped = {"timestamping/enabled": {"router": True, "peer": True, "client": True}}  # latched topics need it
    try:
        session = _open(_to(connect, timeout_s, "", None) | stamped)
    except zenoh.ZError:
        hint = "start `ros2 run rmw_zenoh_cpp rmw_zenohd`, or another Zenoh router, and check address and port"
        raise LinkError(f"no router of ROS 2 answers at {connect} within {timeout_s:g} s: {hint}") from None
    with session:
        yield session


@contextmanager
def open_as_first(connect: str, timeout_s: float, credentials: Credentials) -> Iterator[tuple[str, zenoh.Session]]:
    """Open a robot's session with the world's router by the first of these names that nobody else has taken.

    Raises LinkError where no world answers within timeout_s seconds, or all names are taken.
    """
    check_endpoint(connect, credentials)
    robots = credentials.robots
    choices = [(robot, _to(connect, 0, robot, credentials)) for robot in robots]
    deadline = time.monotonic() + timeout_s
    while True:
        for name, settings in choices:
            try:  # Zenoh refuses a second session of an ID, so opening one is taking it
                session = _open(settings)
            except zenoh.ZError:
                continue
            with session:
                yield name, session
            return
        if time.monotonic() > deadline:
            raise LinkError(
                f"within {timeout_s:g} s no world answers at {connect}, or each of its {len(robots)} robots is there "
                f"already (start a world with more robots): {credentials.refused(robots[0], connect)}"
            )
        time.sleep(RETRY_S)


def _to(connect: str, timeout_s: float, name: str, credentials: Credentials | None) -> dict[str, object]:
    """Settings of a client of this endpoint, which tries to reach it for so long."""
    return ({} if credentials is None else credentials.connecting(name)) | {
        "listen/endpoints": [],
        "connect/endpoints": [connect],
        "connect/timeout_ms": int(timeout_s * 1000),
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 400, "period_increase_factor": 2},
    }


def _opens(settings: dict[str, object]) -> bool:
    """Whether a client's session opens with these settings; Zenoh tells no client why it refuses one."""
    try:
        with _open(settings):
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


def is_read(publisher: zenoh.Publisher) -> bool:
    """Whether a publisher has a subscriber. Zenoh's stubs call its status a bool; it is an object, and always true."""
    status: Any = publisher.matching_status
    return bool(status.matching)


def wait_for_matching(publishers: Iterable[zenoh.Publisher], timeout_s: float, stopped: Callable[[], bool]) -> None:
    """Wait until each publisher has a subscriber, as its messages are lost before.

    Raises LinkError on a time-out, Interrupted where `stopped` becomes true.
    """
    deadline = time.monotonic() + timeout_s
    for publisher in publishers:
        while not is_read(publisher):
            if stopped():
                raise Interrupted
            if time.monotonic() > deadline:
                raise LinkError(f"nobody reads {publisher.key_expr} within {timeout_s:g} s")
            time.sleep(0.002)
