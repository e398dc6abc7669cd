"""How many robots a run is for, where only an upper bound is known: those that come, such as copies of a container."""

import time
from collections.abc import Callable, Sequence

import zenoh

from protocol import keys
from protocol.codec import decode
from protocol.errors import LinkError, ProtocolError
from protocol.inbox import Inbox
from protocol.messages import Join
from world.shell.inbox import WorldInbox


def count(
    session: zenoh.Session,
    inbox: WorldInbox,
    robots: Sequence[str],
    settle_s: float,
    timeout_s: float,
    known: Callable[[str], str | None] | None = None,
) -> int | None:
    """Wait until no further robot has asked to be let in for settle_s seconds; returns how many have, None: stopped.

    They are the first of `robots`. known: the Zenoh ID that each must have, as in `Participants`.
    Nobody is answered yet: a robot asks until there is a run to let it in.
    Raises LinkError where after timeout_s seconds nobody has asked, or a name before that of one who has is missing.
    """
    came: set[str] = set()
    give_up = time.monotonic() + timeout_s
    settled = give_up
    with session.declare_queryable(keys.ALL_SRV, inbox.ask), session.liveliness().declare_token(keys.WORLD_ALIVE):
        while len(came) < len(robots):
            missing = next(robot for robot in robots if robot not in came)
            complete = came == set(robots[: len(came)])
            arrival = inbox.take(settled if complete else give_up)
            if arrival is None:
                if came and complete:
                    break
                raise LinkError(f"{missing} did not join within {timeout_s:g} s: start it by `wireswarm agent`")
            if arrival.what == Inbox.STOP and arrival.query is None:
                return None
            if arrival.query is None:
                continue
            arrival.query.drop()  # type: ignore[no-untyped-call]  # at once: it keeps a robot from hearing signals
            true = known is None or _session(arrival.payload) == known(arrival.robot)
            if true and arrival.robot in set(robots) - came:
                came.add(arrival.robot)
                settled = time.monotonic() + settle_s
    return len(came)


def _session(question: bytes) -> str:
    """The Zenoh ID in a question to be let in; none where it makes no sense."""
    try:
        return decode(Join, question).session
    except ProtocolError:
        return ""
