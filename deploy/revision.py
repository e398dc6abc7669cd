"""Which sources results come from."""

import ast
import hashlib
import subprocess
from collections.abc import Iterator, Sequence
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
PACKAGES = ("agent", "world", "protocol")
SOURCES = (*PACKAGES, *(f"deploy/{name}" for name in (*RUNNING, *JUDGING)))
"""Packages and files that every figure depends on."""
WITH_BENCHMARKS = (*PACKAGES, "deploy")
"""The same with all that measures and makes tables."""
NO_MATTER = ("bench/cases.py", "commands/", "report/picture.py", "terminal/", "view/")
"""Of deploy/: what keeps figures or shows them, and does not decide them."""


@cache
def sources(ignored: str = "", places: Sequence[str] = SOURCES) -> str:
    """Hash of `places` and their worlds, as they are when first asked, without files whose path begins with `ignored`.

    Empty: with all files.
    """
    digest = hashlib.sha256()
    for place in places:
        path = ROOT / place
        for source in sorted(path.rglob("*")) if path.is_dir() else [path]:
            name = source.relative_to(ROOT).as_posix()
            if source.suffix in (".py", ".yaml") and not (ignored and name.startswith(ignored)):
                digest.update(name.encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()


@cache
def with_imports(file: Path) -> str:
    """Hash of a Python file and of all modules of deploy/ that it imports, itself or through them, but NO_MATTER."""
    found, new = {file}, [file]
    while new:
        further = _imported(new.pop()) - found
        found |= further
        new += further
    digest = hashlib.sha256()
    for content in sorted(hashlib.sha256(path.read_bytes()).digest() for path in found):
        digest.update(content)
    return digest.hexdigest()


@cache
def _imported(file: Path) -> frozenset[Path]:
    """Modules of deploy/ that a Python file imports anywhere, within functions, too."""
    own = ROOT / "deploy"
    paths = {ROOT / f"{name.replace('.', '/')}.py" for name in _names(file) if name.startswith("deploy.")}
    shown = tuple(str(own / place) for place in NO_MATTER)
    return frozenset(path for path in paths if path.is_file() and not str(path).startswith(shown))


def _names(file: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (node.module, *(f"{node.module}.{alias.name}" for alias in node.names))


def revision(places: Sequence[str] = SOURCES) -> str:
    """The commit of a checkout whose `places` are as committed, else commit or version with a hash of these.

    The version where git is missing, or does not read the checkout, such as that of another user.
    """
    base = version("wireswarm")
    if (ROOT / ".git").exists():
        with suppress(OSError, subprocess.CalledProcessError):
            base = _git("rev-parse", "--short=12", "HEAD")
            if not _git("status", "--porcelain", "--", *places):
                return base
    return f"{base}-{sources(places=places)[:12]}"


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(ROOT), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
