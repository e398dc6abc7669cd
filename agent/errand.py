"""A drive to verify a proposal: the team says where to, the explorer says how it ended (paper IV; ours)."""

from dataclasses import dataclass
from typing import Literal

from protocol.arrays import Floats


@dataclass(eq=False)
class Errand:
    """The drive for the first proposal of the queue. Another place to look from is another errand."""

    place: Floats
    """(2,) metres, the robot's own frame: near it the robot looks."""
    since: int
    """Tick of setting out to the place of contact, of those in which the robot was awake."""
    detours: int = 0
    """Other places that the robot has driven to since."""
    ended: Literal["", "arrived", "no way"] = ""
    """How the drive has ended; empty while it is under way, or waits for what comes before it."""
