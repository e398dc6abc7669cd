"""Which topics of a bag are read: of several robots, those of the one that the scans are of."""

from collections import Counter
from collections.abc import Iterable
from typing import Any

from protocol.errors import InputError


def most_of(connections: Iterable[Any], kind: str, asked: str | None, notes: list[str], beside: str = "") -> str | None:
    """The topic with most messages of a kind, or the one that was asked for; None where there is none of the kind.

    beside: another topic, in whose nearest namespace it should be. Others are noted. Raises InputError where the one
    that was asked for is absent.
    """
    counts = Counter[str]()
    for connection in connections:
        if connection.msgtype == kind:
            counts[connection.topic] += connection.msgcount
    if asked is not None and asked not in counts:
        raise InputError(f"{asked} is no topic of {kind} in it; there is {', '.join(sorted(counts)) or 'none'}")
    if not counts:
        return None
    best = asked or min(_nearest(counts, beside), key=lambda topic: (-counts[topic], topic))
    if asked is None and len(counts) > 1:
        notes.append(_instead([best], set(counts) - {best}))
    return best


def transforms_beside(scans: str, topics: Iterable[str], notes: list[str]) -> set[str]:
    """Of topics of tf, those of the robot that the scans are of: of each last name those in the nearest namespace."""
    named: dict[str, list[str]] = {}
    for topic in sorted(set(topics)):
        named.setdefault(topic.rpartition("/")[2], []).append(topic)
    read = {topic for alike in named.values() for topic in _nearest(alike, scans)}
    if others := {topic for alike in named.values() for topic in alike} - read:
        notes.append(_instead(read, others))
    return read


def _nearest(topics: Iterable[str], beside: str) -> list[str]:
    """Those in the innermost namespace of a topic that has any of them."""
    topics, words = list(topics), beside.strip("/").split("/")
    for depth in range(len(words) - 1, 0, -1):
        inside = "/".join(words[:depth]) + "/"
        if near := [topic for topic in topics if topic.lstrip("/").startswith(inside)]:
            return near
    return topics


def _instead(read: Iterable[str], others: Iterable[str]) -> str:
    read = sorted(read)
    return f"{', '.join(read)} {'was' if len(read) == 1 else 'were'} read, and not {', '.join(sorted(others))}"
