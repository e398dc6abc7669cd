"""Alignment of two wireframes that share no frame (paper III-C), with the baselines it is compared to."""

from agent.alignment.align import Alignment, Contact, PreparedMap, align, align_prepared, prepare
from agent.alignment.config import AlignmentConfig

__all__ = ["Alignment", "AlignmentConfig", "Contact", "PreparedMap", "align", "align_prepared", "prepare"]
