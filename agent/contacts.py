"""Whom a robot hears: C of Algorithm 1. Known by messages alone, never by a list from the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from protocol.codec import decode
from protocol.errors import ProtocolError
from protocol.messages import Event, Heard, MapBroadcast, Pose
from protocol.wireframe import Wireframe, decode_wireframe


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
    pose_tick: int = -1
    """When it was there."""
    wireframe: Wireframe | None = None
    """Its map, in its own frame."""
    map_tick: int = -1
    """When its map was so; a higher one is news."""


class Contacts:
    """Peers heard lately, in the order in which they were first heard."""

    def __init__(self, robot: str, silence_ticks: int) -> None:
        self.robot = robot
        self.silence_ticks = silence_ticks
        self.present: dict[str, Contact] = {}

    def hear(self, tick: int, heard: Sequence[Heard]) -> list[Event]:
        """Take a tick's messages; returns `contact`, `lost` and `refused` events. A bad message changes nothing."""
        events = []
        for message in heard:
            try:
                broadcast = decode(MapBroadcast, message.payload)
                if broadcast.robot != message.sender:
                    raise ProtocolError(f"{message.sender} speaks as {broadcast.robot}")
                wireframe = decode_wireframe(broadcast.wireframe)
            except ProtocolError as error:
                events.append(Event(event="refused", data={"peer": message.sender, "reason": str(error)}))
                continue
            contact = self.present.get(message.sender)
            if contact is None:
                contact = self.present[message.sender] = Contact(message.sender, tick, tick)
                events.append(Event(event="contact", data={"peer": message.sender}))
            contact.last, contact.pose, contact.wireframe = tick, broadcast.pose, wireframe
            contact.pose_tick = contact.map_tick = message.tick - 1
        for peer in [c.peer for c in self.present.values() if tick - c.last > self.silence_ticks]:
            del self.present[peer]
            events.append(Event(event="lost", data={"peer": peer}))
        return events
