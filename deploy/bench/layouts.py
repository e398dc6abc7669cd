"""The layouts that benchmarks run in: the bundled worlds, and real ones beside the repository, where they are."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from deploy.bench.cases import ROOT
from world.worldfile import BUNDLED

SHARED = ROOT.parent / "shared" / "worlds"
"""Layouts made by others, which are not part of the project."""
FURNISHED = ["drlnav_house_tomas", "hurtado_apartment", "pal_home_w"]
"""Those of them with furniture."""


def path_of(name: str) -> str:
    """File of a layout's name; a file's own path stays as it is. Raises FileNotFoundError where it is absent."""
    for path in (Path(name), BUNDLED / f"{name}.yaml", SHARED / f"{name}.yaml"):
        if path.is_file():
            return str(path)
    raise FileNotFoundError(f"{name} is neither a bundled world nor in {SHARED}")


def present(names: Iterable[str]) -> list[str]:
    """The layouts of these that are there."""
    return [name for name in names if any(Path(f, f"{name}.yaml").is_file() for f in (BUNDLED, SHARED))]
