"""The layouts that benchmarks run in: the bundled worlds, and real ones beside the repository, where they are."""

from __future__ import annotations

from pathlib import Path

from deploy.bench.cases import ROOT
from world.worldfile import BUNDLED

SHARED = ROOT.parent / "shared" / "worlds"
"""Layouts made by others, which are not part of the project."""


def path_of(name: str) -> str:
    """File of a layout's name; a file's own path stays as it is. Raises FileNotFoundError where it is absent."""
    if Path(name).is_file():
        return name
    for folder in (BUNDLED, SHARED):
        if (folder / f"{name}.yaml").is_file():
            return str(folder / f"{name}.yaml")
    raise FileNotFoundError(f"{name} is neither a bundled world nor in {SHARED}")


def present(names: list[str]) -> list[str]:
    """The layouts of these that are there."""
    return [name for name in names if any(Path(f, f"{name}.yaml").is_file() for f in (BUNDLED, SHARED))]
