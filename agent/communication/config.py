"""Settings of what a robot tells its peers."""

from typing import Annotated

from pydantic import Field

from protocol.settings import Config, Positive


class TalkConfig(Config):
    """How often a robot speaks, when a peer counts as lost, and how precisely maps travel."""

    beacon_s: Annotated[float, Field(ge=1e-3, le=5, allow_inf_nan=False)] = 5.0
    """Seconds between two beacons. Two robots that pass each other at full speed are within 4 m for 18 s. Who is silent
    for four of 5 s counts as out of touch, and what stands still as a post: so there are none longer."""
    sight_beacon_s: Positive = 1.0
    """The same while a teammate is seen and a peer in contact does not know the robot's frame, or the robot not its, or
    not for long. Beacons and sightings together give a frame, and show a wrong one soon. Two robots that pass see each
    other for a few seconds only."""
    map_period_s: Positive = 5.0
    """Seconds between two updates of the map to one peer, longer where more than three are in contact. Walls of some
    seconds take few bytes more than one wall."""
    silence_s: Positive = 5.0
    """A peer that was not heard for so many seconds is lost. Its next message is a new contact."""
    retry_s: Positive = 3.0
    """Seconds until unacknowledged parts are sent again, doubling each time: more than there and back at a latency
    of 1 s."""
    cell_mm: Annotated[int, Field(ge=1, le=1000)] = 10
    """Grid on which the corners of maps travel, mm: the noise of a range, and a fifth of what the scorer allows."""
    likelihoods: bool = True
    """Whether maps travel with the likelihood of each wall: 0.07 bytes a vertex."""
