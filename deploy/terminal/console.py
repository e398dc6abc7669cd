"""Stderr for what grows and moves there: bars and tables of a command that is at work."""

import os
from pathlib import Path

from rich.console import Console


class Terminal(Console):
    """Stderr. Where nobody reads it any more (`2>&1 | head`), the work goes on."""

    def __init__(self, quiet: bool = False) -> None:
        super().__init__(stderr=True, quiet=quiet)

    def on_broken_pipe(self) -> None:
        """Write to nowhere from now on; what is raised otherwise would end the work."""
        self.file = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115  (open to the end)

    def show_cursor(self, show: bool = True) -> bool:
        """Leave the cursor where a bar would hide it: a command that ends at once could not give it back."""
        return False
