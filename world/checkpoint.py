"""The file from which a killed run goes on: the world's state at one tick, and what it was told since.

A database would call them checkpoint and log. Told the same, a world does the same, so the state at the tick of the
end is found by telling a world at the checkpoint all that follows it. The file is moved to its place as a whole with
each new state; the log is appended to it, entry by entry, and an entry that was cut off counts as never told.
"""

import json
from collections.abc import Mapping
from io import FileIO
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from protocol.files import UnwritableError, write_whole

NAME = "checkpoint.msgpack"
"""The file in a run directory; it goes when the run ends, so a directory with one was not finished."""
MAX_BYTES = 1 << 30
"""Of the file: ten times what 500 robots in the largest world need."""
FORMAT = 1
"""Of the file; another one is refused."""
BROKEN = (ValueError, LookupError, TypeError, ArithmeticError, AttributeError, MemoryError, msgpack.UnpackException)
"""What a file of any content may raise where a state is restored."""

State = Mapping[str, Any]
"""What a part of the world needs in order to go on, as values of msgpack."""
Entry = tuple[str, bool, list[Any]]
"""What the episode was told: its method's name, whether it had looked at its tick by then, and the arguments."""


class CheckpointError(ValueError):
    """No run can go on from this directory; one sentence says why."""


class Checkpoint:
    """The file while it is written."""

    def __init__(self, out: Path) -> None:
        """`out` is the run directory."""
        self._file = out / NAME
        self._log: FileIO | None = None

    def go_on(self, size: int) -> None:
        """Go on with the file as it is, but for an entry after the first `size` bytes that was cut off."""
        self._log = self._file.open("ab", buffering=0)
        self._log.truncate(size)

    def begin(self, state: State) -> None:
        """Begin the file anew with a state. Raises UnwritableError."""
        self._close()
        write_whole(self._file, msgpack.packb({"format": FORMAT, **state}), durable=False)
        self._log = self._file.open("ab", buffering=0)

    def add(self, entry: Entry) -> None:
        """Add to the log. Raises UnwritableError."""
        assert self._log is not None
        data = msgpack.packb(entry)
        try:
            if self._log.write(data) != len(data):
                raise OSError("the disk is full")
        except OSError as error:
            raise UnwritableError((self._file, error.strerror or str(error))) from error

    def remove(self) -> None:
        """Remove the file, as all results of the run are written."""
        self._close()
        self._file.unlink(missing_ok=True)

    def _close(self) -> None:
        if self._log is not None:
            self._log.close()


def read(out: Path) -> tuple[dict[str, Any], list[Entry], int]:
    """State and log in a run directory, and how many bytes of the file they take. Raises CheckpointError."""
    file = out / NAME
    try:
        if file.stat().st_size > MAX_BYTES:
            raise CheckpointError(f"{file} is larger than {MAX_BYTES} bytes, which no checkpoint is")
        with file.open("rb") as stream:
            unpacker = msgpack.Unpacker(stream, strict_map_key=False, max_buffer_size=MAX_BYTES)
            found = [(value, unpacker.tell()) for value in unpacker]
        state, log, size = found[0][0], [entry for entry, _ in found[1:]], found[-1][1]
        if state["format"] != FORMAT:
            raise CheckpointError(f"{file} has format {state['format']!r:.20}, this program reads format {FORMAT}")
    except FileNotFoundError:
        raise CheckpointError(f"{out} holds no run that can go on: it has no {NAME}") from None
    except OSError as error:
        raise CheckpointError(f"{file}: {error.strerror}") from None
    except CheckpointError:
        raise
    except BROKEN as error:
        raise broken(out, error) from None
    return state, log, size


def broken(out: Path, error: BaseException) -> CheckpointError:
    """The error to raise where a checkpoint was read, but makes no sense."""
    return CheckpointError(f"{out / NAME} is damaged: a world did not write it so ({type(error).__name__})")


def restore_array(array: NDArray[Any], data: bytes) -> None:
    """Fill an array from what its `tobytes` gave. Raises ValueError for another size, and where it is not finite."""
    array[...] = np.frombuffer(data, array.dtype).reshape(array.shape)
    if not np.isfinite(array).all():
        raise ValueError("a number is not finite")


def luck_state(rng: np.random.Generator) -> str:
    """State of a random generator. As JSON, because its numbers have 128 bits."""
    return json.dumps(rng.bit_generator.state)


def restore_luck(rng: np.random.Generator, state: str) -> None:
    """Let a random generator go on from a state."""
    rng.bit_generator.state = json.loads(state)
