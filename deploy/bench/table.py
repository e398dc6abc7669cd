"""The rows of a measurement as a table for people and JSON for programs."""

from __future__ import annotations

import json
import os
import platform
from importlib.metadata import version
from typing import Any


def print_rows(name: str, rows: list[dict[str, Any]]) -> None:
    """Print a table, and below it one line of JSON with the machine it was measured on."""
    heads = list(rows[0])
    cells = [heads, *([_cell(row[head]) for head in heads] for row in rows)]
    widths = [max(len(line[column]) for line in cells) for column in range(len(heads))]
    for line in cells:
        print("  ".join(text.rjust(width) for text, width in zip(line, widths, strict=True)))
    machine = {"python": platform.python_version(), "machine": platform.machine(), "cpus": os.cpu_count()}
    print(json.dumps({"bench": name, "version": version("wireswarm"), **machine, "rows": rows}))


def _cell(value: object) -> str:
    match value:
        case int():
            return f"{value:,}"
        case float():
            return f"{value:.4g}"
    return str(value)
