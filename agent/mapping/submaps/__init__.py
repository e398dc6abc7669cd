"""Submaps of walls in a pose graph: how a long way closes its loops (ours)."""
