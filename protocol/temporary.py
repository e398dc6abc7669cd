"""Temporary folders, which go with their process also where it ends in the midst of its work."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NoReturn

_folders = set[str]()


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """A folder that is there as long as the context, or the process. Raises OSError."""
    with TemporaryDirectory(prefix="wireswarm-") as folder:
        remove_with_process(folder)
        try:
            yield Path(folder)
        finally:
            _folders.discard(folder)


def remove_with_process(folder: str) -> None:
    """Let `leave` remove a folder that another one made."""
    _folders.add(folder)


def leave(status: int) -> NoReturn:
    """End at once with an exit status, also from a signal's handler, and leave no temporary folder."""
    for folder in list(_folders):
        shutil.rmtree(folder, ignore_errors=True)
    os._exit(status)
