"""Tables of texts that robots, files and worlds say."""

from rich.table import Table
from rich.text import Text

from protocol.text import printable


def add_row(table: Table, *cells: str) -> None:
    """Add cells as they are: brackets are no markup, and control characters stand as escapes."""
    table.add_row(*(Text(printable(cell)) for cell in cells))
