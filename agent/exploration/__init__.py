"""Where a robot goes and how it drives there (paper IV)."""
