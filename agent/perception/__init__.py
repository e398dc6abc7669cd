"""From ranges to corners and walls; nothing else reads a range (paper I)."""
