"""The terminal as a command at work needs it: for bars and tables that grow, and for the result that its files have."""

from rich.console import Console

from protocol.command import hush


class Terminal(Console):
    """Stderr, or stdout. Where nobody reads it any more (`2>&1 | head`), the work goes on."""

    def __init__(self, quiet: bool = False, stderr: bool = True, least_width: int = 0) -> None:
        """least_width: characters of a line; a narrower terminal breaks it, where a table would lose figures."""
        super().__init__(stderr=stderr, quiet=quiet)
        if self.width < least_width:
            self.width = least_width

    def on_broken_pipe(self) -> None:
        """Write to nowhere from now on; what is raised otherwise would end the work."""
        hush(self.file)

    def show_cursor(self, show: bool = True) -> bool:
        """Leave the cursor where a bar would hide it: a command that ends at once could not give it back."""
        return False
