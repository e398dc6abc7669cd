"""Whom a robot hears: C of Algorithm 1. Known by messages alone, never by a list from the truth."""

from dataclasses import dataclass

from protocol.messages import Event


@dataclass(slots=True)
class Contact:
    """A peer within radio range."""

    since: int
    """Tick of the first message after silence."""
    last: int
    """Tick of the newest message."""


class Contacts:
    """Peers heard lately, in the order in which they were first heard."""

    def __init__(self, silence_ticks: int) -> None:
        self.silence_ticks = silence_ticks
        self.present: dict[str, Contact] = {}

    def hear(self, tick: int, peer: str) -> bool:
        """Count a peer as heard; true where it was silent before."""
        contact = self.present.get(peer)
        if contact is not None:
            contact.last = tick
            return False
        self.present[peer] = Contact(tick, tick)
        return True

    def forget(self, tick: int) -> list[Event]:
        """Drop peers that have been silent for too long, with a `lost` event each."""
        silent = [peer for peer, contact in self.present.items() if tick - contact.last > self.silence_ticks]
        for peer in silent:
            del self.present[peer]
        return [Event(event="lost", data={"peer": peer}) for peer in silent]
