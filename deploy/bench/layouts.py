"""The layouts that benchmarks run in: bundled worlds, real ones beside the repository, and those that are made."""

import hashlib
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import gettempdir
from typing import Any

from deploy.revision import ROOT
from protocol.arrays import Floats
from protocol.files import write_whole
from protocol.messages import RobotSpec
from world.draws import generator
from world.maze import GENERATED
from world.worldfile import BUNDLED, load, to_yaml

SHARED = ROOT.parent / "shared" / "worlds"  # layouts made by others, which are not part of the project
PLAIN = ["drlnav_stage7", "gbeltramo_building", "pal_passage_110cm_w", "tb3_dqn_stage4", "uday_building"]  # unfurnished
FURNISHED = ["drlnav_house_tomas", "hurtado_apartment", "pal_home_w"]  # those with furniture
KEEP = Path(os.environ.setdefault("WIRESWARM_BENCH", str(Path(gettempdir(), "wireswarm-bench"))))
"""Folder of large or intermediate files; made again where missing. Workers, whose temporary folder is another one,
inherit the variable, and so find what was made beforehand."""


def path_of(name: str) -> str:
    """What `load` takes for a layout's name: a file's own path, a bundled or generated world's, or a shared layout's.

    Raises FileNotFoundError where it is absent.
    """
    if GENERATED.fullmatch(name):
        return name
    for path in (Path(name), BUNDLED / f"{name}.yaml", SHARED / f"{name}.yaml"):
        if path.is_file():
            return str(path)
    raise FileNotFoundError(f"{name} is neither a bundled world nor in {SHARED}")


def content_of(name: str) -> str:
    """Hash of a layout's file that is no part of the project; empty where it is, or where there is none."""
    with suppress(FileNotFoundError):
        path = Path(path_of(name)).resolve()
        if not path.is_relative_to(ROOT.resolve()):
            return hashlib.sha256(path.read_bytes()).hexdigest()
    return ""


def present(names: Iterable[str]) -> list[str]:
    """The layouts of these that are there."""
    return [name for name in names if any(Path(f, f"{name}.yaml").is_file() for f in (BUNDLED, SHARED))]


def absent() -> list[str]:
    """The real layouts that are not there, which benchmarks leave out."""
    return [name for name in PLAIN + FURNISHED if not present([name])]


def written(document: Mapping[str, Any]) -> str:
    """File of a world that is made, named after its content."""
    text = to_yaml(document).encode()
    path = KEEP / "worlds" / f"{document['name']}-{hashlib.sha256(text).hexdigest()[:16]}.yaml"
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text)  # another process may write the same file
    return str(path)


def drawn_starts(world: str, robots: int, seed: int) -> Floats:
    """(robots, 3) starts in a layout as a run with `starts=random` draws them from its seed."""
    return load(path_of(world)).starts(robots, RobotSpec().radius_m, generator(seed, "starts"), drawn=True)
