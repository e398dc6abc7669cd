"""From ranges to corners and walls; nothing beyond it reads a range (paper I)."""
