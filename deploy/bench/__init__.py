"""Repeatable measurements: each returns rows, which are printed as a table and as JSON."""

from __future__ import annotations
