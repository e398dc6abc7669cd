"""Alignment of two wireframes that share no frame (paper III-C)."""
