"""Pictures of matplotlib as PNG files."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any
from warnings import catch_warnings, filterwarnings

from protocol.files import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_figure(figure: Figure, file: Path, **options: Any) -> None:
    """Write a PNG, whole or not at all; options: of Figure.savefig. Raises UnwritableError."""
    png = io.BytesIO()
    with catch_warnings():
        filterwarnings("ignore", "Glyph .* missing from font", UserWarning)  # a box is drawn, and the page has the name
        figure.savefig(png, format="png", **options)
    write_whole(file, png.getvalue())
