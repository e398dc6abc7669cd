"""What one scan saw of a place or of a wall: nothing, free space through it, or a wall on it."""

import math
from typing import NamedTuple

import numpy as np

from agent.corner_scan import NOISE_SIGMAS, CornerScan, Sight, piece_sd, to_map_frame
from agent.geometry.lines import Record, above, along
from agent.kernels import kernel
from agent.mapping.edges import length, line_sd, related, tip_at
from protocol.arrays import Bools, Floats, Records
from protocol.geometry import Pose

UNSEEN, THROUGH, ON = 0, 1, 2  # what a scan saw at a point: it does not tell, free space, or a wall
GRAZING = math.sin(math.radians(8.0))  # flattest view that is expected to show a wall: a flatter ray may pass beside
STEP_M = 0.08  # distance of the samples at which a wall is compared with a scan: half the thickness of a usual wall
MARGIN_M = 0.035  # a wall this near to what was seen is what was seen, at least: 3.5 sd of the default lidar's ranges
NEAREST_M = 1e-6  # a point nearer to the lidar has no bearing
END_SKIP_M = 0.05  # the ends of a wall are not compared with a scan: their place is known to about a beam
EDGEWISE = math.sin(math.radians(30.0))
FEWEST = 3.0
"""Beams that a wall would stop, for a view that is flatter than EDGEWISE to see through it. One that meets a thin plate
is nearer than the wall behind by no more than noise, and the wall is one piece. From the front each beam counts: a post
of 0.1 m that is gone would stop two at 3 m."""
PROBES, PROBES_THROUGH = 7, 3
"""Bearings across a place at which a scan is asked, and those that must show something beyond it."""
PROBED = 0.7
"""Share of its width that they span: where it is, is known to some centimetres."""


class View(NamedTuple):
    """One scan in the frame of the map, for kernels."""

    pose: Pose  # of the robot: m, m, rad
    pieces: Records  # (k,) of PIECE, lines in the map's frame
    sight: Sight
    margin: float  # m, distance from a piece within which a place counts as on it, at least
    noise: float  # m, of a near hit, by its range or by how well walls are known: few or far hits have a wider margin
    tilt: float  # rad, by which the scan was found to be turned in itself: edges are as uncertain


class Samples(NamedTuple):
    """Points along a wall at which a scan is asked."""

    number: int
    first: float  # m, coordinate of the first along the wall
    spacing: float  # m, from each to the next


@kernel
def margin_of(noise: float) -> float:
    """Metres from a piece within which a place counts as on it, at least; noise: m, of a near range."""
    return max(MARGIN_M, NOISE_SIGMAS * noise)


def view_of(scan: CornerScan, pose: Pose, margin_m: float) -> View:
    """A scan from a pose, held against walls that are known to this precision in metres."""
    return View(pose, to_map_frame(scan.pieces, pose), scan.sight, margin_m, margin_m / NOISE_SIGMAS, 0.0)


@kernel
def piece_at(view: View, bearing: float, margin: float) -> int:
    """Index of the piece that a ray meets inside its ends by the margin, or -1. bearing: robot's frame, [0, 2 pi)."""
    for k in range(len(view.pieces)):
        if _inside(view.pieces[k], bearing, margin):
            return k
    return -1


@kernel
def _inside(piece: Record, bearing: float, margin: float) -> bool:
    """Whether a ray meets a piece inside its ends by the margin, radians."""
    low, high = piece.bearing[0] + margin, piece.bearing[1] - margin
    return bool(low <= bearing <= high or low <= bearing + 2 * math.pi <= high)


@kernel
def within(sectors: Floats, bearing: float, margin: float) -> bool:
    """Whether a bearing in [0, 2 pi) is inside one of the sectors (s, 3) by the margin, radians."""
    for s in range(len(sectors)):
        for turn in (-2 * math.pi, 0.0, 2 * math.pi):
            if sectors[s, 0] + margin <= bearing + turn <= sectors[s, 1] - margin:
                return True
    return False


@kernel
def seen_at(x: float, y: float, view: View) -> tuple[float, float, float]:
    """Distance, m, and bearing, in [0, 2 pi), at which the scan sees a point; how far the bearing may be off, rad.

    A place is passed at another bearing than seen from the stamp.
    """
    dx, dy = x - view.pose[0], y - view.pose[1]
    distance = math.hypot(dx, dy)
    bearing = (math.atan2(dy, dx) - view.pose[2]) % (2 * math.pi)
    return distance, bearing, view.sight.half_beam + view.tilt + view.sight.shift / max(distance, NEAREST_M)


@kernel
def look_at(x: float, y: float, view: View, place_sd: float, beside: float = 0.0) -> tuple[int, int]:
    """What the scan saw at a point of the map: UNSEEN, THROUGH or ON; and the piece that the ray met, or -1.

    place_sd: m, standard deviation of the point's place as the robot knows it from where it is. beside: rad, by which
    it may be seen at another bearing.
    """
    sight = view.sight
    distance, bearing, parallax = seen_at(x, y, view)
    parallax += beside
    if distance > sight.reach or distance < NEAREST_M:
        return UNSEEN, -1
    if within(sight.blind, bearing, -parallax):
        return UNSEEN, -1
    k = piece_at(view, bearing, sight.half_beam)
    if k >= 0:
        p = view.pieces[k]
        off, t = above(p, x, y), min(max(along(p, x, y), p.end[0]), p.end[1])  # the ray meets it between its ends
        sd = math.hypot(place_sd, piece_sd(p, t, view.noise))
        margin = max(view.margin, NOISE_SIGMAS * sd)
        if off > margin:
            return (THROUGH, k) if _inside(p, bearing, parallax) else (UNSEEN, -1)
        return (UNSEEN, k) if off < -margin else (ON, k)
    if within(sight.open, bearing, parallax) and distance < sight.reach - view.margin:
        return THROUGH, -1
    return UNSEEN, -1


@kernel
def in_reach(wall: Record, view: View) -> bool:
    """Whether any point of a wall is near enough to be seen."""
    x, y = view.pose[0], view.pose[1]
    t = min(max(along(wall, x, y), tip_at(wall, 0)), tip_at(wall, 1))
    return math.hypot(wall.x + t * wall.ux - x, wall.y + t * wall.uy - y) <= view.sight.reach


@kernel
def samples_along(wall: Record, step: float) -> Samples:
    """Evenly spaced samples of a wall, at most `step` metres apart, without its ends."""
    size = length(wall)
    skip = min(END_SKIP_M, 0.25 * size)
    number = max(3, math.ceil((size - 2 * skip) / step))
    return Samples(number, tip_at(wall, 0) + skip, (size - 2 * skip) / (number - 1))


@kernel
def look_at_wall(wall: Record, t: float, view: View) -> tuple[int, int, bool]:
    """What the scan saw at coordinate t of a wall, the piece met, and whether the robot is on the free side.

    UNSEEN also where the ray is so flat that it may have passed beside the wall, and in flat views of which too few
    beams would have met it. A wall that may end before t, as the robot knows it from where it is, is seen through only
    where all is open that it may be in.
    """
    x, y = wall.x + t * wall.ux, wall.y + t * wall.uy
    side, distance = above(wall, view.pose[0], view.pose[1]), math.hypot(x - view.pose[0], y - view.pose[1])
    turns = abs(side) / max(distance, NEAREST_M) ** 2  # rad, of the ray for a metre along the wall
    known, beside = related(wall), 0.0
    if known:
        beside = _aside(wall, t) * turns
    saw, piece = look_at(x, y, view, line_sd(wall, t, view.noise) if known else 0.0, beside)
    flat = GRAZING * distance
    edgewise = abs(side) < EDGEWISE * distance
    if abs(side) < flat or (edgewise and saw == THROUGH and length(wall) * turns < 2 * FEWEST * view.sight.half_beam):
        saw = UNSEEN
    return saw, piece, side > flat


@kernel
def _aside(wall: Record, t: float) -> float:
    """How far along itself a wall may be off, m; 0 where it reaches coordinate t all the same.

    Of an end that the robot does not know it knows no more than of the other one.
    """
    tail, head = wall.tip_sd[0], wall.tip_sd[1]
    tail, head = NOISE_SIGMAS * (tail if tail > 0.0 else head), NOISE_SIGMAS * (head if head > 0.0 else tail)
    aside = tail if t - tip_at(wall, 0) < tail else 0.0
    return max(aside, head) if tip_at(wall, 1) - t < head else aside


@kernel
def sees_place(x: float, y: float, radius: float, view: View) -> bool:
    """Whether a scan sees through a disc at (x, y): what stood there would hide what the scan shows beyond it.

    Bearings at the edge of a piece or sector tell nothing, so some that tell suffice, if none of them speaks against.
    """
    dx, dy = x - view.pose[0], y - view.pose[1]
    away = max(math.hypot(dx, dy), 1e-6)
    through = 0
    for k in range(PROBES):
        off = PROBED * radius * (2.0 * k / (PROBES - 1) - 1.0)
        px, py = x - dy / away * off, y + dx / away * off
        saw, piece = look_at(px, py, view, 0.0)
        near = _nearest_blind(px, py, view)
        if piece >= 0 and saw != THROUGH:  # the line of a short piece is not known well enough to tell
            p = view.pieces[piece]
            near = min(near, math.hypot(p.x - view.pose[0], p.y - view.pose[1]) - max(-p.end[0], p.end[1]))
        if near < away + radius + view.margin:
            return False
        through += saw == THROUGH or near < math.inf
    return through >= PROBES_THROUGH


@kernel
def _nearest_blind(x: float, y: float, view: View) -> float:
    """How near, m, anything is that is no wall, in the direction of (x, y); inf where there is nothing."""
    _, bearing, parallax = seen_at(x, y, view)
    near, blind = math.inf, view.sight.blind
    for s in range(len(blind)):
        if within(blind[s : s + 1], bearing, -parallax):
            near = min(near, blind[s, 2])
    return near


@kernel
def sees_places(places: Floats, radius: float, view: View) -> Bools:
    """Whether (n,) a scan sees through discs at places (n, 2), as `sees_place`."""
    sees = np.zeros(len(places), np.bool_)
    for k in range(len(places)):
        sees[k] = sees_place(places[k, 0], places[k, 1], radius, view)
    return sees
