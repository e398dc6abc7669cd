"""Poles: what stands free and is too narrow for its walls to be seen, as the leg of a table (ours).

From where robots pass, a post of 4 cm shows one or two beams. They make no piece, so all that a corner scan tells of
them is a narrow blind sector, and how near it is. Many such sightings from all around give place and width: on average
as many beams meet a post as it is wide, and its near side lies half its width before its middle. From 0.8 m on it shows
a piece, whose line noise turns by 20 degrees: that is taken as a sighting, too.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from agent.corner_scan import OCCLUSION, Sight, to_map_frame
from agent.geometry.clearance import distances_to_walls
from agent.geometry.lines import Record, above, along
from agent.geometry.poles import POLE_M, SAME_POLE_M, with_poles
from agent.kernels import kernel
from agent.mapping.edges import FREE, WALL, length, remove, tip_at
from agent.mapping.views import THROUGH, View, look_at, margin_of
from protocol.arrays import Floats, Ints, Records
from protocol.geometry import Pose
from protocol.wireframe import Wireframe

MOST = 256  # poles, and what may become one, that are kept
SURE_SIGHTINGS = 15.0
"""Sightings from which a pole is in the map, three seconds of the default lidar, in which beams passed on both sides of
it: what peeps out behind an edge has the edge on one side."""
SUREST = 30.0  # scans that must see through a pole that is gone, at most
NARROW_M = 0.08  # a sighting may be so wide, less the distance of two beams: a pole of POLE_M, seen askew
WIDE_M = 0.2  # what is wider than that and narrower than this tells that there is no pole
PLACE_SD_M = 0.03  # of a pole's place: scans that see through it must see farther by more
SIDES = 4.0 / math.pi  # width of a square as it looks over that of its sides, on average over all directions
LEAST_M = 0.02  # width of a pole
MEMORY = 100.0  # last sightings that tell where a pole is: where odometry errs, walls move, and poles with them

POLE = np.dtype(
    [
        ("score", "f8"),  # sightings less scans that saw through it, up to SUREST; up to 0: the record is free
        ("known", "f8"),  # 1: it is in the map
        ("x", "f8"),  # m, its middle
        ("y", "f8"),
        ("width", "f8"),  # m, of each of its sides
        ("tick", "f8"),  # of the last sighting
        ("free", "f8"),  # sightings with free ground on both sides
        ("seen", "f8"),  # sightings that the following sums are of
        ("wide", "f8", (2,)),  # of how wide it looked, m, and of the weights
        ("precision", "f8", (3,)),  # of normal equations of its middle: xx, xy, yy, 1/m2
        ("right", "f8", (2,)),  # their right-hand sides, if its middle were where beams hit it, 1/m
        ("ahead", "f8", (2,)),  # to be added to these for each metre that it lies behind, 1/m2
    ]
)
"""A pole, or what may become one: numbers of one type, so that a checkpoint can hold them as an array."""


@kernel
def see_poles(
    poles: Records,
    edges: Records,
    count: int,
    pose: Pose,
    pieces: Records,
    sight: Sight,
    noise: float,
    noise_share: float,
    tick: int,
) -> None:
    """Take a tick's scan from a pose into the poles (MOST,) of a map, whose walls are the first `count` of edges (n,).

    pieces (k,), sight: the scan's, robot's frame. noise: m, standard deviation of a range; noise_share: of far ranges.
    Those in use come first.
    """
    view = View(pose, to_map_frame(pieces, pose), sight, margin_of(noise), noise, 0.0)
    used = 0
    while used < len(poles) and poles[used].score > 0.0:
        used += 1
    for s in range(len(sight.blind)):
        first, last, away = sight.blind[s]
        if away > 0.0:
            used = _take(poles, used, edges, count, view, noise_share, tick, first, last, away)
    for k in range(len(pieces)):
        p = view.pieces[k]
        if p.label[0] == OCCLUSION and p.label[1] == OCCLUSION:
            away = math.hypot(p.x - pose[0], p.y - pose[1])
            used = _take(poles, used, edges, count, view, noise_share, tick, p.bearing[0], p.bearing[1], away)
    for k in range(used):
        pole = poles[k]
        away = math.hypot(pole.x - pose[0], pole.y - pose[1])
        if away > sight.reach:
            pole.score *= pole.known  # what may become one must do so while the robot passes once
        elif 2.0 * sight.half_beam * away < pole.width and look_at(pole.x, pole.y, view, PLACE_SD_M)[0] == THROUGH:
            pole.score -= 1.0
    _close_up(poles, used)


@kernel
def _close_up(poles: Records, used: int) -> None:
    """Bring those of the first `used` records that still are poles to the front, in their order."""
    kept = 0
    for k in range(used):
        if poles[k].score > 0.0:
            poles[kept] = poles[k]
            kept += 1
    for k in range(kept, used):
        poles[k].score, poles[k].known = 0.0, 0.0


@kernel
def _take(
    poles: Records,
    used: int,
    edges: Records,
    count: int,
    view: View,
    noise_share: float,
    tick: int,
    first: float,
    last: float,
    away: float,
) -> int:
    """Take beams between two bearings, rad, robot's frame, that met something `away` m off, as a sighting of a pole.

    Returns how many of the poles are in use.
    """
    spacing = 2.0 * view.sight.half_beam * away
    wide = (last - first) * away + spacing
    if spacing > NARROW_M or wide > WIDE_M + spacing:
        return used
    angle = view.pose[2] + 0.5 * (first + last)
    ux, uy = math.cos(angle), math.sin(angle)
    x, y = view.pose[0] + away * ux, view.pose[1] + away * uy
    k = _nearest(poles, used, x, y)
    on_wall, narrow = _on_wall(edges, count, x, y), wide <= NARROW_M + spacing
    if k < 0:
        if on_wall or not narrow or used == len(poles):
            return used
        k, used = used, used + 1
        poles[k] = np.zeros(1, POLE)[0]
    pole = poles[k]
    if on_wall:
        pole.score = 0.0
    elif not narrow:
        pole.score -= 1.0
    else:
        _see(pole, x, y, (ux, uy), wide, spacing, max(view.noise, noise_share * away))
        pole.tick = tick
        if _stands_free(x, y, 0.5 * wide + 1.5 * spacing + view.sight.shift, view):
            pole.free += 1.0
        if pole.free >= SURE_SIGHTINGS and pole.width <= POLE_M:
            pole.known = 1.0
        if pole.known == 1.0:
            _clear(poles, used, edges, count, k)
    return used


@kernel
def _stands_free(x: float, y: float, beside: float, view: View) -> bool:
    """Whether the scan saw farther on both sides of (x, y), so many metres beside it: two beams from what was hit."""
    dx, dy = x - view.pose[0], y - view.pose[1]
    side = beside / math.hypot(dx, dy)
    left, right = look_at(x - side * dy, y + side * dx, view, 0.0), look_at(x + side * dy, y - side * dx, view, 0.0)
    return bool(left[0] == THROUGH and right[0] == THROUGH)


@kernel
def _see(pole: Record, x: float, y: float, way: tuple[float, float], wide: float, spacing: float, noise: float) -> None:
    """Count a sighting: something at (x, y), in the unit direction `way`, that looks so wide, m.

    spacing: m, between two beams there; noise: m, standard deviation of the range.
    """
    pole.score = min(pole.score + 1.0, SUREST)
    if pole.seen >= MEMORY:
        _fade(pole)
    ux, uy = way
    near, beside = 1.0 / noise**2, 12.0 / wide**2  # a place somewhere on what was hit
    along_way, across = near * (ux * x + uy * y), beside * (ux * y - uy * x)
    pole.seen += 1.0
    pole.wide[0] += wide / spacing**2
    pole.wide[1] += 1.0 / spacing**2
    pole.precision[0] += near * ux * ux + beside * uy * uy
    pole.precision[1] += (near - beside) * ux * uy
    pole.precision[2] += near * uy * uy + beside * ux * ux
    pole.right[0] += along_way * ux - across * uy
    pole.right[1] += along_way * uy + across * ux
    pole.ahead[0] += near * ux
    pole.ahead[1] += near * uy
    pole.width = max(pole.wide[0] / (SIDES * pole.wide[1]), LEAST_M)
    bx, by = pole.right[0] + 0.5 * pole.width * pole.ahead[0], pole.right[1] + 0.5 * pole.width * pole.ahead[1]
    xx, xy, yy = pole.precision
    det = xx * yy - xy * xy
    pole.x, pole.y = (yy * bx - xy * by) / det, (xx * by - xy * bx) / det


@kernel
def _fade(pole: Record) -> None:
    """Let a pole's sums be of its last sightings."""
    share = 1.0 - 1.0 / MEMORY
    pole.seen *= share
    for k in range(2):
        pole.wide[k] *= share
        pole.right[k] *= share
        pole.ahead[k] *= share
    for k in range(3):
        pole.precision[k] *= share


@kernel
def _nearest(poles: Records, used: int, x: float, y: float) -> int:
    """The pole that was hit at (x, y), or -1."""
    best, nearest = -1, SAME_POLE_M
    for k in range(used):
        away = math.hypot(poles[k].x - x, poles[k].y - y)
        if away < nearest and poles[k].score > 0.0:
            best, nearest = k, away
    return best


@kernel
def _on_wall(edges: Records, count: int, x: float, y: float) -> bool:
    """Whether a wall explains what was hit at (x, y). One as short as a pole's may be of hits on the pole."""
    for e in range(count):
        w = edges[e]
        if w.kind == WALL and abs(above(w, x, y)) < SAME_POLE_M and length(w) > POLE_M:
            t = along(w, x, y)
            if tip_at(w, 0) - SAME_POLE_M < t < tip_at(w, 1) + SAME_POLE_M:
                return True
    return False


@kernel
def _clear(poles: Records, used: int, edges: Records, count: int, k: int) -> None:
    """Forget what else was made of hits on pole k: walls of few beams, and other poles."""
    x, y = poles[k].x, poles[k].y
    for e in range(count):
        w = edges[e]
        if w.kind != FREE and math.hypot(w.x - x, w.y - y) < SAME_POLE_M and length(w) < NARROW_M:
            remove(edges, e)
    for j in range(used):
        if j != k and math.hypot(poles[j].x - x, poles[j].y - y) < SAME_POLE_M:
            poles[j].score = 0.0


Places = Callable[[Ints, Floats], Floats]
"""Of places (k, 2) at which something was seen at ticks (k,): where they are in a map that was merged anew; metres."""


def settle_poles(poles: Records, places: Places) -> None:
    """Let poles (MOST,) of a torn map be in one that was merged anew, where what is seen next tells their places."""
    known = poles[poles["known"] == 1.0]
    poles[:] = np.zeros(1, POLE)
    kept = poles[: len(known)]
    for name in ("score", "known", "width", "wide", "tick"):
        kept[name] = known[name]
    kept["x"], kept["y"] = places(known["tick"].astype(np.int64), np.column_stack((known["x"], known["y"]))).T


def draw_poles(wireframe: Wireframe, poles: Records, heard: Sequence[Floats], axis: float) -> Wireframe:
    """A map with its poles (MOST,), and with those of peers, (p, 3) x, y and width in metres each, that are no others.

    axis: of the walls, radians, to which their sides are parallel.
    """
    own = poles[poles["known"] == 1.0]
    rows = np.vstack([np.column_stack((own["x"], own["y"], own["width"])), *heard])
    near = np.hypot(*(rows[:, None, :2] - rows[:, :2]).transpose(2, 0, 1)) < SAME_POLE_M
    drawn = ~np.tril(near, -1).any(1) & (distances_to_walls(rows[:, :2], wireframe.segments()) > SAME_POLE_M)
    likelihood, is_own = np.ones(len(rows)), np.arange(len(rows)) < len(own)
    likelihood[is_own] = own["score"] / SUREST
    return with_poles(wireframe, rows[drawn], likelihood[drawn], is_own[drawn], axis)
