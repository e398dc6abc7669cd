"""Alignment of two wireframes that share no frame (paper III-C)."""

from agent.alignment.align import Alignment, align_prepared
from agent.alignment.config import AlignmentConfig
from agent.alignment.meeting import Meeting
from agent.alignment.prepared import PreparedMap, prepare

__all__ = ["Alignment", "AlignmentConfig", "Meeting", "PreparedMap", "align_prepared", "prepare"]
