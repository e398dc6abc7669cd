"""How many robots a run is for, where only an upper bound is known: those that come, such as copies of a container."""

import time
from collections.abc import Callable, Collection, Sequence

import zenoh

from protocol import keys
from protocol.access import ANYBODY
from protocol.errors import LinkError
from protocol.inbox import Inbox
from world.shell.inbox import WorldInbox, refuse
from world.shell.participants import Participants

SILENT_S = 3.0
"""A robot that has not asked for so long is gone; ours ask ten times a second."""
LOOK_S = 0.5
"""Time between two looks at who is gone."""


def count(
    session: zenoh.Session,
    inbox: WorldInbox,
    robots: Sequence[str],
    settle_s: float,
    timeout_s: float,
    known: Callable[[str], str | None] | None = None,
) -> int | None:
    """Wait until nobody has come or gone for settle_s seconds; returns how many robots are there, None: stopped.

    They are the first of `robots`. known: the Zenoh ID that each must have, as in `Participants`.
    Nobody is let in yet: a robot asks until there is a run to let it in, so one that asks no more is gone.
    Raises LinkError where for timeout_s seconds nobody is there, or a name before that of one who is.
    """
    there = Participants(robots, {}, known=known)
    asked: dict[str, float] = {}
    """When each robot that is there asked last: time.monotonic()."""
    changed = time.monotonic()
    with session.declare_queryable(keys.ALL_SRV, inbox.ask), session.liveliness().declare_token(keys.WORLD_ALIVE):
        while len(asked) < len(robots):
            before, complete = set(asked), _first(asked, robots)
            deadline = changed + (settle_s if complete else timeout_s)
            arrival = inbox.take(min(deadline, time.monotonic() + LOOK_S))
            if (arrival is None or arrival.robot == ANYBODY) and time.monotonic() >= deadline:
                if complete:
                    break
                missing = next(robot for robot in robots if robot not in asked)
                raise LinkError(f"{missing} did not join within {timeout_s:g} s: start it by `wireswarm agent`")
            if arrival is not None and arrival.query is not None:
                _note(there, asked, arrival.robot, arrival.what, arrival.payload, arrival.query)
            elif arrival is not None and arrival.what == Inbox.STOP:
                return None
            now = time.monotonic()
            asked = {robot: last_s for robot, last_s in asked.items() if now - last_s < SILENT_S}
            if asked.keys() != before:
                changed = now
    return len(asked)


def _first(some: Collection[str], robots: Sequence[str]) -> bool:
    """Whether these are the first robots, and not none."""
    return bool(some) and set(some) == set(robots[: len(some)])


def _note(
    there: Participants, asked: dict[str, float], robot: str, service: str, payload: bytes, query: zenoh.Query
) -> None:
    """Take a question: who may take part is there, who takes its leave is not."""
    if service == keys.WHY:
        with query:
            refuse(query, there.why_not(payload))
        return
    leaves = service == keys.LEAVE
    refusal = there.dismiss(robot, payload) if leaves else there.admit(robot, service, payload)
    with query:  # at once, as a question that waits keeps a robot from hearing signals
        if refusal is not None:
            refuse(query, refusal)
        elif leaves:
            query.reply(query.key_expr, b"")
            asked.pop(robot, None)
        else:  # no answer, so it asks again
            asked[robot] = time.monotonic()
