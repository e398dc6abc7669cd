"""The floor plan of the page as SVG: true world, maps and paths, and the frames of its slider.

A drawing's unit is the metre, y up. All marks of a kind are one path string, so the page shows a frame by setting a
few strings. A dot is a stroke of zero length with a round cap, a square one with a square cap.
"""

import math
from bisect import bisect
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np

from deploy.report import style
from deploy.report.rundir import Map, Run
from deploy.report.words import share
from protocol.arrays import Floats
from protocol.wireframe import Label
from world.recorder import TEAM
from world.worldfile import polygons_of

MARGIN_M = 0.3  # room around the world
MAX_FRAMES = 150  # positions of the slider; of a long run every second or third snapshot is shown
SMALLER = 2.2  # times that the map of one robot is drawn smaller than the overview
MARKS = ("walls", "nominal", "occlusion", "frontier")  # the paths that make a map


def overview(run: Run) -> str:
    """All final maps over the true world, drawn side by side where they agree."""
    unit, stroke = _unit(run), style.stroke(len(run.placed))
    flipped, upright = _world(run), ""
    for k, robot in enumerate(run.placed):
        drawn = _strings(run.maps.get(robot), run.frames[robot], unit, k * stroke * unit)
        flipped += _layer(run, robot, drawn, _trail(run.paths.get(robot)), stroke, _place(run, robot, math.inf))
        upright += _start(run, robot, unit)
    return _svg(run, flipped, upright, "plan", "All maps over the true world")


def single(run: Run, robot: str) -> str:
    """One robot's final map: over the true world where its frame is known, else in its own frame."""
    frame, unit, label = run.frames.get(robot), _unit(run) * SMALLER, f"Map of {robot}"
    drawn = _strings(run.maps.get(robot), frame, unit)
    if frame is None:
        return _svg(run, _layer(run, robot, drawn, "", 2.0), "", "single", label, run.maps.get(robot))
    layer = _layer(run, robot, drawn, _trail(run.paths.get(robot)), 2.0)
    return _svg(run, _world(run) + layer, _start(run, robot, unit), "single", label)


def frames(run: Run) -> dict[str, Any]:
    """What the slider shows: `times`, `captions`, and per robot `maps`, `trails` and `places`, one for each time.

    A map is a list of path strings as in MARKS, or 0 where it has not changed since the time before. A trail is the
    path driven since the time before.
    """
    times = sorted({t for robot in run.placed for t, _ in run.snapshots.get(robot, ())})
    if not times:
        return {}
    times = times[:: math.ceil(len(times) / MAX_FRAMES)]
    if run.duration > times[-1]:
        times.append(run.duration)
    unit, stroke = _unit(run), style.stroke(len(run.placed))
    shown = {}
    for k, robot in enumerate(run.placed):
        maps, places = _maps_at(run, robot, times, unit, k * stroke * unit), [_place(run, robot, t) for t in times]
        shown[robot] = {"maps": maps, "trails": _trails_at(run, robot, times), "places": places}
    return {"times": times, "captions": [_caption(run, t) for t in times], "robots": shown}


def _maps_at(run: Run, robot: str, times: list[float], unit: float, aside: float) -> list[list[str] | int]:
    snapshots = list(run.snapshots.get(robot, ()))
    if robot in run.maps:
        snapshots.append((times[-1], run.maps[robot]))
    made: list[list[str] | int] = []
    shown: list[str] = []
    latest = [bisect(snapshots, t, key=lambda snapshot: snapshot[0]) - 1 for t in times]
    for before, now in pairwise([-2, *latest]):
        wireframe = snapshots[now][1] if now >= 0 else None
        drawn = shown if now == before else _strings(wireframe, run.frames[robot], unit, aside)
        made.append(0 if drawn == shown else drawn)
        shown = drawn
    return made


def _trails_at(run: Run, robot: str, times: list[float]) -> list[str]:
    path = run.paths.get(robot)
    if path is None:
        return [""] * len(times)
    cuts = [0, *np.searchsorted(path[:, 0], times, "right").tolist()]
    return [_trail(path[a:b], "M" if a == 0 else "L") for a, b in pairwise(cuts)]


def _caption(run: Run, t: float) -> str:
    covered = {name: run.metrics[name].at("coverage", t) for name in (*run.robots, TEAM) if name in run.metrics}
    return ", ".join(f"{name} {share(value)}" for name, value in covered.items() if value is not None)


def _strings(wireframe: Map | None, frame: Floats | None, unit: float, aside: float = 0.0) -> list[str]:
    """The four path strings of a map in the frame of the drawing, walls moved aside into the free space."""
    if wireframe is None:
        return [""] * len(MARKS)
    moved, r = wireframe.moved(frame).inset(aside), 4.5 * unit
    walls = moved.vertices[moved.edges].reshape(-1, 4)
    dots, triangles, squares = (moved.vertices[moved.labels == label] for label in Label)
    return [
        "".join(f"M{x1:.3f} {y1:.3f}L{x2:.3f} {y2:.3f}" for x1, y1, x2, y2 in walls),
        "".join(f"M{x:.3f} {y:.3f}h0" for x, y in dots),
        "".join(f"M{x:.3f} {y + r:.3f}l{0.87 * r:.3f} {-1.5 * r:.3f}h{-1.74 * r:.3f}z" for x, y in triangles),
        "".join(f"M{x:.3f} {y:.3f}h0" for x, y in squares),
    ]


def _layer(run: Run, robot: str, drawn: list[str], trail: str, width: float, place: str = "") -> str:
    strings = {"trail": trail, **dict(zip(MARKS, drawn, strict=True)), "place": place}
    paths = "".join(f'<path class="{kind}" d="{d}"/>' for kind, d in strings.items())
    colours = f"--robot:{style.colour(run.robots.index(robot))};--wall:{width:.1f}"
    return f'<g class="robot" data-robot="{escape(robot)}" style="{colours}">{paths}</g>'


def _trail(path: Floats | None, begin: str = "M") -> str:
    """A robot's path, without positions within 5 cm of the last drawn one."""
    if path is None or not len(path):
        return ""
    kept = [path[0, 1:]]
    for point in path[1:, 1:]:
        if abs(point - kept[-1]).max() >= 0.05:
            kept.append(point)
    return begin + "L".join(f"{x:.2f} {y:.2f}" for x, y in kept)


def _place(run: Run, robot: str, t: float) -> str:
    """A dot where the robot is at time t."""
    path = run.paths.get(robot)
    if path is None:
        return ""
    _, x, y = path[max(int(np.searchsorted(path[:, 0], t, "right")) - 1, 0)]
    return f"M{x:.2f} {y:.2f}h0"


def _world(run: Run) -> str:
    parts = polygons_of(run.world.solid) if run.world else ()
    rings = [ring.coords[:-1] for part in parts for ring in (part.exterior, *part.interiors)]
    drawn = "".join("M" + "L".join(f"{x:.3f} {y:.3f}" for x, y in ring) + "z" for ring in rings)
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
    unit = _unit(run) * (1.0 if kind == "plan" else SMALLER)
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


def _unit(run: Run) -> float:
    """Metres per pixel where the overview is 900 pixels wide or high."""
    x0, y0, x1, y1 = _bounds(run)
    return max(x1 - x0, y1 - y0) / 900
