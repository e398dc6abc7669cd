"""The file from which a killed run goes on: the world's state at one tick, and what it was told since.

A database would call them checkpoint and log. A world that is told the same does the same. So one that goes on from the
checkpoint, and is told all that is in the log, comes to the tick at which the run was killed. With each new state the
file is written anew as a whole. The log is appended to it entry by entry; an entry that was cut off was never told.
"""

import errno
import fcntl
import json
import os
import time
from collections.abc import Mapping
from io import FileIO
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from protocol.checksum import UNREADABLE, opened, sealed
from protocol.document import check_is_file
from protocol.errors import InputError
from protocol.files import UnwritableError, write_whole

CHECKPOINT_FILE = "checkpoint.msgpack"
"""The file in a run directory; it goes when the run ends, so a directory with one was not finished."""
MAX_BYTES = 1 << 30
"""Of the file: ten times what 500 robots in the largest world need."""
LOG_BYTES = 1 << 26
"""Of the log, from which on a new state is due: a hostile robot may answer 2 MB in a tick."""
FORMAT = 9
"""Version of the file; others are refused."""
LOOK_AGAIN_S = 0.05
"""A new checkpoint is not locked for a moment, in which its world seems to be gone; not at two looks."""
State = Mapping[str, Any]
"""What a part of the world needs in order to go on, as values of msgpack."""
Entry = tuple[str, bool, list[Any]]
"""What the episode was told: its method's name, whether it had looked at its tick by then, and the arguments."""


class CheckpointError(InputError):
    """No run can go on from this directory; one sentence says why."""


class Checkpoint:
    """The file, which its world holds locked, so that nobody else goes on with a run that goes on."""

    def __init__(self, out: Path) -> None:
        """`out` is the run directory."""
        self._out, self._file = out, out / CHECKPOINT_FILE
        self._stream: FileIO | None = None
        self._size = self._logged = 0

    def begin(self, state: State) -> None:
        """Begin the file anew with a state. Raises UnwritableError."""
        write_whole(self._file, sealed({"format": FORMAT, **state}), durable=False)
        self._lock(wait=True)  # for `is_left`, if that looks at the new file just now
        self._logged = 0

    def read(self) -> tuple[dict[str, Any], list[Entry]]:
        """State and log that a killed world left. Raises CheckpointError."""
        try:
            stream = self._lock()
            if self._file.stat().st_size > MAX_BYTES:
                raise CheckpointError(f"{self._file} is larger than {MAX_BYTES} bytes, which no checkpoint is")
            unpacker = msgpack.Unpacker(stream, strict_map_key=False, max_buffer_size=MAX_BYTES)
            state, log, begin = opened(unpacker.unpack()), list[Entry](), unpacker.tell()
            self._size = begin
            if state["format"] != FORMAT:
                raise CheckpointError(f"{self._file} is not of format {FORMAT}, which this program reads")
            for record in unpacker:
                try:
                    log.append(opened(record))
                except UNREADABLE:
                    if not _zeros_from(stream, unpacker.tell()):
                        raise
                    break
                self._size = unpacker.tell()
            self._logged = self._size - begin
        except FileNotFoundError:
            raise CheckpointError(f"{self._out} holds no run that can go on: it has no {CHECKPOINT_FILE}") from None
        except BlockingIOError:
            raise CheckpointError(f"{self._out}: its run goes on, in another process") from None
        except CheckpointError:
            raise
        except (OSError, *UNREADABLE) as error:
            raise self.broken(error) from None
        return state, log

    def go_on(self) -> None:
        """Go on with the log that was read; what a power cut left behind it is gone."""
        assert self._stream is not None
        self._stream.truncate(self._size)

    def add(self, entry: Entry) -> None:
        """Add to the log. Raises UnwritableError."""
        assert self._stream is not None
        data = sealed(entry)
        try:
            if self._stream.write(data) != len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            raise UnwritableError((self._file, error.strerror or str(error))) from error
        self._logged += len(data)

    @property
    def is_long(self) -> bool:
        """Whether the log has outgrown LOG_BYTES, so that a new state is due."""
        return self._logged > LOG_BYTES

    def remove(self) -> None:
        """Remove the file, as all results of the run are written."""
        self._file.unlink(missing_ok=True)
        if self._stream is not None:
            self._stream.close()

    def broken(self, error: BaseException) -> CheckpointError:
        """The error to raise where what was read makes no sense."""
        reason = error.strerror if isinstance(error, OSError) else type(error).__name__
        return CheckpointError(f"{self._file} is damaged, or no world of this version wrote it ({reason})")

    def _lock(self, wait: bool = False) -> FileIO:
        before = self._stream
        if self._file.exists():
            check_is_file(self._file)
        self._stream = FileIO(os.open(self._file, os.O_RDWR | os.O_APPEND), "r+")
        fcntl.flock(self._stream, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
        if before is not None:
            before.close()
        return self._stream


def _zeros_from(stream: FileIO, begin: int) -> bool:
    """Whether nothing else follows in a file. A power cut leaves zeros where bytes never came to the disk."""
    stream.seek(begin)
    return not any(piece.strip(b"\0") for piece in iter(lambda: stream.read(1 << 20), b""))


def is_left(out: Path) -> bool:
    """Whether a run directory is that of a killed world: it has a checkpoint that no process holds."""
    file = out / CHECKPOINT_FILE
    if not file.is_file():
        return False
    for look in range(2):
        time.sleep(look * LOOK_AGAIN_S)
        try:
            with file.open("rb") as stream:
                fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return False
    return True


def restore_array(array: NDArray[Any], data: bytes) -> None:
    """Fill an array from what its `tobytes` gave. Raises ValueError for another size, and where it is not finite."""
    array[...] = np.frombuffer(data, array.dtype).reshape(array.shape)
    if not np.isfinite(array).all():
        raise ValueError("a number is not finite")


def rng_state(rng: np.random.Generator) -> str:
    """State of a random generator. As JSON, because its numbers have 128 bits."""
    return json.dumps(rng.bit_generator.state)


def restore_rng(rng: np.random.Generator, state: str) -> None:
    """Let a random generator go on from a state."""
    rng.bit_generator.state = json.loads(state)
