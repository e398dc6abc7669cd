"""Settings of what a robot says."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from protocol.settings import Config, Positive


class TalkConfig(Config):
    """What a robot says, and when it counts a peer as met or lost."""

    beacon_s: Positive = 5.0
    """Between two beacons: two robots that pass at full speed are within 4 m of each other for 18 s."""
    sight_beacon_s: Positive = 1.0
    """The same while a disc is seen and a peer heard whose frame is not known: its places and the discs give it
    (agent.alignment.by_sight), and two robots that pass are in sight of each other for some seconds only."""
    map_period_s: Positive = 5.0
    """A peer is told of a changed map at most this often: walls of some seconds cost little more than one."""
    silence_s: Positive = 5.0
    """A peer unheard for longer is lost; the next message from it is a new contact (contracts)."""
    retry_s: Positive = 3.0
    """Before what was not acknowledged is sent again, doubling: more than there and back at 1 s of latency."""
    reassembly_s: Positive = 30.0
    """Parts of a map wait this long for the next one: three retries."""
    mtu_bytes: Annotated[int, Field(ge=64, le=65_536)] = 1200
    """The longest message: what the radio takes (world.radio_config); 64 of them must hold the map."""
    cell_mm: Annotated[int, Field(ge=1, le=1000)] = 10
    """Of the grid that maps travel on: the noise of a range, a fifth of the scorer's 5 cm."""
    slack_cells: Annotated[float, Field(ge=0, le=10)] = 1.5
    """A corner that moved less is not news: most corners of a map still shift by some millimetres a minute."""
    level_slack: Annotated[int, Field(ge=0, le=7)] = 2
    """As slack_cells, for an edge's likelihood, in sevenths."""
    likelihoods: bool = True
    """Whether edge likelihoods travel: 0.14 bytes a vertex."""
    axis_slack_deg: Positive = 1.0
    """The grid is turned anew where the map's axis is off by more: 2 cells on a wall of 1.2 m, 3 bits each."""
