"""A world of one room, small enough for tests that start processes."""

import hashlib
import json
from pathlib import Path

from deploy.config import RunConfig

ROOM = """\
name: tiny
units: m
boxes:
  - [0, 1.5, 0, 4.2, 0.2]
  - [0, -1.5, 0, 4.2, 0.2]
  - [2, 0, 1.5707963267948966, 2.8, 0.2]
  - [-2, 0, 1.5707963267948966, 2.8, 0.2]
  - [0.5, 0.6, 0, 0.3, 0.3]
spawns: [[-1, -0.5, 0], [0, -0.5, 1.0], [1, -0.5, 2.0]]
"""

MACHINE = {"summary.json", "manifest.json", "report.html", "report.png"}
"""Files with times of the machine in them."""


def tiny_config(folder: Path, **settings: object) -> RunConfig:
    """A run of three robots in the room; the world file is written to the folder."""
    world = folder / "tiny.yaml"
    world.write_text(ROOM)
    return RunConfig.model_validate({"world": str(world), "robots": 3, "until": 20.0} | settings)


def digests(run: Path) -> dict[str, str]:
    """Hash of each file of a run directory that must be the same for the same run."""
    files = (path for path in sorted(run.rglob("*")) if path.is_file() and path.name not in MACHINE)
    return {str(path.relative_to(run)): hashlib.sha256(_comparable(path)).hexdigest() for path in files}


def _comparable(path: Path) -> bytes:
    """The file, without what sockets told of a run with processes."""
    if path.name != "bandwidth.json":
        return path.read_bytes()
    books = json.loads(path.read_text())
    books.pop("wire", None)
    return json.dumps(books).encode()
