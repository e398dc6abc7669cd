"""report.png: the maps over the truth, each map alone, and the curves."""

import math
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from matplotlib.patheffects import withStroke
from matplotlib.ticker import EngFormatter, MaxNLocator, PercentFormatter
from shapely.geometry.base import BaseGeometry

from deploy.png import write_figure
from deploy.report import style
from deploy.report.rundir import Map, Run, Series
from deploy.report.words import headline, share, subtitle
from protocol.wireframe import Label
from world.recorder import TEAM
from world.worldfile import rings_of

MAX_SINGLE = 24  # maps of single robots that are drawn; nobody looks at more
NAMED = 12  # robots in a legend; with 100 of them legends hid all curves
TITLE_IN = 0.8  # height of title and subtitle

SETTINGS: Any = {
    "text.parse_math": False,  # names come from files
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "text.color": style.INK,
    "axes.labelcolor": style.INK,
    "axes.edgecolor": style.SOLID_EDGE,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": style.RULE,
    "grid.linewidth": 0.6,
    "xtick.color": style.FAINT,
    "ytick.color": style.FAINT,
    "legend.frameon": False,
    "legend.fontsize": 9,
}


def write_picture(run: Run, file: Path) -> None:
    """Write report.png."""
    single = run.robots[:MAX_SINGLE]
    columns = min(4, max(len(single), 3))
    rows = math.ceil(len(single) / columns)
    heights = [height for height in (7.2 * run.has_plan, 3.6 * rows) if height] or [1.0]
    height = TITLE_IN + sum(heights)
    with matplotlib.rc_context(SETTINGS):
        layout = ConstrainedLayoutEngine(rect=(0, 0, 1, 1 - TITLE_IN / height), wspace=0.03)
        figure = Figure(figsize=(13, height), layout=layout)
        FigureCanvasAgg(figure)
        figure.text(0.01, 1 - 0.30 / height, headline(run), size=17, weight="bold", va="center")
        figure.text(0.01, 1 - 0.58 / height, subtitle(run), size=10, color=style.FAINT, va="center")
        parts = figure.add_gridspec(len(heights), 1, height_ratios=heights)
        if run.of_logs and run.has_plan:
            draw_overview(figure.add_subplot(parts[0]), run)
        elif run.has_plan:
            whole = parts[0].subgridspec(2, 2, width_ratios=[7, 5.4])
            draw_overview(figure.add_subplot(whole[:, 0]), run)
            draw_coverage(figure.add_subplot(whole[0, 1]), run)
            draw_bytes(figure.add_subplot(whole[1, 1]), run)
        maps = parts[-1].subgridspec(max(rows, 1), columns)
        for k, robot in enumerate(single):
            axes = figure.add_subplot(maps[k // columns, k % columns])
            axes.set_axis_off()  # at once: ticks that nobody sees cost more than the maps
            draw_single(axes, run, robot)
        write_figure(figure, file, dpi=130, facecolor="white", metadata={"Software": None})


def draw_overview(axes: Axes, run: Run) -> None:
    """All maps over the true world, with paths and starts."""
    colours = {robot: style.colour(k) for k, robot in enumerate(run.robots)}
    placed = run.placed
    draw_world(axes, run)
    for robot in placed:
        draw_path(axes, run, robot, colours[robot])
    finish_plan(axes)
    span, stroke = max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())), style.stroke(len(placed))
    for k, robot in enumerate(placed):
        if robot in run.maps:
            beside = run.maps[robot].moved(run.frames[robot]).inset(k * stroke * span / 900)
            draw_map(axes, beside, colours[robot], 0.85 * stroke, 2.6)
    for robot in placed:
        draw_start(axes, run, robot, colours[robot])
    finish_plan(axes)
    draw_scale(axes)
    dot: Any = {"color": style.FAINT, "ls": "", "ms": 5}
    marks = [Line2D([], [], marker=mark, label=label.word, **dot) for label, mark in style.MARKS.items()]
    lines = [Line2D([], [], color=colours[robot], lw=3, label=robot) for robot in run.robots[:NAMED]]
    way = Line2D([], [], color=style.FAINT, lw=0.8, label="path")
    start = Line2D([], [], **dot | {"marker": "o", "mfc": "white", "mew": 1.6, "ms": 7, "label": "start, heading"})
    handles = [*lines, *marks, way, start]
    axes.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=min(len(handles), 5), handlelength=1.4
    )


def draw_single(axes: Axes, run: Run, robot: str) -> None:
    """One robot's map: over the truth where its frame is known, else in its own frame."""
    colour = style.colour(run.robots.index(robot))
    frame, about = run.frames.get(robot), "no map"
    if frame is not None:
        draw_world(axes, run)
        draw_path(axes, run, robot, colour)
    if robot in run.maps:
        draw_map(axes, run.maps[robot].moved(frame), colour, 1.4, 2.8)
        about = f"{len(run.maps[robot].edges)} walls"
    if frame is not None:
        draw_start(axes, run, robot, colour)
    finish_plan(axes)
    coverage = run.metrics[robot].at("coverage", math.inf) if robot in run.metrics else None
    covered = "" if coverage is None else f", {share(coverage)} covered"
    axes.set_title(f"{robot}: {about}{covered}", color=colour, size=10, weight="bold", y=1.0)  # else it asks the ticks


def draw_world(axes: Axes, run: Run) -> None:
    """The true solids in grey."""
    if run.world:
        draw_solids(axes, run.world.solid)


def draw_solids(axes: Axes, solid: BaseGeometry) -> None:
    """Solid areas in grey."""
    if rings := rings_of(solid):
        outline = Outline.make_compound_path(*(Outline(ring, closed=True) for ring in rings))
        axes.add_patch(PathPatch(outline, fc=style.SOLID, ec=style.SOLID_EDGE, lw=0.4, zorder=1))


def draw_map(axes: Axes, wireframe: Map, colour: str, width: float, size: float) -> None:
    """Walls as lines, vertices as circle (nominal), triangle (occlusion) or square (frontier)."""
    walls = wireframe.vertices[wireframe.edges]
    axes.add_collection(LineCollection(list(walls), colors=colour, linewidths=width, capstyle="round", zorder=3))
    for label, mark in style.MARKS.items():
        points = wireframe.vertices[wireframe.labels == label]
        size_pt, edge = (size, 0.0) if label == Label.NOMINAL else (1.9 * size, 0.4)  # what is open must be seen
        axes.plot(*points.T, mark, color=colour, ms=size_pt, mec="white", mew=edge, zorder=4)


def draw_path(axes: Axes, run: Run, robot: str, colour: str) -> None:
    """Where the robot drove."""
    if robot in run.paths:
        axes.plot(*run.paths[robot][:, 1:].T, color=colour, lw=0.8, alpha=0.45, zorder=2)


def draw_start(axes: Axes, run: Run, robot: str, colour: str) -> None:
    """A disc of the robot's size at its start, a stroke for its heading."""
    x, y, theta = run.frames[robot]
    tip = max(2.2 * run.radius, 0.015 * float(np.ptp(axes.get_xlim())))
    axes.plot([x, x + tip * math.cos(theta)], [y, y + tip * math.sin(theta)], color=colour, lw=1.6, zorder=6)
    axes.plot(x, y, "o", color="white", mec=colour, mew=1.6, ms=7, zorder=6)
    name = axes.annotate(robot, (x, y), xytext=(7, 5), textcoords="offset points", color=colour, size=9, zorder=7)
    name.set(weight="bold", path_effects=[withStroke(linewidth=2.5, foreground="white")])


def draw_scale(axes: Axes) -> None:
    """A bar of 1 m under the plan, at its left; the plan must be finished."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    y = low - 0.01 * max(right - left, high - low)
    axes.plot([left, left + 1.0], [y, y], color=style.INK, lw=2.0, solid_capstyle="butt", zorder=5)
    axes.annotate("1 m", (left + 1.0, y), xytext=(5, 0), textcoords="offset points", va="center", size=9)
    axes.autoscale_view()


def finish_plan(axes: Axes) -> None:
    """Equal scales, no box."""
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.grid(visible=False)
    axes.set_axis_off()


def draw_coverage(axes: Axes, run: Run) -> None:
    """Share of the visible wall against simulated time, each robot and the team, merges marked."""
    for k, robot, series in _curves(axes, run, "coverage"):
        for event, mark in (("accepted", "D"), ("unmerged", "X")):
            times = [float(e["t"]) for e in run.events if e.get("event") == event and e.get("robot") == robot]
            heights = [series.at("coverage", t) or 0.0 for t in times]
            axes.plot(times, heights, mark, color=style.colour(k), mec="white", ms=6, zorder=5)
    team = run.metrics.get(TEAM)
    if team is not None and "coverage" in team.columns:
        axes.plot(team.t, team.columns["coverage"], color=style.INK, lw=2.2, label="team", zorder=4)
    for level in (0.9, 0.99):
        axes.axhline(level, color=style.FAINT, lw=0.8, ls=(0, (4, 3)), zorder=1)
    axes.set(ylim=(0, 1.03), ylabel="coverage of the visible wall")
    axes.yaxis.set_major_formatter(PercentFormatter(1, decimals=0, symbol=" %"))
    _finish_curves(axes, run)


def draw_bytes(axes: Axes, run: Run) -> None:
    """Bytes that each robot put on the air, against simulated time."""
    _curves(axes, run, "bytes_sent")
    axes.set(ylabel="bytes sent, in all")
    axes.set_ylim(bottom=0)
    axes.yaxis.set_major_formatter(EngFormatter("B"))
    _finish_curves(axes, run)


def _curves(axes: Axes, run: Run, column: str) -> list[tuple[int, str, Series]]:
    """Draw a column of metrics.csv for each robot that has it; returns their numbers, names and series."""
    series = [(k, robot, run.metrics[robot]) for k, robot in enumerate(run.robots) if robot in run.metrics]
    drawn = [one for one in series if column in one[2].columns]
    for k, robot, one in drawn:
        axes.plot(one.t, one.columns[column], color=style.colour(k), lw=1.5, label=robot if k < NAMED else None)
    return drawn


def _finish_curves(axes: Axes, run: Run) -> None:
    """Axis of time, and the legend on the right of the plot, where no curve is."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), handlelength=1.4)
    axes.set_xlim(0, max(run.duration, 1.0))
    axes.set_xlabel("simulated time (s)")
    axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
