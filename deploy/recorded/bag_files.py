"""Which files are bags, by what they begin with: names get changed, and a recording that is broken off has another."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from deploy.manifest import FILE as MANIFEST
from protocol.errors import InputError
from protocol.temporary import temporary_folder

MCAP, SQLITE = b"\x89MCAP0\r\n", b"SQLite format 3\0"
BEGINS: Mapping[bytes, str] = {b"#ROSBAG V2": ".bag", MCAP: ".mcap", SQLITE: ".db3"}
"""The suffix by which a file of each kind is known."""
MENDERS: Mapping[str, str] = {".bag": "rosbag reindex", ".mcap": "mcap recover"}
METADATA = "metadata.yaml"  # of a bag that is a folder


def bag_in(path: Path) -> Path | None:
    """The bag that a path names: itself, or the only file of a folder without metadata; None where it is none.

    Raises InputError for a folder with several such files.
    """
    if not path.is_dir():
        return path if suffix_of(path) else None
    if (path / METADATA).exists():
        return path
    if (path / MANIFEST).exists():  # a run directory, in which somebody may have put a recording
        return None
    try:
        parts = [part for part in sorted(path.iterdir()) if suffix_of(part)]
    except OSError as error:
        raise InputError(f"{path}: it cannot be read: {error.strerror}") from None
    if len(parts) > 1:
        raise InputError(f"{path}: its {len(parts)} files are of a bag without {METADATA}; `ros2 bag reindex` makes it")
    return parts[0] if parts else None


def suffix_of(file: Path) -> str:
    """The suffix of a bag's file, by its first bytes or else by its name; empty where it is none."""
    begin = b""
    with suppress(OSError):  # who reads it says why that fails
        if file.is_file():  # a pipe may never end
            with file.open("rb") as stream:
                begin = stream.read(max(map(len, BEGINS)))
    for known, suffix in BEGINS.items():
        if begin.startswith(known):
            return suffix
    suffix = file.suffix.lower()
    return suffix if suffix in BEGINS.values() and not file.is_dir() else ""


@contextmanager
def known_by_suffix(bag: Path) -> Iterator[Path]:
    """The bag by a path that has the suffix of its kind, as the library that reads it wants."""
    suffix = suffix_of(bag)
    if suffix in ("", bag.suffix):
        yield bag
        return
    with temporary_folder() as folder:
        link = folder / f"bag{suffix}"
        link.symlink_to(bag.resolve())
        yield link


def how_to_mend(bag: Path) -> str:
    """What to do with a file that begins as a bag and cannot be read: most are recordings that were broken off."""
    mender = MENDERS.get(suffix_of(bag))
    return f"; if its recording was broken off, `{mender}` mends it" if mender and bag.is_file() else ""
