"""The picture of a sweep's table: a panel for each measure, a point and its interval for each line of the table."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from deploy.png import write_figure
from deploy.sweep.statistics import Estimate

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ACROSS = 3
"""Panels side by side: as wide as a page of a screen."""
PANEL_IN, ROW_IN, AROUND_IN, TITLE_IN = 3.6, 0.4, 0.9, 0.5
"""Width of a panel, height of a line in it, and of its title and axis; height of the picture's title."""
DPI = 120
TALLEST_IN = 2**14 / DPI
"""Height of a picture, in which it has the pixels that a browser draws. Matplotlib draws four times as many."""


class Panel(NamedTuple):
    """Figures with one axis of values."""

    title: str
    rows: Sequence[tuple[str, Estimate | None, str]]
    """Label, figure, and words above it, such as why it is infinite or missing."""
    level: float | None = None
    """Where a line is that tells nothing from something, such as 0 of differences."""


def unit_of(measure: str) -> str:
    """Unit of a measure by its name; empty where it has none that the name tells."""
    name = measure.rpartition(".")[2]
    if name.startswith("t_") or name.endswith("_s"):
        return "s"
    if name.endswith(("coverage", "recall", "precision")):
        return "share"
    return "m" if name.endswith("_m") else "B" if "bytes" in name else ""


def titled(measure: str) -> str:
    """A measure with its unit."""
    unit = unit_of(measure)
    return f"{measure} ({unit})" if unit else measure


def draw(title: str, axis: str, panels: Sequence[Panel], file: Path) -> None:
    """A PNG of the panels, under a title. axis: what the labels are values of. Raises UnwritableError.

    Of panels that would make it higher than TALLEST_IN it has the first lines, and says so.
    An infinite end of an interval is the panel's edge, and an infinite figure has no point.
    """
    from matplotlib.figure import Figure

    across = min(ACROSS, len(panels))
    down = math.ceil(len(panels) / across)
    most = max(1, int(((TALLEST_IN - TITLE_IN) / down - AROUND_IN) / ROW_IN))
    if (lines := max(len(panel.rows) for panel in panels)) > most:
        title += f", the first {most} lines of {lines}"
        panels = [panel._replace(rows=panel.rows[:most]) for panel in panels]
    tall = AROUND_IN + ROW_IN * min(lines, most)
    figure = Figure((PANEL_IN * across + 2, tall * down + TITLE_IN), layout="constrained")
    figure.suptitle(title, fontsize=10, parse_math=False)
    places = figure.subplots(down, across, squeeze=False).ravel()
    for place in places[len(panels) :]:
        place.set_axis_off()
    for number, panel in enumerate(panels):
        _fill(places[number], panel)
        labels = [label for label, *_ in panel.rows]
        if number % across and labels == [label for label, *_ in panels[number - 1].rows]:
            labels = [""] * len(labels)
        elif axis and any(labels):
            places[number].set_ylabel(axis, parse_math=False)
        places[number].set_yticks(range(len(labels)), labels, parse_math=False)
    write_figure(figure, file, dpi=DPI)


def _fill(axes: "Axes", panel: Panel) -> None:
    """Points, intervals and words."""
    for row, (_, figure, _) in enumerate(panel.rows):
        if figure is not None:
            axes.plot(figure.value, row, "o", color="C0")
            axes.update_datalim([(end, row) for end in figure if end is not None and math.isfinite(end)])
    if panel.level is not None:
        axes.axvline(panel.level, color="0.5", lw=0.8)
    known = [end for _, figure, _ in panel.rows for end in figure or () if end is not None and math.isfinite(end)]
    edges = axes.set_xlim(axes.get_xlim())  # from here on they stay
    for row, (_, figure, words) in enumerate(panel.rows):
        if figure is not None and figure.low is not None and figure.high is not None:
            axes.plot(np.clip([figure.low, figure.high], *edges), [row, row], color="C0")
        place = axes.get_yaxis_transform()  # x as a share of the panel
        axes.text(0.02, row - 0.12, words, va="bottom", fontsize=7, color="0.3", transform=place)
    if not known:
        axes.set_xticks([])  # an axis without a value would be made up
    else:
        axes.locator_params(axis="x", nbins=5)
    axes.set_title(panel.title, fontsize=9, parse_math=False)
    axes.grid(axis="x", alpha=0.3)
    axes.set_ylim(len(panel.rows) - 0.4, -0.6)
