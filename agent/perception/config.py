"""Settings of perception."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from protocol.settings import Config, Positive


class PerceptionConfig(Config):
    """Scan to corners; chi-squares are in units of the lidar's noise."""

    method: Literal["piecewise", "split-and-merge"] = "piecewise"
    """Optimal piecewise fit (ours), or the paper's split and merge (its ref. 17)."""
    line_cost: Positive = 18.0
    """Chi-square that a wall piece must save: 0.999 of a line's 2 parameters plus its place (facts/mapping.md)."""
    stray_cost: Positive = 10.0
    """Chi-square of a beam that belongs to no wall: a hit at 3.2 sigma (facts/mapping.md)."""
    min_hits: Annotated[int, Field(ge=3)] = 3
    """Two beams fit any line; the third tells."""
    max_gap_m: Positive = 0.25
    """Wall is not claimed between two hits farther apart (facts/mapping.md)."""
    noise_floor_m: Positive = 0.003
    """Walls are not flatter than this; below it, chi-squares would see plaster."""
    min_corner_deg: Positive = 20.0
    """Lines that meet flatter than this have no usable intersection."""
    corner_slack_m: Positive = 0.1
    """A corner may lie this far outside its hits at most: three hits' direction excuses any place on the other line."""
    range_margin_sigmas: Positive = 3.5
    """How far a hit must be from its prediction to count as nearer or farther: 0.9995 of the noise."""
    disc_fit: Positive = 4.0
    """Mean chi-square a beam may have on a teammate's disc; leaves room for its motion within a turn."""
    disc_margin_m: Positive = 0.05
    """A beam this near to where a teammate was a moment ago is on it: 5 sigma of range."""
    disc_memory_scans: Annotated[int, Field(ge=1, le=100)] = 4
    """Scans for which a disc is remembered: one of ten is missed, so four in a row almost never are."""
    disc_in_wall_m: Positive = 0.08
    """A disc with its centre this near to a known wall is that wall's end: a teammate's is its radius away."""
    known_wall_m: Positive = 0.3
    """Walls shorter than this are no reason: one may be a teammate's own front."""
    post_still_s: Positive = 3.0
    """A disc that has not moved for so long while nobody is heard is a post; explorers stand for 0.8 s at a time."""
    post_near_m: Positive = 0.06
    """... nor by more than this: the spread of a disc's place from side to side; a teammate drives it in 0.3 s."""
    post_silence_s: Positive = 21.0
    """Nobody is heard where four beacons in a row did not come: one time in 120 at 30 % loss."""
    teammate_radius_m: Positive = 0.105
    """Radius of teammates, all of one kind."""
