"""Whether a robot is back where it was: a finished submap against an earlier one (ours).

Accepted are only poses that enough wall supports, that explain what the earlier submap's views should show, that lay
little of one submap where the other's views saw through it, and that have no rival: a wrong loop bends the whole map,
a missed one only this part of it.
"""

import math
from typing import NamedTuple

import numpy as np

from agent.geometry.lines import above, along, placed
from agent.kernels import kernel
from agent.mapping.submaps.matching import (
    COARSE_GATE_M,
    SUBMAP_GATES_M,
    Match,
    costs_around,
    nearest_wall,
    poses_around,
    refine,
    tiles_of,
)
from agent.mapping.submaps.segments import SEGMENT_SAMPLE_M, every
from agent.mapping.submaps.tiles import SegmentTiles
from protocol.arrays import Bools, Floats, Records
from protocol.geometry import inverted, pose_of, wrapped

MATCHED_M = 3.6  # metres of wall that must lie on the earlier submap's, at least
EXPLAINED = 0.6  # share of what the earlier views should show of the later submap that must lie on a wall
SEEN_THROUGH = 0.3
"""Samples that stand where the other submap's views saw a wall beyond them, at most, over those that lie on walls. True
loops have 0.03 in the median and 0.3 at most, in clutter; false ones in halls of pillars 0.3 to 2. A corridor laid onto
the inside of a hall's corner has its outer wall on the hall's, and its inner wall, seen from behind, where the hall is
free."""
ON_WALL_M = 0.2  # a sample this near to a wall counts as on it
CONFIRMED = 2.0  # scans that must have shown a wall for a loop to count on it: what one scan shows may be a leg
THROUGH_M = 0.4  # a wall that far behind a sample was seen past it: farther than walls are thick
ASKED = 4  # of so many samples one is asked whether it was seen through: walls are longer than 0.8 m
FLAT_SINE = 0.2  # sine of 12 degrees: a flatter view of a wall need not show it
RIVAL_M = 0.5  # a pose farther off than this, or turned by RIVAL_RAD, is another answer
RIVAL_RAD = math.radians(10.0)
RIVAL_SCORE = 0.85  # score of another answer, over the best one's, from which a place is ambiguous
STEP = np.array((0.4, 0.4, math.radians(4.0)))
"""m, m and rad between the poses that are tried first: narrower than the gate of the first refinement."""
SIEVES = ((12, 400), (60, 6))
"""Samples by which those poses are judged, and how many of the best are kept: more samples for fewer poses, until the
last few are refined."""
AGAIN_GATES_M = np.array([0.3, 0.15])
AGAIN_PRIOR = np.diag((1 / 0.3**2, 1 / 0.3**2, 1 / 0.05**2))  # 0.3 m and 0.05 rad: walls decide, where they hold at all
ROUNDS = 8  # Gauss-Newton steps for each gate


class Submap(NamedTuple):
    """What was seen on some metres of way, in the frame of the first pose there."""

    walls: Records  # (n,) of SEGMENT
    samples: Floats  # (k, 5) along those walls that scans have confirmed
    views: Floats  # (v, 3) places from which it was seen, and where the middle of the view was
    reach: float  # m, how far its views see walls
    half_view: float  # rad to either side of the middle of a view


class Found(NamedTuple):
    """Judgement on a loop."""

    pose: Floats  # (3,) of the later submap in the earlier one's frame
    information: Floats  # (3, 3)
    rival: float  # score of the best other answer over the best one's
    accepted: bool


@kernel
def on_walls(tiles: SegmentTiles, samples: Floats, pose: Floats) -> Bools:
    """(k,) which samples (k, 5) at a pose lie on walls."""
    out = np.zeros(len(samples), np.bool_)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in range(len(samples)):
        x, y, ux, uy = placed(samples[k, 0], samples[k, 1], samples[k, 2], samples[k, 3], pose, c, s)
        out[k] = nearest_wall(tiles, x, y, ux, uy, ON_WALL_M)[0] >= 0
    return out


@kernel
def due(place: Submap, tiles: SegmentTiles, samples: Floats, pose: Floats) -> tuple[Bools, Bools]:
    """(k,) which samples (k, 5) at a pose some view of a place should show, and (k,) which of them are on walls.

    tiles: of the place's walls.
    """
    met = on_walls(tiles, samples, pose)
    out = met.copy()
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in np.flatnonzero(~met):
        x, y, ux, uy = placed(samples[k, 0], samples[k, 1], samples[k, 2], samples[k, 3], pose, c, s)
        for v in range(len(place.views)):
            view = place.views[v]
            dx, dy = x - view[0], y - view[1]
            distance = math.hypot(dx, dy)
            flat = dy * ux - dx * uy  # > 0 where the view is behind the wall
            if distance > place.reach or -flat < FLAT_SINE * distance:
                continue
            if abs(wrapped(math.atan2(dy, dx) - view[2])) < place.half_view and not _hidden(place.walls, view, x, y):
                out[k] = True
                break
    return out, met


@kernel
def _hidden(walls: Records, view: Floats, x: float, y: float) -> bool:
    """Whether a wall stands between a view and a point, clear of both."""
    dx, dy = x - view[0], y - view[1]
    for k in range(len(walls)):
        w = walls[k]
        a, b = above(w, view[0], view[1]), above(w, x, y)
        if a * b >= 0 or min(abs(a), abs(b)) < ON_WALL_M:
            continue
        share = a / (a - b)
        t = along(w, view[0] + share * dx, view[1] + share * dy)
        if w.low < t < w.high:
            return True
    return False


@kernel
def _seen_through(place: Submap, samples: Floats, pose: Floats) -> int:
    """How many samples (k, 5) at a pose, whichever way they face, stand where a view of a place saw a wall beyond.

    One in `ASKED` is asked, and counts as many: rays through all walls cost more than all else that judges a loop.
    """
    count = 0
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in range(0, len(samples), ASKED):
        x, y, ux, uy = placed(samples[k, 0], samples[k, 1], samples[k, 2], samples[k, 3], pose, c, s)
        for v in range(len(place.views)):
            view = place.views[v]
            dx, dy = x - view[0], y - view[1]
            if abs(dy * ux - dx * uy) < FLAT_SINE * math.hypot(dx, dy):
                continue
            if abs(wrapped(math.atan2(dy, dx) - view[2])) < place.half_view and _seen_beyond(place.walls, view, x, y):
                count += ASKED
                break
    return count


@kernel
def _seen_beyond(walls: Records, view: Floats, x: float, y: float) -> bool:
    """Whether the nearest wall from a view in the direction of a point faces the view and is clear behind the point."""
    dx, dy, nearest, faces = x - view[0], y - view[1], math.inf, False
    for k in range(len(walls)):
        w = walls[k]
        a, b = above(w, view[0], view[1]), above(w, x, y)
        share = a / (a - b) if a != b else math.inf  # of the way to the point
        if 0.0 < share < nearest and w.low < along(w, view[0] + share * dx, view[1] + share * dy) < w.high:
            nearest, faces = share, a > 0.0 and w.seen >= CONFIRMED
            if nearest < 1.0:
                return False
    return faces and (nearest - 1.0) * math.hypot(dx, dy) > THROUGH_M


def find(later: Submap, earlier: Submap, start: Floats, window: Floats, prior: Floats) -> Found | None:
    """Where the later submap lies in the earlier one's frame; None where nothing fits.

    start (3,): by the graph; window (3,): how far off it may be, but STEP at least; prior (3, 3): its information.
    """
    samples = later.samples
    if not len(samples) or not len(earlier.walls):
        return None
    poses, tiles = start[None], tiles_of(earlier.walls)
    if (window >= STEP).any():
        tried = poses_around(start, np.where(window >= STEP, window, 0.0), STEP)
        for count, kept in SIEVES:
            sparse = every(samples, len(samples) // count)
            costs = costs_around(sparse, tiles, tried, COARSE_GATE_M)
            tried = tried[np.argsort(costs, kind="stable")[:kept]]
        poses = np.vstack((start, tried))
    answers: list[tuple[float, Match, float, float, bool]] = []
    """Score, match, metres matched, share explained, and whether little of it was seen through."""
    for pose in poses:
        match = refine(samples, tiles, pose, prior, SUBMAP_GATES_M, ROUNDS)
        off = match.pose - start
        off[2] = wrapped(off[2])
        if (np.abs(off) > np.maximum(window, STEP)).any():
            continue
        expected, met = (int(which.sum()) for which in due(earlier, tiles, samples, match.pose))
        through = 0
        if met * SEGMENT_SAMPLE_M >= MATCHED_M and met >= EXPLAINED * expected:
            back = np.array(inverted(pose_of(match.pose)))
            through = _seen_through(earlier, samples, match.pose) + _seen_through(later, earlier.samples, back)
        explained = met / max(expected + through, 1)
        answers.append((met * explained, match, met * SEGMENT_SAMPLE_M, explained, through <= SEEN_THROUGH * met))
    if not answers:
        return None
    score, best, matched, explained, solid = max(answers, key=lambda answer: answer[0])
    rivals = [s for s, m, *_ in answers if _apart(m.pose, best.pose)]
    rival = max(rivals, default=0.0) / max(score, 1e-9)
    accepted = solid and matched >= MATCHED_M and explained >= EXPLAINED and rival < RIVAL_SCORE
    return Found(best.pose, best.information - prior, rival, accepted)


def look_again(later: Submap, earlier: Submap, start: Floats) -> Match:
    """The pose of an accepted loop measured again, narrowly, about a start (3,) that the graph has settled."""
    match = refine(later.samples, tiles_of(earlier.walls), start, AGAIN_PRIOR, AGAIN_GATES_M, ROUNDS)
    return match._replace(information=match.information - AGAIN_PRIOR)


def _apart(a: Floats, b: Floats) -> bool:
    return math.hypot(a[0] - b[0], a[1] - b[1]) > RIVAL_M or abs(wrapped(float(a[2] - b[2]))) > RIVAL_RAD
