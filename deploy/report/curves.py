"""The curves of the page as SVG: a column of metrics.csv against simulated time, robots labelled at their ends.

Colours are the page's, so that dark mode turns them, too. The page moves the line of class `cursor`.
"""

import math
from collections.abc import Callable
from html import escape

import numpy as np

from deploy.report import style
from deploy.report.rundir import Run, Series
from deploy.report.words import share, size
from protocol.arrays import Floats
from world.recorder import TEAM

WIDTH, HEIGHT = 500.0, 290.0
LEFT, RIGHT, TOP, BOTTOM = 58.0, 62.0, 10.0, 36.0  # around the plot
MAX_POINTS = 250  # of a curve
MAX_LABELS = 12  # robots that are named at the ends of their curves
LABEL_PX = 11.0  # least distance of two labels
TICKS = 5
MERGES = {"accepted": ("merge", "M0 -5l5 5l-5 5l-5 -5z"), "unmerged": ("undone", "M-4 -4l8 8M4 -4l-8 8")}


def curves(run: Run) -> list[str]:
    """Coverage, with merges and undoings, and bytes sent."""
    return [
        _plot(run, "coverage", "Coverage of the visible wall", 1.0, share, team=True),
        _plot(run, "bytes_sent", "Bytes sent, in all", None, size, team=False),
    ]


def _plot(run: Run, column: str, title: str, top: float | None, words: Callable[[float], str], *, team: bool) -> str:
    shown = {name: one for name in (*run.robots, *([TEAM] if team else [])) if (one := _column(run, name, column))}
    most = top or max([1.0, *(float(np.nanmax(v)) for _, v in shown.values() if np.isfinite(v).any())])
    end = max(run.duration, 1.0)
    wide, high = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM

    def place(t: float, value: float) -> tuple[float, float]:
        return LEFT + wide * t / end, TOP + high * (1 - value / most)

    parts = []
    for value in _ticks(most):
        _, y = place(0, value)
        parts.append(f'<path class="grid" d="M{LEFT} {y:.1f}h{wide}"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{escape(_plain(words(value)))}</text>')
    for t in _ticks(end):
        x, _ = place(t, 0)
        parts.append(f'<text x="{x:.1f}" y="{HEIGHT - BOTTOM + 15}" text-anchor="middle">{t:g}</text>')
    parts.append(f'<text x="{LEFT + wide / 2}" y="{HEIGHT - 4}" text-anchor="middle">simulated seconds</text>')
    ends = []
    for name, (times, values) in shown.items():
        colour = "var(--ink)" if name == TEAM else style.colour(run.robots.index(name))
        points = [place(t, v) for t, v in zip(times, values, strict=True) if math.isfinite(v)]
        if not points:
            continue
        line = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
        marks = _marks(run, name, place) if column == "coverage" else ""
        kind = "team curve" if name == TEAM else "curve"
        parts.append(
            f'<g class="{kind}" style="--robot:{colour}" data-robot="{escape(name)}"><path d="{line}"/>{marks}</g>'
        )
        ends.append((points[-1][1], name, colour))
    if len(ends) <= MAX_LABELS:
        parts += _labels(ends)
    cursor = f'<path class="cursor" d="M0 {TOP}v{high}" data-left="{LEFT}" data-wide="{wide}" hidden=""/>'
    head = f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" aria-label="{escape(title)}">'
    return f"<figure><figcaption>{escape(title)}</figcaption>{head}{''.join(parts)}{cursor}</svg></figure>"


def _column(run: Run, name: str, column: str) -> tuple[Floats, Floats] | None:
    """Times and values of one robot, thinned out."""
    series = run.metrics.get(name)
    if series is None or column not in series.columns or not len(series.t):
        return None
    rows = np.unique(np.linspace(0, len(series.t) - 1, MAX_POINTS).astype(int))
    return series.t[rows], series.columns[column][rows]


def _marks(run: Run, name: str, place: Callable[[float, float], tuple[float, float]]) -> str:
    """Merges and undoings on a robot's curve."""
    series: Series | None = run.metrics.get(name)
    made = []
    for event in run.events:
        if event["robot"] == name and event["event"] in MERGES and series is not None:
            (word, mark), t = MERGES[event["event"]], event["t"]
            x, y = place(t, series.at("coverage", t) or 0.0)
            made.append(f'<path class="{word}" transform="translate({x:.1f} {y:.1f})" d="{mark}"/>')
    return "".join(made)


def _labels(ends: list[tuple[float, str, str]]) -> list[str]:
    """Names beside the ends of curves, moved apart where they would lie over each other."""
    made, floor = [], HEIGHT - BOTTOM + 4 - LABEL_PX * len(ends)
    last = -math.inf
    for y, name, colour in sorted(ends):
        last = max(min(y, floor + LABEL_PX), last + LABEL_PX)
        floor += LABEL_PX
        where = f'x="{WIDTH - RIGHT + 5}" y="{last + 4:.1f}"'
        made.append(f'<text class="name" {where} style="--robot:{colour}">{escape(name[:8])}</text>')
    return made


def _ticks(most: float) -> list[float]:
    """Round values from 0 to `most`, about TICKS."""
    rough = most / TICKS
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(s * power for s in (1, 2, 2.5, 5, 10) if s * power >= rough * 0.999)
    return [k * step for k in range(int(most / step + 1e-9) + 1)]


def _plain(text: str) -> str:
    """A figure without needless decimals."""
    return text.replace(".0 ", " ")
