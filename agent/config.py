"""All thresholds of a robot's mind, with units and reasons."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field


class Config(BaseModel):
    """Immutable and free of unknown keys, so that a typing error in a file is found."""

    model_config = ConfigDict(frozen=True, extra="forbid")


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


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
    range_margin_sigmas: Positive = 3.5
    """How far a hit must be from its prediction to count as nearer or farther: 0.9995 of the noise."""
    disc_fit: Positive = 4.0
    """Mean chi-square a beam may have on a teammate's disc; leaves room for its motion within a turn."""
    teammate_radius_m: Positive = 0.105
    """Radius of teammates, all of one kind."""


class AgentConfig(Config):
    """One robot's mind."""

    perception: PerceptionConfig = PerceptionConfig()
