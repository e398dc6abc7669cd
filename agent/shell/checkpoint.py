"""A mind on disk: what a robot's process that was killed and started again goes on from.

A file is a numpy archive of arrays, without pickle, moved to its place as a whole. The one before is kept, because a
process may be killed after it wrote a checkpoint of the tick at which it then comes back.
"""

from __future__ import annotations

import sys
import zipfile
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from agent.shell.mind import Mind
from agent.state import State
from protocol.files import write_whole

CHECKPOINT_S = 4.0
"""Simulated time between two checkpoints. One takes 1 ms; no map may lose more than 5 s."""
MAX_BYTES = 64 << 20
"""Of a checkpoint: ten times that of a mind with as many walls as it takes."""
BROKEN = (ValueError, LookupError, TypeError, ArithmeticError, MemoryError, EOFError, OSError, zipfile.BadZipFile)
"""What a file of any content may raise where it is read or a mind is restored."""


@runtime_checkable
class Keeps(Protocol):
    """A mind that can be kept, such as agent.robot.Robot. Others begin anew with each process."""

    def state(self) -> State:
        """What it must not forget. Its arrays change no more."""
        ...

    def restore(self, state: State) -> None:
        """Go on from a state, before the first step. Raises ValueError or LookupError where it makes no sense."""
        ...


def due(tick: int, rate_hz: float) -> bool:
    """Whether a mind is kept after its step at a tick; rate_hz: ticks a second."""
    return tick % max(1, round(CHECKPOINT_S * rate_hz)) == 0


def save(folder: Path, robot: str, run: str, tick: int, state: State) -> None:
    """Keep the state of a mind after its step at a tick. Raises UnwritableError."""
    folder.mkdir(parents=True, exist_ok=True)
    archive = BytesIO()
    np.savez(archive, allow_pickle=False, run=np.array(run), tick=np.array(tick), **state)
    file, before = _files(folder, robot)
    if file.exists():
        file.replace(before)
    write_whole(file, archive.getvalue(), durable=False)


def revived(make: Callable[[], Mind], folder: Path | None, robot: str, run: str, tick: int) -> Mind:
    """A mind that goes on from its newest checkpoint of this run before a tick, or begins anew where there is none.

    A file that is broken is told on stderr.
    """
    for file in _files(folder, robot) if folder is not None and tick else ():
        mind = make()
        try:
            state = _read(file)
            if isinstance(mind, Keeps) and str(state["run"]) == run and int(state["tick"]) < tick:
                mind.restore(state)
                return mind
        except FileNotFoundError:
            continue
        except BROKEN as error:
            print(f"{robot}: {file} is no checkpoint ({error}); it is left aside", file=sys.stderr)
    return make()


def _files(folder: Path, robot: str) -> tuple[Path, Path]:
    return folder / f"{robot}.npz", folder / f"{robot}.before.npz"


def _read(file: Path) -> dict[str, NDArray[Any]]:
    if file.stat().st_size > MAX_BYTES:
        raise ValueError(f"larger than {MAX_BYTES} bytes")
    with zipfile.ZipFile(file) as archive:
        if any(part.compress_type != zipfile.ZIP_STORED for part in archive.infolist()):
            raise ValueError("it is compressed")  # such a file may become much larger than it is
    with np.load(file, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays}
