"""Bench of the alignment: pairs of partial maps, our features against 4PCS and ICP."""
