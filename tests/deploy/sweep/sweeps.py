"""A sweep of short runs in a small room, and what its results must have in common however it was disturbed."""

from pathlib import Path

from deploy.sweep.store import read_rows
from deploy.sweep.work import Row
from tests.tiny import ROOM

RUNS = 8
SWEEP = """\
worlds: [tiny.yaml]
seeds: 4
settings: {until: 4, starts: random}
grid:
  robots: [1, 2]
"""


def write_sweep(folder: Path, text: str = SWEEP) -> Path:
    (folder / "tiny.yaml").write_text(ROOM)
    file = folder / "sweep.yaml"
    file.write_text(text)
    return file


def comparable(folder: Path) -> dict[str, Row]:
    """Rows by key, without what depends on the machine."""
    rows = {row["key"]: row for row in read_rows(folder)}
    return {
        key: {name: value for name, value in row.items() if not name.startswith("machine.")}
        for key, row in rows.items()
    }
