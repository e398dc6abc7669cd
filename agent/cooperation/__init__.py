"""Trust, but verify: proposals, their evidence, and merged maps (paper IV)."""
