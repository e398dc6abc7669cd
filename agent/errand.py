"""What became of the drive to the place where a proposal is verified."""

from enum import Enum


class ErrandEnd(Enum):
    """How such a drive ended."""

    ARRIVED = "arrived"
    FAILED = "failed"
    """There is no way, or the robot was stuck on it or took too long."""
