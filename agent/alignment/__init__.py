"""Alignment of two wireframes that share no frame (paper III-C)."""

from agent.alignment.align import Alignment, PreparedMap, align, align_prepared, prepare
from agent.alignment.config import AlignmentConfig
from agent.alignment.meeting import Meeting

__all__ = ["Alignment", "AlignmentConfig", "Meeting", "PreparedMap", "align", "align_prepared", "prepare"]
