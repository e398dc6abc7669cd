"""The particle filter over wireframes (paper III-B)."""
