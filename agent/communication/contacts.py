"""Whom a robot hears: C of Algorithm 1. Known by messages alone, never by a list from the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from protocol.geometry import Pose
from protocol.messages import Event
from protocol.wireframe import Wireframe


class Seen(NamedTuple):
    """Where a peer has looked from."""

    points: NDArray[np.float64] = np.zeros((0, 2))
    """(k, 2) metres, its own frame."""
    need: NDArray[np.int64] = np.zeros(0, np.int64)
    """(k,) tick of its map that holds what it saw from there."""


NOTHING_SEEN = Seen()


@dataclass(slots=True)
class Contact:
    """A peer within radio range, and the last that it told."""

    peer: str
    since: int
    """Tick of the first message after silence."""
    last: int
    """Tick of the newest message."""
    pose: Pose | None = None
    """Where the peer was, in its own frame."""
    pose_tick: int = 0
    """When it was there."""
    wireframe: Wireframe | None = None
    """Its map, in its own frame."""
    map_tick: int = 0
    """When its map was so; a higher one is news."""
    seen: Seen = NOTHING_SEEN


class Contacts:
    """Peers heard lately, in the order in which they were first heard."""

    def __init__(self, robot: str, silence_ticks: int) -> None:
        self.robot = robot
        self.silence_ticks = silence_ticks
        self.present: dict[str, Contact] = {}

    def hear(self, tick: int, peer: str) -> list[Event]:
        """Count a peer as heard; a `contact` event where it was silent before."""
        contact = self.present.get(peer)
        if contact is not None:
            contact.last = tick
            return []
        self.present[peer] = Contact(peer, tick, tick)
        return [Event(event="contact", data={"peer": peer})]

    def forget(self, tick: int) -> list[Event]:
        """Drop peers that have been silent for too long, with a `lost` event each."""
        silent = [c.peer for c in self.present.values() if tick - c.last > self.silence_ticks]
        for peer in silent:
            del self.present[peer]
        return [Event(event="lost", data={"peer": peer}) for peer in silent]
