"""Which sources results come from."""

import hashlib
import subprocess
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).parents[1]
RUNNING = ("config.py", "inprocess.py", "launch/faults.py", "sensing.py")
JUDGING = (
    "metrics.py",
    "sweep/measure.py",
    "bench/errors.py",
    "bench/explored.py",
    "bench/layouts.py",
    "bench/made.py",
)
SOURCES = ("agent", "world", "protocol", *(f"deploy/{name}" for name in (*RUNNING, *JUDGING)))
"""Packages and files that every figure depends on."""


@cache
def sources(ignored: str = "") -> str:
    """Hash of SOURCES and their worlds, as they are when first asked, without files whose path begins with `ignored`.

    Empty: with all files.
    """
    digest = hashlib.sha256()
    for place in SOURCES:
        path = ROOT / place
        for source in sorted(path.rglob("*")) if path.is_dir() else [path]:
            name = source.relative_to(ROOT).as_posix()
            if source.suffix in (".py", ".yaml") and not (ignored and name.startswith(ignored)):
                digest.update(name.encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()


def revision() -> str:
    """The commit of a checkout whose SOURCES are as committed, else commit or version with a hash of the sources.

    The version where git is missing, or does not read the checkout, such as that of another user.
    """
    base = version("wireswarm")
    if (ROOT / ".git").exists():
        with suppress(OSError, subprocess.CalledProcessError):
            base = _git("rev-parse", "--short=12", "HEAD")
            if not _git("status", "--porcelain", "--", *SOURCES):
                return base
    return f"{base}-{sources()[:12]}"


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(ROOT), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
