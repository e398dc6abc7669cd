"""Benchmarks: `benchmark.py` measures the cases and fills the tables that the parts of each benchmark declare.

A part is a module with `cases(quick)` and `TABLES`. A case is a function of plain arguments that returns figures; a
table says which cases make a row, what is made of their figures, and which bars the values must meet.
"""
