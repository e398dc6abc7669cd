"""What the processes of a run say on stdout and stderr, kept in the run directory."""

import faulthandler
import os
import sys
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path

MAX_LOG_BYTES = 1 << 20
"""Of one process. A program that says the same thing in each step of a long run must not fill the disk."""
LEFT_OUT = b"\n(the rest is left out)\n"
CHUNK_BYTES = 1 << 16


class Log:
    """The end of a pipe that a process speaks into, and the file where it is kept: none while nothing was said."""

    def __init__(self, file: Path, pipe: Connection) -> None:
        """A file that is there is continued, as by a process that takes the place of another."""
        self.file, self.pipe = file, pipe
        self._left = MAX_LOG_BYTES - (file.stat().st_size if file.exists() else 0)
        os.set_blocking(pipe.fileno(), False)

    def read(self) -> bool:
        """Keep what was said until now; whether more may come. A disk that is full loses the log and ends nothing."""
        while not self.pipe.closed:
            try:
                said = os.read(self.pipe.fileno(), CHUNK_BYTES)
            except BlockingIOError:
                return True
            if not said:
                self.pipe.close()
            elif self._left > 0:
                kept = said if len(said) <= self._left else said[: self._left] + LEFT_OUT
                self._left -= len(said)
                with suppress(OSError):
                    self.file.parent.mkdir(exist_ok=True)
                    with self.file.open("ab") as stream:
                        stream.write(kept)
        return False

    def where(self) -> str:
        """Words that name the file, after what is told of its process; none while there is none."""
        return f"; what it said is in {self.file}" if self.file.exists() else ""


def speak_into(pipe: Connection) -> None:
    """Let this process say all into a pipe from now on, also the trace of a crash in a library."""
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
        os.dup2(pipe.fileno(), stream.fileno())
    pipe.close()
    sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]
    faulthandler.enable()
