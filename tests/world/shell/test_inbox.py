"""What waits for the world is bounded for each robot."""

import time
from types import SimpleNamespace
from typing import Any

from protocol import keys
from protocol.access import ANYBODY
from protocol.codec import decode
from protocol.inbox import Arrival
from protocol.messages import MAX_TEXT, Refused
from world.shell.inbox import MOST_BYTES_WAITING, MOST_WAITING, WorldInbox, refuse


def taken(inbox: WorldInbox) -> list[Arrival]:
    arrivals = []
    while (arrival := inbox.take(time.monotonic())) is not None:
        arrivals.append(arrival)
    return arrivals


def test_a_robot_that_floods_the_world_is_told_once_and_the_others_are_heard() -> None:
    inbox = WorldInbox()
    for size, most in ((0, MOST_WAITING), (1 << 20, MOST_BYTES_WAITING >> 20)):
        for _ in range(2 * most):
            inbox.put(Arrival("act", "r1", bytes(size)))
        inbox.put(Arrival("act", "r2"))
        inbox.stop()
        *flood, last, other, stop = taken(inbox)
        assert {arrival.what for arrival in flood} == {"act"} and len(flood) in (most, most - 1)
        assert (last.what, last.robot, other.robot, stop.what) == (inbox.FLOOD, "r1", "r2", inbox.STOP)
    inbox.put(Arrival("act", "r1"))  # what was taken counts no more
    assert [arrival.what for arrival in taken(inbox)] == ["act"]


def test_whoever_asks_why_counts_as_one_by_whatever_name() -> None:
    inbox = WorldInbox()
    for number in range(MOST_WAITING + 2):
        query: Any = SimpleNamespace(key_expr=keys.service(f"x{number}", keys.WHY), payload=None)
        inbox.ask(query)
    assert inbox.qsize() == MOST_WAITING + 1
    assert {arrival.robot for arrival in taken(inbox)} == {ANYBODY}


def test_a_refusal_of_any_length_is_told_in_a_message() -> None:
    said: list[bytes] = []
    query: Any = SimpleNamespace(reply_err=said.append)
    refuse(query, "x" * (MAX_TEXT + 1))
    refuse(query, None)
    assert [decode(Refused, payload).reason for payload in said] == ["x" * MAX_TEXT]
