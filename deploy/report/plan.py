"""The floor plan of the page as SVG: true world, maps and paths, and the frames of its slider.

A drawing's unit is the metre, y up. All marks of a kind are one path string, so the page shows a frame by setting a
few strings. A dot is a stroke of zero length with a round cap, a square one with a square cap.
"""

import math
from bisect import bisect_left
from html import escape
from typing import Any

import numpy as np

from deploy.report import style
from deploy.report.rundir import Map, Run
from deploy.report.story import bonds, told
from protocol.arrays import Floats
from protocol.wireframe import Label
from world.recorder import TEAM
from world.worldfile import rings_of

MARGIN_M = 0.3  # room around the world
MAX_FRAMES = 600  # positions of the slider; in a run of 20 minutes, one every two seconds
MAX_TEXT = 1_200_000  # characters of all maps that the slider shows
SMALLER = 2.2  # times that the map of one robot is drawn smaller than the overview
MARKS = ("walls", "heard", "nominal", "occlusion", "frontier")  # the paths that make a map


def overview(run: Run) -> str:
    """All final maps over the true world, drawn side by side where they agree; "" where there is no common frame."""
    if not run.has_plan:
        return ""
    unit, stroke = _unit(run), style.stroke(len(run.placed))
    flipped, upright = _world(run), ""
    for k, robot in enumerate(run.placed):
        drawn = _strings(run.maps.get(robot), run.frames[robot], unit, k * stroke * unit)
        flipped += _layer(run, robot, drawn, _trail(run.paths.get(robot)), stroke, _place(run, robot, math.inf))
        upright += _start(run, robot, unit)
    names = f'<g id="names" font-size="{12 * unit:.3f}"></g>'
    flipped += '<g id="links"></g>'
    return _svg(run, flipped, upright + names, "plan", "All maps over the true world")


def single(run: Run, robot: str) -> str:
    """One robot's final map: over the true world where its frame is known, else in its own frame."""
    frame, wireframe, label = run.frames.get(robot), run.maps.get(robot), f"Map of {robot}"
    alone = wireframe if frame is None else None
    unit = _unit(run, alone) * SMALLER
    drawn = _strings(wireframe, frame, unit)
    if frame is None:
        return _svg(run, _layer(run, robot, drawn, "", 2.0), "", "single", label, alone)
    layer = _layer(run, robot, drawn, _trail(run.paths.get(robot)), 2.0)
    return _svg(run, _world(run) + layer, _start(run, robot, unit), "single", label)


def slider(run: Run) -> dict[str, Any]:
    """What the slider shows: `times`, `scans`, `coverage`, `story` and `bonds`, and per robot `at` and `maps`.

    times: seconds of the frames, one a simulated second where the run is not long; of a log, which `scans` tells,
    numbers of its scans. at: the robot's places at these times, centimetres, x and y in turn. maps: [number of the
    frame that shows it first, path strings as in MARKS]. coverage: per robot and for the team, thousandths at these
    times. Maps are thinned out where the page would grow too large.
    """
    if not run.has_plan or not (run.paths or run.snapshots):
        return {}
    step = max(1, math.ceil(run.duration / MAX_FRAMES))
    times = [float(t) for t in range(0, math.ceil(run.duration), step)]
    times.append(run.duration)
    unit, stroke = _unit(run), style.stroke(len(run.placed))
    maps, every = {}, 1
    while True:
        for k, robot in enumerate(run.placed):
            maps[robot] = _maps_at(run, robot, times, unit, k * stroke * unit, every)
        if (
            every >= MAX_FRAMES
            or sum(len(text) for one in maps.values() for _, drawn in one for text in drawn) < MAX_TEXT
        ):
            break
        every *= 2
    shown = {robot: {"at": _places(run, robot, times), "maps": maps[robot]} for robot in run.placed}
    covered = {name: _coverage(run, name, times) for name in (*run.robots, TEAM) if name in run.metrics}
    about = {"times": times, "scans": run.of_logs, "coverage": covered}
    return about | {"story": told(run), "bonds": bonds(run), "robots": shown}


def _maps_at(
    run: Run, robot: str, times: list[float], unit: float, aside: float, every: int
) -> list[tuple[int, list[str]]]:
    snapshots = run.snapshots.get(robot, [])[::every]
    if robot in run.maps:
        snapshots = [*snapshots, (times[-1], run.maps[robot])]
    made: list[tuple[int, list[str]]] = []
    for t, wireframe in snapshots:
        drawn = _strings(wireframe, run.frames[robot], unit, aside)
        if not made or drawn != made[-1][1]:
            made.append((min(bisect_left(times, t), len(times) - 1), drawn))
    return made


def _places(run: Run, robot: str, times: list[float]) -> list[int]:
    path = run.paths.get(robot)
    if path is None:
        return []
    rows = np.maximum(np.searchsorted(path[:, 0], times, "right") - 1, 0)
    return [round(100 * value) for value in path[rows, 1:].reshape(-1).tolist()]


def _coverage(run: Run, name: str, times: list[float]) -> list[int | None]:
    values = [run.metrics[name].at("coverage", t) for t in times]
    return [None if value is None else round(1000 * value) for value in values]


def _strings(wireframe: Map | None, frame: Floats | None, unit: float, aside: float = 0.0) -> list[str]:
    """The path strings of a map, as in MARKS, in the frame of the drawing, walls moved aside into the free space."""
    if wireframe is None:
        return [""] * len(MARKS)
    moved, r = wireframe.moved(frame).inset(aside), 4.5 * unit
    walls = moved.vertices[moved.edges].reshape(-1, 4)
    heard = np.isin(np.arange(len(walls)), list(moved.heard))
    dots, triangles, squares = (moved.vertices[moved.labels == label] for label in Label)
    return [
        *(_lines(walls[rows]) for rows in (~heard, heard)),
        "".join(f"M{x:.2f} {y:.2f}h0" for x, y in dots),
        "".join(f"M{x:.2f} {y + r:.2f}l{0.87 * r:.3f} {-1.5 * r:.3f}h{-1.74 * r:.3f}z" for x, y in triangles),
        "".join(f"M{x:.2f} {y:.2f}h0" for x, y in squares),
    ]


def _lines(walls: Floats) -> str:
    """Walls (m, 4) as a path string."""
    return "".join(f"M{x1:.2f} {y1:.2f}L{x2:.2f} {y2:.2f}" for x1, y1, x2, y2 in walls)


def _layer(run: Run, robot: str, drawn: list[str], trail: str, width: float, place: str = "") -> str:
    strings = {"trail": trail, **dict(zip(MARKS, drawn, strict=True)), "place": place}
    paths = "".join(f'<path class="{kind}" d="{d}"/>' for kind, d in strings.items())
    colours = f"--robot:{style.colour(run.robots.index(robot))};--wall:{width:.1f}"
    return f'<g class="robot" data-robot="{escape(robot)}" style="{colours}">{paths}</g>'


def _trail(path: Floats | None) -> str:
    """A robot's path, without positions within 5 cm of the last drawn one."""
    if path is None or not len(path):
        return ""
    kept = [path[0, 1:]]
    for point in path[1:, 1:]:
        if abs(point - kept[-1]).max() >= 0.05:
            kept.append(point)
    return "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in kept)


def _place(run: Run, robot: str, t: float) -> str:
    """A dot where the robot is at time t."""
    path = run.paths.get(robot)
    if path is None:
        return ""
    _, x, y = path[max(int(np.searchsorted(path[:, 0], t, "right")) - 1, 0)]
    return f"M{x:.2f} {y:.2f}h0"


def _world(run: Run) -> str:
    rings = rings_of(run.world.solid) if run.world else ()
    drawn = "".join("M" + "L".join(f"{x:.3f} {y:.3f}" for x, y in ring[:-1]) + "z" for ring in rings)
    return f'<path class="solid" d="{drawn}"/>' if run.world else ""


def _start(run: Run, robot: str, unit: float) -> str:
    """Disc, heading and name at a robot's start. y is negated: the flipped group would mirror the name."""
    x, y, theta = run.frames[robot]
    colour = style.colour(run.robots.index(robot))
    tip = max(2.2 * run.radius, 13 * _unit(run))
    return (
        f'<g class="start" data-robot="{escape(robot)}" style="--robot:{colour}">'
        f'<path d="M{x:.3f} {-y:.3f}l{tip * math.cos(theta):.3f} {-tip * math.sin(theta):.3f}"/>'
        f'<circle cx="{x:.3f}" cy="{-y:.3f}" r="{max(run.radius, 4.5 * unit):.3f}"/>'
        f'<text x="{x + 9 * unit:.3f}" y="{-y - 7 * unit:.3f}" font-size="{13 * unit:.3f}">'
        f"{escape(robot)}</text></g>"
    )


def _svg(run: Run, flipped: str, upright: str, kind: str, label: str, around: Map | None = None) -> str:
    x0, y0, x1, y1 = _bounds(run, around)
    unit = _unit(run, around) * (1.0 if kind == "plan" else SMALLER)
    return (
        f'<svg class="{kind}" role="img" aria-label="{escape(label)}" style="--unit:{unit:.5f}px" '
        f'viewBox="{x0:.3f} {-y1:.3f} {x1 - x0:.3f} {y1 - y0:.3f}" xmlns="http://www.w3.org/2000/svg">'
        f'<g transform="scale(1,-1)">{flipped}</g>{upright}</svg>'
    )


def _bounds(run: Run, around: Map | None = None) -> tuple[float, float, float, float]:
    """Bounds of the given map, else of the world, else of all maps and starts; with a margin."""
    if around is not None and len(around.vertices):
        points = around.vertices
    elif run.world is not None:
        x0, y0, x1, y1 = run.world.solid.bounds
        points = np.array([[x0, y0], [x1, y1]])
    else:
        placed = [run.maps[robot].moved(frame).vertices for robot, frame in run.frames.items() if robot in run.maps]
        points = np.concatenate([*placed, *([frame[:2]] for frame in run.frames.values()), np.zeros((1, 2))])
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _unit(run: Run, around: Map | None = None) -> float:
    """Metres per pixel where the overview, or the drawing of the given map, is 900 pixels wide or high."""
    x0, y0, x1, y1 = _bounds(run, around)
    return max(x1 - x0, y1 - y0) / 900
