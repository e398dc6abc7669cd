"""All thresholds of a robot's mind, with units and reasons."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Config(BaseModel):
    """Immutable and free of unknown keys, so that a typing error in a file is found."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class AgentConfig(Config):
    """One robot's mind."""
