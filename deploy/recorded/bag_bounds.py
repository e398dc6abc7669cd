"""Bounds on what a bag may ask for, which the library that reads it does not check: memory, queries without an end."""

import resource
import sqlite3
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path, PurePath
from typing import Any

import yaml

from deploy.recorded.bag_files import METADATA, SQLITE
from protocol.document import LOADER, MAX_DEPTH, check_is_file, read_text
from protocol.errors import InputError
from protocol.temporary import temporary_folder

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MORE_BYTES = 3 << 30
"""Memory beyond what the process has. The readings of the longest log that is taken are 640 MB; a bag of 10 kB asked
for 6 GB by its compressed chunk."""
INFORMATION = "rosbag2_bagfile_information"  # what METADATA begins with
STORED = ("table", "index")  # what a bag in SQLite has; a view may be a query without an end
PACKED = ".zstd"  # of names, as rosbag2 has them
PART_BYTES = 1 << 20  # of a compressed file that are unpacked at a time


@contextmanager
def checked(bag: Path) -> Iterator[Path]:
    """A bag's file or folder, looked at; where whole files of it are compressed, a folder with what they unpack to.

    Raises InputError, without its name, also where they unpack to more than MORE_BYTES.
    """
    for part in sorted(bag.iterdir()) if bag.is_dir() else [bag]:
        if part.is_dir():
            continue  # somebody put it there: bags have none
        _check_part(part, bag)
        if part.name == METADATA:
            _check_metadata(part)
        elif _is_sqlite(part):
            _check_tables(part)
    told = _compressed(bag)
    if told is None:
        yield bag
        return
    with temporary_folder() as folder:
        names = dict.fromkeys(PurePath(str(path)).name for path in told["relative_file_paths"])
        if not all(name.endswith(PACKED) for name in names):
            raise InputError(f"it is no bag, or damaged: a compressed file of it does not end in {PACKED}")
        plain, left = [folder / PurePath(name).stem for name in names], MORE_BYTES
        for name, part in zip(names, plain, strict=True):
            _check_part(bag / name, bag)
            left -= _unpack(bag / name, part, left)
            if _is_sqlite(part):
                _check_tables(part)
        told |= {"compression_mode": "", "relative_file_paths": [part.name for part in plain]}
        (folder / METADATA).write_text(yaml.safe_dump({INFORMATION: told}))
        yield folder


def _compressed(bag: Path) -> dict[str, Any] | None:
    """What the metadata of a bag whose files are compressed say, which are checked; None of any other bag."""
    if not (bag / METADATA).is_file():
        return None
    document = yaml.load(read_text(bag / METADATA), LOADER)
    told = document.get(INFORMATION) if isinstance(document, dict) else None
    if not isinstance(told, dict) or str(told.get("compression_mode")).lower() != "file":
        return None
    return told


def _check_part(part: Path, bag: Path) -> None:
    """Raise InputError for what is no file, with its name unless it is the bag itself."""
    try:
        check_is_file(part)
    except InputError as error:
        raise InputError(f"{part.name}: {error}" if part != bag else str(error)) from None


def _unpack(source: Path, target: Path, most: int) -> int:
    """Unpack a file of at most so many bytes; how many it has. Raises InputError for more."""
    size = 0
    with zstd.open(source, "rb") as packed, target.open("wb") as out:
        while part := packed.read(PART_BYTES):
            size += len(part)
            if size > most:
                raise InputError(f"it unpacks to more than {MORE_BYTES >> 30} GB; split it")
            try:
                out.write(part)
            except OSError as error:
                raise InputError(f"it cannot be unpacked to {target.parent}: {error.strerror}") from None
    return size


def _check_metadata(file: Path) -> None:
    """Refuse aliases, by which a few lines stand for billions of values, and what a loader's recursion cannot hold."""
    depth = 0
    try:
        for event in yaml.parse(read_text(file), LOADER):
            if isinstance(event, yaml.AliasEvent):
                raise InputError(f"{METADATA} has an alias: write out what it stands for")
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_DEPTH:
                raise InputError(f"{METADATA} is nested deeper than {MAX_DEPTH}")
    except yaml.YAMLError as error:
        raise InputError(f"it is no bag, or damaged: {METADATA}: {' '.join(str(error).split()):.200}") from None


def _is_sqlite(file: Path) -> bool:
    with file.open("rb") as stream:
        return stream.read(len(SQLITE)) == SQLITE


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
