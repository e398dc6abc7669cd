"""Recordings read back by Rerun's own reader."""

from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow as pa
import rerun as rr
from rerun.chunk import RrdReader

Rows = dict[str, dict[int | None, list[Any]]]
"""By component, such as TextLog:text, its values by tick; None is the tick of what stands still."""


@contextmanager
def strict() -> Iterator[None]:
    """Let a value that Rerun cannot take fail, instead of a warning."""
    rr.set_strict_mode(True)
    try:
        yield
    finally:
        rr.set_strict_mode(False)


def read_back(file: Path) -> dict[str, Rows]:
    """What a recording holds, by path."""
    found: defaultdict[str, Rows] = defaultdict(dict)
    for chunk in RrdReader(file).stream():
        batch = chunk.to_record_batch()
        names = [name for name in batch.schema.names if ":" in name]
        ticks = [None] * len(batch) if chunk.is_static else batch.column("tick").to_pylist()
        for name in names:
            rows = found[chunk.entity_path.lstrip("/")].setdefault(name, {})
            for tick, value in zip(ticks, _plain(batch.column(name)), strict=True):
                if value is not None:
                    rows.setdefault(tick, []).append(value)
    return dict(found)


def _plain(column: pa.Array) -> list[Any]:
    return column.to_pylist()
