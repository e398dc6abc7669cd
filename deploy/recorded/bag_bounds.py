"""Bounds on what a bag may ask for, which the library that reads it does not check: memory, queries without an end."""

import resource
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import yaml

from protocol.document import LOADER, check_is_file, read_text
from protocol.errors import InputError

MORE_BYTES = 3 << 30
"""Memory beyond what the process has. The readings of the longest log that is taken are 640 MB; a bag of 10 kB asked
for 6 GB by its compressed chunk."""
METADATA = "metadata.yaml"
STORED = ("table", "index")  # what a bag in SQLite has; a view may be a query without an end


def check_bag(file: Path) -> None:
    """Look at a bag's file, or its folder, before it is read. Raises InputError, without its name."""
    for part in sorted(file.iterdir()) if file.is_dir() else [file]:
        check_is_file(part)
        if part.name == METADATA:
            _check_metadata(part)
        elif part.suffix == ".db3":
            _check_tables(part)


def _check_metadata(file: Path) -> None:
    """Refuse aliases, by which a few lines stand for billions of values."""
    try:
        events = yaml.parse(read_text(file), LOADER)
        if any(isinstance(event, yaml.AliasEvent) for event in events):
            raise InputError(f"{METADATA} has an alias: write out what it stands for")
    except yaml.YAMLError as error:
        raise InputError(f"it is no bag, or damaged: {METADATA}: {' '.join(str(error).split()):.200}") from None


def _check_tables(file: Path) -> None:
    try:
        with closing(sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as connection:
            kinds = {kind for (kind,) in connection.execute("SELECT DISTINCT type FROM sqlite_master")}
    except sqlite3.Error as error:
        raise InputError(f"it is no bag, or damaged: {error}") from None
    if strange := sorted(kinds - set(STORED)):
        raise InputError(f"{file.name} has a {strange[0]}, and a bag has tables only")


@contextmanager
def bounded_memory() -> Iterator[None]:
    """Let this process take MORE_BYTES more and no further, where Linux tells what it has; more is a MemoryError."""
    status = Path("/proc/self/statm")
    if not status.exists():
        yield
        return
    before = resource.getrlimit(resource.RLIMIT_AS)
    limits = [limit for limit in before if limit != resource.RLIM_INFINITY]
    most = int(status.read_text().split()[0]) * resource.getpagesize() + MORE_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (min([most, *limits]), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
