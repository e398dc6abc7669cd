"""A mind on disk: what a robot's process that was killed and started again goes on from.

A file is one record of arrays by name, each as type, shape and bytes, and moved to its place as a whole. It is no
archive of numpy's, as these have Python literals in them, whose parser fails in more ways than it says. The file before
the last is kept, too: a process may be killed after it wrote a checkpoint of the very tick at which it then comes back.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import msgpack
import numpy as np
from numpy.typing import NDArray

from agent.period import Period, in_ticks
from agent.shell.mind import Mind
from agent.state import State
from protocol.checksum import UNREADABLE, opened, sealed
from protocol.files import UnwritableError, write_whole

MIND_CHECKPOINT_S = 4.0
"""Simulated time between two checkpoints: a robot that comes back is to lose 5 s of its map at most. One takes 1 ms
where a map has 50 walls."""
MAX_BYTES = 64 << 20
"""Of a checkpoint: almost twice the joint covariance of one particle with as many walls as it may have rows of. Of more
particles with as many, none is kept."""
KINDS = re.compile(r"[<|][biufU]\d{1,3}")
"""Types of arrays, as numpy writes them, that a file may have."""


@runtime_checkable
class Keeps(Protocol):
    """A mind that can be kept, such as agent.robot.Robot. Others begin anew with each process."""

    def state(self) -> State:
        """What it must not forget. Its arrays change no more."""
        ...

    def restore(self, state: State) -> None:
        """Go on from a state, before the first step. Raises ValueError or LookupError where it makes no sense."""
        ...


def period(rate_hz: float) -> Period:
    """When a mind is kept after its step; rate_hz: ticks a second."""
    return Period(in_ticks(MIND_CHECKPOINT_S, rate_hz))


def save(folder: Path, robot: str, run: str, tick: int, state: State) -> None:
    """Keep the state of a mind after its step at a tick. Raises UnwritableError."""
    folder.mkdir(parents=True, exist_ok=True)
    arrays = {name: (array.dtype.str, array.shape, array.tobytes()) for name, array in state.items()}
    file, before = _files(folder, robot)
    record = sealed({"run": run, "tick": tick, "arrays": arrays})
    if len(record) > MAX_BYTES:  # it would not be read
        raise UnwritableError((file, f"the map is too large: {len(record)} bytes, of {MAX_BYTES} at most"))
    if file.exists():
        file.replace(before)
    write_whole(file, record, durable=False)


def revived(make: Callable[[], Mind], folder: Path | None, robot: str, run: str, tick: int) -> Mind:
    """A mind that goes on from its newest checkpoint of this run before a tick, or begins anew where there is none.

    A file that is broken is told on stderr.
    """
    for file in _files(folder, robot) if folder is not None and tick else ():
        mind = make()
        try:
            kept = _read(file)
            if isinstance(mind, Keeps) and kept["run"] == run and kept["tick"] < tick:
                mind.restore({name: _array(*array) for name, array in kept["arrays"].items()})
                return mind
        except FileNotFoundError:
            continue
        except (OSError, *UNREADABLE) as error:
            print(f"{robot}: {file} is no checkpoint ({error}); it is left aside", file=sys.stderr)
    return make()


def _files(folder: Path, robot: str) -> tuple[Path, Path]:
    return folder / f"{robot}.msgpack", folder / f"{robot}.before.msgpack"


def _read(file: Path) -> dict[str, Any]:
    if file.exists() and not file.is_file():  # a pipe may never end, nor does a device
        raise ValueError("this is no file")
    with file.open("rb") as stream:
        data = stream.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise ValueError(f"larger than {MAX_BYTES} bytes")
    kept = opened(msgpack.unpackb(data))
    if not isinstance(kept, dict):
        raise ValueError("it has no arrays")
    return kept


def _array(kind: str, shape: list[int], data: bytes) -> NDArray[Any]:
    if not KINDS.fullmatch(kind):
        raise ValueError(f"no array has the type {kind[:20]!r}")
    return np.frombuffer(data, kind).reshape(shape).copy()
