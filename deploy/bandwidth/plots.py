"""bandwidth.png: bytes over time, per square metre explored, and against the quality of the maps."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from deploy.bandwidth.books import NoRunError
from deploy.bandwidth.representations import NAMES, Measurement
from deploy.png import write_figure
from deploy.report.rundir import BROKEN, read_metrics
from deploy.report.style import colour
from protocol.arrays import Floats
from world.recorder import TEAM

NAMED = 8
"""Robots in the legend: that of thirty was higher than the picture."""


def draw(run: Path, measurement: Measurement) -> Path:
    """Write bandwidth.png into the run directory. Raises NoRunError where its metrics.csv is damaged."""
    figure = Figure(figsize=(15, 5))
    figure.subplots_adjust(left=0.05, right=0.99, bottom=0.11, top=0.92, wspace=0.3)  # fitting them takes half a second
    FigureCanvasAgg(figure)
    times, areas, quality = figure.subplots(1, 3)
    _over_time(times, measurement)
    _per_area(areas, measurement)
    _against_quality(quality, measurement, _coverage(run / "metrics.csv"))
    path = run / "bandwidth.png"
    write_figure(figure, path, dpi=110)
    return path


def _over_time(axes: Axes, measurement: Measurement) -> None:
    for number, robot in enumerate(sorted({robot for _, robot, _ in measurement.sent})):
        for name, style in (("delta", "-"), ("full", ":")):
            t, size = _sent(measurement, name, robot)
            label = f"{robot} {name}" if number < NAMED else None
            axes.step(t, np.cumsum(size), where="post", label=label, color=colour(number), ls=style)
    axes.set(xlabel="simulated seconds", ylabel="bytes sent", title="Maps sent by each robot", ylim=(0, None))
    if measurement.sent:
        axes.legend(fontsize=8)


def _per_area(axes: Axes, measurement: Measurement) -> None:
    totals, area = measurement.totals(), sum(measurement.explored_m2.values())
    names = sorted((name for name in NAMES if totals[name]), key=totals.__getitem__, reverse=True)
    if not (area and names):
        return
    colours = ["C0" if name == "delta" else "0.7" for name in names]
    bars = axes.barh(names, [totals[name] / area for name in names], color=colours)
    axes.bar_label(bars, fmt="{:,.2f}", fontsize=8, padding=2)
    axes.set(xscale="log", xlabel="bytes per square metre explored", title="Cost of each form")
    axes.set_xlim(right=8 * max(totals.values()) / area)  # room for the figures


def _against_quality(axes: Axes, measurement: Measurement, coverage: tuple[Floats, Floats]) -> None:
    t, share = coverage
    for name in NAMES:
        at, size = _sent(measurement, name)
        if len(at) and len(t):
            axes.plot(np.cumsum(size), np.interp(at, t, share), lw=2 if name == "delta" else 1, label=name)
    axes.set(xlabel="bytes of all robots", ylabel="coverage, mean of the robots", title="Bytes against map quality")
    if measurement.updates:
        axes.set_xscale("log")
        axes.legend(fontsize=8)


def _sent(measurement: Measurement, name: str, only: str | None = None) -> Floats:
    """(2, n) simulated seconds and bytes of what all robots, or only one, sent in one form, in order."""
    charged = [(update.t, update.robot, update.bytes.get(name, 0)) for update in measurement.updates]
    sent = measurement.sent if name == "delta" else charged
    rows = sorted((t, size) for t, robot, size in sent if only in (None, robot))
    return np.array(rows, np.float64).reshape(-1, 2).T


def _coverage(file: Path) -> tuple[Floats, Floats]:
    """Simulated seconds, and the mean of the robots' coverages."""
    try:
        robots = [series for name, series in read_metrics(file).items() if name != TEAM]
        times, row = np.unique(np.concatenate([series.t for series in robots]), return_inverse=True)
        shares = np.concatenate([series.columns["coverage"] for series in robots])
    except BROKEN as error:
        raise NoRunError(f"{file} cannot be drawn: {error}") from None
    return times, np.bincount(row, shares) / np.bincount(row)
