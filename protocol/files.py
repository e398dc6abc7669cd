"""Files that are whole: a killed process or a full disk leaves no half of one behind."""

import errno
import os
import secrets
import stat
from collections.abc import Callable, Iterable
from contextlib import suppress
from io import FileIO
from pathlib import Path

from protocol.errors import InputError

PIECE_CHARS = 1 << 16
"""A LineFile keeps at most about so much before it hands it to the system."""
_NO_FILE = "this is no file"


class UnwritableError(OSError):
    """Files that cannot be written; one sentence names each with its path, and why."""

    def __init__(self, *failures: tuple[Path, str]) -> None:
        """failures: each file, with the system's reason."""
        self.failures = failures
        paths: dict[str, list[str]] = {}
        for file, reason in failures:
            paths.setdefault(reason, []).append(str(file))
        super().__init__("; ".join(f"cannot write {', '.join(files)}: {reason}" for reason, files in paths.items()))

    def __reduce__(self) -> tuple[type["UnwritableError"], tuple[tuple[Path, str], ...]]:
        return type(self), self.failures


def make_folder(out: Path, option: str = "--out") -> None:
    """Make the folder that an option names, with those above it, where it is not there yet. Raises InputError."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{option} {out}: {error.strerror}; name a directory that can be written") from None


def check_has_folder(file: Path, option: str = "--out") -> None:
    """Raise InputError where the folder of a file that an option names is none to write to, or the file is a folder."""
    if not os.access(f"{file.parent}/", os.W_OK | os.X_OK):
        raise InputError(f"{option} {file}: {file.parent} is no folder that can be written")
    if file.is_dir():
        raise InputError(f"{option} {file}: this is a folder; name a file")


def has_other_than(begin: bytes, file: Path) -> bool:
    """Whether what is there is of another kind, not to be replaced: a folder, or bytes that do not begin with these."""
    if not file.is_file():
        return file.is_dir()
    with file.open("rb") as stream:
        return not begin.startswith(stream.read(len(begin)))


def check_own(begin: bytes, file: Path) -> None:
    """Raise InputError where a file would be written over that does not begin with these bytes, as those of ours do."""
    if has_other_than(begin, file):
        raise InputError(f"{file} is there already and of another kind; name another folder by --out")


def write_whole(file: Path, content: str | bytes, *, private: bool = False, durable: bool = True) -> None:
    """Write a file so that it has all of its content, or is as it was before.

    private: only its owner may read it. durable: even if the power fails right after. Raises UnwritableError, also
    where a device or a pipe has the name: the file would take its place, and root may do that to /dev/null.
    """
    if file.exists() and not file.is_file():
        raise UnwritableError((file, os.strerror(errno.EISDIR) if file.is_dir() else _NO_FILE))
    part = file.with_name(f".{file.name}.{os.getpid()}-{secrets.token_hex(4)}")
    opened = os.O_WRONLY | os.O_CREAT | os.O_EXCL
    try:
        try:
            with os.fdopen(os.open(part, opened, 0o600 if private else 0o666), "wb") as stream:
                stream.write(content.encode() if isinstance(content, str) else content)
                stream.flush()
                if durable:
                    os.fsync(stream.fileno())  # else a power cut may leave the new name with an empty file
            part.replace(file)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise UnwritableError((file, error.strerror or str(error))) from error


def remove_empty(folders: Iterable[Path]) -> None:
    """Remove folders, from the inside out, up to the first that is not empty."""
    with suppress(OSError):
        for folder in folders:
            folder.rmdir()


def remove_parts(folder: Path) -> None:
    """Remove what `write_whole` left in a folder, or below, where its process was killed."""
    for part in folder.rglob(f".*.*-{'[0-9a-f]' * 8}"):
        part.unlink()


def write_all(*writers: Callable[[], object]) -> None:
    """Call each, so that one failing file loses no other; raises one UnwritableError for all that raised it."""
    failures: list[tuple[Path, str]] = []
    for write in writers:
        try:
            write()
        except UnwritableError as error:
            failures += error.failures
    if failures:
        raise UnwritableError(*failures)


class LineFile:
    """A file that grows line by line, and always ends with a complete one.

    Lines are added without an error: the first is kept for `check` and `close`, and nothing is written after it.
    """

    def __init__(self, file: Path, size: int = 0) -> None:
        """Open the file, and keep its first `size` bytes.

        Raises UnwritableError, also where a link or a pipe has the name: what a link points to is none of ours.
        """
        self._error: UnwritableError | None = None
        self.size = size
        """Bytes of the file."""
        self._file = file
        self._lines: list[str] = []
        self._waiting = 0
        try:
            self._stream = _to_append(file)
            self._stream.truncate(size)
        except OSError as error:
            raise UnwritableError((file, error.strerror or str(error))) from error

    def write(self, lines: str) -> None:
        """Add complete lines."""
        self._lines.append(lines)
        self._waiting += len(lines)
        if self._waiting >= PIECE_CHARS:
            self.flush()

    def flush(self) -> None:
        """Hand what was written so far to the system, so that a killed process loses nothing of it."""
        piece, self._lines, self._waiting = "".join(self._lines).encode(), [], 0
        if self._error:
            return
        written = 0
        try:
            while written < len(piece):
                written += self._stream.write(piece[written:])
        except OSError as error:
            self._error = UnwritableError((self._file, error.strerror or str(error)))
            written = piece.rfind(b"\n", 0, written) + 1
            self._stream.truncate(self.size + written)
        self.size += written

    def check(self) -> None:
        """Raise the UnwritableError of lines that could not be written."""
        if self._error:
            raise self._error

    def close(self) -> None:
        """Write what is left. Raises UnwritableError where any line could not be written."""
        self.flush()
        self._stream.close()
        self.check()


def _to_append(file: Path) -> FileIO:
    """The file, opened without waiting for a reader. Raises OSError, also for what is no regular file."""

    def opener(name: str, flags: int) -> int:
        return os.open(name, flags | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666)

    try:
        stream = FileIO(file, "ab", opener=opener)
    except OSError as error:
        raise OSError(error.errno, _NO_FILE if error.errno in (errno.ELOOP, errno.ENXIO) else error.strerror) from None
    if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
        stream.close()
        raise OSError(errno.ENXIO, _NO_FILE)
    return stream
