"""What a robot hears in a tick, as values: who is in contact, and what each peer told that is new."""

from typing import NamedTuple

import numpy as np

from protocol.arrays import Floats, Ints
from protocol.messages import Event
from protocol.talk import Beacon
from protocol.wireframe import Wireframe


class ReceivedMap(NamedTuple):
    """The map of a peer, at a moment."""

    wireframe: Wireframe
    """In the peer's own frame."""
    tick: int
    """When the peer's map was so."""


class PeerViews(NamedTuple):
    """Where a peer has looked from."""

    points: Floats = np.zeros((0, 2))
    """(k, 2) metres, the peer's own frame."""
    need: Ints = np.zeros(0, np.int64)
    """(k,) tick of the peer's map that holds what it saw from there."""


NO_VIEWS = PeerViews()


class News(NamedTuple):
    """What a peer told in this tick."""

    peer: str
    since: int
    """Tick at which the contact with it began."""
    beacon: Beacon | None = None
    map: ReceivedMap | None = None
    """A newer map; at the beginning of a contact also the map that is known from an earlier one."""
    views: PeerViews | None = None
    """All its viewpoints, where new ones came."""


class Hearing(NamedTuple):
    """All that a robot heard in a tick."""

    news: list[News]
    """One of each peer that said something, in the order in which the contacts were made."""
    events: list[Event]
