"""Where the robot is, from the shift between a scan and the map (paper III, technique of its ref. 1; ours in detail).

Kalman updates of the joint estimate (`joint.py`) by walls and their corners. Where walls are rectilinear, they share an
axis, which holds the heading; where they are not, only the walls themselves do.
"""

import math
from typing import NamedTuple

import numpy as np

from agent.corner_scan import NOISE_FLOOR_M, NOMINAL
from agent.geometry.lines import Record, above, along
from agent.kernels import kernel
from agent.mapping.association import (
    OF_TWO_WALLS,
    Gates,
    cost,
    is_unsure,
    overlap,
    stands_before,
    turns_where_other_goes_on,
)
from agent.mapping.edges import WALL, common_axis, length, off_axis, related, spread, tip_at
from agent.mapping.ends import END_MARGIN_M
from agent.mapping.joint import (
    AXIS,
    BEGIN,
    END_SIGMAS,
    MIN_VIEWS,
    SLACK_SD,
    corner_slopes,
    end_at,
    end_sd,
    has_rows,
    is_landmark,
    lengthwise,
    place_end,
    row_of,
    tells_end,
)
from agent.mapping.kalman import Innovation, KalmanUpdate, observe, settle, take, update_of
from agent.mapping.scan_merge import same_line
from agent.mapping.strain import strain, strain_direction
from agent.mapping.tentative import tentative_of
from protocol.arrays import Floats, Ints, Records
from protocol.geometry import Pose, wrapped

AXIS_FLOOR = math.radians(0.1)  # least sd of walls about their axis, beside what is seen of it
ON_AXIS = 0.75
"""Share of the walls' length that must lie on one axis for it to hold the heading. Of walls at random 0.25 do. One post
turned by 45 degrees is 1.3 m: asked for 0.97, three of five robots in the middle of `hall` had no axis for 150 s."""
AXIS_SIGMAS = 3.0  # a direction farther from the axis, in deviations of both, is of another one
AXIS_ROUNDS = 3
"""Times that the axis is told anew without walls that are of another direction. A face of a post of 0.1 m, turned by 11
degrees, made walls that lie within 0.1 degrees of their axis scatter by 0.5."""
AXIS_PIECE_SD = math.radians(1.0)
"""Least precise direction of a piece that may lie on the axis: that of a face of 0.3 m is known to 2 degrees, and posts
turned by 10 degrees would turn the robot by 0.4 degrees a second."""
MAX_OFF_AXIS = 0.2  # rad, a piece that is more oblique belongs to no wall on the axis
WALL_FLOOR = math.radians(0.2)  # least sd of a wall's direction, beside its covariance: walls are not straight

UNSURE_WORTH = 0.1
"""Weight of the place of a piece that may be of two faces. It lies 2 to 20 mm behind the wall and is turned by up to 30
degrees, in a hundred scans from one spot alike, so ten of these count as one. (Where it shares a corner with the next
piece it is of one face: 2,200 such pieces of columns lay 0.5 mm off in the mean, and were turned by 0.5 to 0.7 of their
deviation, rms. So were 2,400 in the middle of walls, 2 mm off.) Its direction counts for nothing: at this worth it
turned robots, and told no more of their heading (36 starts in `hall`: maps turned by 0.30 degrees, now by 0.24, and
their walls 6.7 mm off in themselves, now 4.9; rms)."""


class Axis(NamedTuple):
    """Common axis of rectilinear walls."""

    angle: float  # rad, modulo a right angle
    sd: float  # rad, how well walls keep it; inf where they are not rectilinear


@kernel
def axis_of(edges: Records, count: int, noise: float) -> Axis:
    """The axis of a particle's walls, as those along it have it. noise: m, standard deviation of a range.

    A wall weighs by how well its direction is known, so those that a robot saw from where it began hold its frame.
    Walls that scatter about the axis by more than they are known to are of another direction, and no part of it.
    """
    angle, trust = common_axis(edges, count)
    if trust == 0.0:
        return Axis(angle, math.inf)
    on_axis, everything = 0.0, 0.0
    for k in range(count):
        if edges[k].kind == WALL:
            everything += length(edges[k])
            on_axis += length(edges[k]) if abs(off_axis(edges[k], angle)) < MAX_OFF_AXIS else 0.0
    if on_axis < ON_AXIS * everything:
        return Axis(angle, math.inf)
    found = Axis(angle, MAX_OFF_AXIS)
    for _ in range(AXIS_ROUNDS):
        found = _axis_about(edges, count, found, noise)
    return found


@kernel
def _axis_about(edges: Records, count: int, axis: Axis, noise: float) -> Axis:
    """The axis of those walls that lie on this one."""
    total, mean, square = 0.0, 0.0, 0.0
    for k in range(count):
        if edges[k].kind != WALL:
            continue
        off, own = off_axis(edges[k], axis.angle), noise**2 / spread(edges[k])
        if off * off < min(AXIS_SIGMAS**2 * (own + axis.sd**2), MAX_OFF_AXIS**2):
            weight = 1.0 / (own + AXIS_FLOOR**2)
            total += weight
            mean += weight * off
            square += weight * off * off
    if total == 0.0:
        return axis
    mean /= total
    return Axis(axis.angle + mean, math.hypot(AXIS_FLOOR, math.sqrt(max(square / total - mean * mean, 0.0))))


@kernel
def _is_nearer(p: Record, wall: Record, angle: float) -> bool:
    """Whether a piece is less turned against the axis than its wall: else it is the piece that errs.

    In `uday_building` walls of 4 to 9 m on the axis let go for pieces that were turned by 2 degrees steadily. They lay
    55 mm off in the end (precision 0.968 and 0.969 in two runs of five; now 1 and 0.987).
    """
    return abs(off_axis(p, angle)) < abs(off_axis(wall, angle))


@kernel
def pose_at(pose: Pose, shift: Floats, moment: float) -> Pose:
    """Where the robot was at a moment of the revolution (0 to 1, its stamp), in terms of the stamp's frame.

    The scan is unrolled by odometry about the predicted pose. What scans correct of that, shift (m,), is between what
    they correct of the revolution's begin and of its end.
    """
    return (
        pose[0] + moment * shift[0] + (1.0 - moment) * shift[BEGIN],
        pose[1] + moment * shift[1] + (1.0 - moment) * shift[BEGIN + 1],
        pose[2] + moment * shift[2] + (1.0 - moment) * shift[BEGIN + 2],
    )


@kernel
def correct_pose(
    edges: Records,
    count: int,
    pieces: Records,
    walls: Ints,
    pose: Pose,
    joint: Floats,
    shift: Floats,
    axis: Axis,
    gates: Gates,
) -> None:
    """Take in pieces (map frame, as of the predicted pose), each associated with a wall or -1: joint (m, m) and shift
    (m,) are updated in place.

    axis: the estimate's, with the deviation of walls from it, infinite where there is none.
    """
    update, rows = update_of(joint, shift), np.array((2, BEGIN + 2, AXIS))
    for k in range(len(pieces)):
        p = pieces[k]
        if walls[k] >= 0:
            for e in range(count):
                if e == walls[k] or _lies_on_too(edges, count, e, p, walls[k], gates):
                    _observe_wall(edges, e, p, pose, update, gates.noise, axis)
            continue
        if walls[k] == OF_TWO_WALLS:
            continue
        tentative = tentative_of(edges, count, p, gates)
        if tentative >= 0 and related(edges[tentative]):
            _observe_wall(edges, tentative, p, pose, update, gates.noise, axis)
        elif math.isfinite(axis.sd):
            off = wrapped(axis.angle - math.atan2(p.uy, p.ux), 0.5 * math.pi)
            sd = gates.noise / math.sqrt(p.spread)
            if sd < AXIS_PIECE_SD:
                slopes = np.array((p.moment, 1.0 - p.moment, -1.0))
                take(update, rows, slopes, off, sd * sd + axis.sd**2, AXIS_SIGMAS)
    settle(update)


@kernel
def hold_axis(edges: Records, new: Ints, joint: Floats, shift: Floats, angle: float, axis: Axis) -> float:
    """Let new walls (n,) that lie on the axis of rectilinear ones share it; returns its angle, before the shift (m,).

    angle: of the estimate. axis: as walls have it now. Where the estimate is none yet, or of another axis, all walls on
    that axis give it, and not the new ones alone: those seen from where the robot began came before there was an axis,
    and are known best.
    """
    if not math.isfinite(axis.sd):
        return angle
    begins = joint[AXIS, AXIS] == 0.0 or abs(wrapped(angle - axis.angle, 0.5 * math.pi)) > MAX_OFF_AXIS
    if begins:
        new = _best_known_first(edges, joint)
    rows, slopes = np.zeros(2, np.int64), np.array((1.0, -1.0))
    for e in new:
        at = math.atan2(edges[e].uy, edges[e].ux)
        row = row_of(e) + 1
        if abs(wrapped(at - axis.angle, 0.5 * math.pi)) > MAX_OFF_AXIS:
            continue
        if begins:
            joint[AXIS] = joint[row]
            joint[:, AXIS] = joint[:, row]
            joint[AXIS, AXIS] = joint[row, row] + axis.sd**2
            angle, shift[AXIS], begins = at, shift[row], False
            continue
        rows[0], rows[1] = row, AXIS
        observe(joint, shift, rows, slopes, wrapped(angle - at, 0.5 * math.pi), axis.sd**2, AXIS_SIGMAS)
    return angle


@kernel
def _best_known_first(edges: Records, joint: Floats) -> Ints:
    """Walls that the joint estimate knows, by how well it knows their direction."""
    known = np.empty(len(edges), np.int64)
    variance, number = np.empty(len(edges)), 0
    for e in range(min(len(edges), has_rows(joint))):
        row = row_of(e) + 1
        if edges[e].kind == WALL and joint[row, row] > 0.0:
            known[number], variance[number] = e, joint[row, row]
            number += 1
    return known[:number][np.argsort(variance[:number], kind="mergesort")]


@kernel
def _lies_on_too(edges: Records, count: int, e: int, p: Record, wall: int, gates: Gates) -> bool:
    """Whether a piece of a wall lies on another one that is the same: what was mapped twice comes together.

    Not where one of the two has a corner and the other goes on: they may stand one before the other.
    """
    if edges[e].kind != WALL or not related(edges[e]) or overlap(edges[e], p, gates) <= END_MARGIN_M:
        return False
    if not math.isfinite(cost(edges[e], p, gates)) or not same_line(edges[wall], edges[e], gates):
        return False
    if stands_before(edges, count, e, p, gates):
        return False
    part_ways = turns_where_other_goes_on(edges[wall], edges[e]) or turns_where_other_goes_on(edges[e], edges[wall])
    return not part_ways or abs(above(edges[e], p.x, p.y)) <= gates.offset


@kernel
def _observe_wall(
    edges: Records, e: int, p: Record, pose: Pose, update: KalmanUpdate, noise: float, axis: Axis
) -> None:
    """Take in what a piece shows of its wall: distance, direction, and corners, which hold the robot in a corridor."""
    w, row = edges[e], row_of(e)
    if not related(w):
        return
    t, lever = along(w, p.x, p.y), w.uy * (p.y - pose[1]) + w.ux * (p.x - pose[0])
    worth = UNSURE_WORTH if _may_be_of_two_faces(p, w, t, noise) else 1.0
    off = -above(w, p.x, p.y)
    aside = _observe(
        update,
        p.moment,
        (-w.uy, w.ux, lever),
        np.array((row, row + 1)),
        np.array((-1.0, -t)),
        off,
        noise**2 / (worth * p.hits) + NOISE_FLOOR_M**2,
        math.inf,
    )
    turn = wrapped(math.atan2(w.uy, w.ux) - math.atan2(p.uy, p.ux))
    if worth == 1.0:
        strain(w, row, update.joint, t, aside)
        variance = noise**2 / p.spread + WALL_FLOOR**2
        by_pose, of_wall = (0.0, 0.0, 1.0), np.array((-1.0,))
        turned = _observe(update, p.moment, by_pose, np.array((row + 1,)), of_wall, turn, variance, math.inf)
        if not math.isfinite(axis.sd) or _is_nearer(p, w, axis.angle):
            strain_direction(w, row, update.joint, aside, turned)
    for side in range(2):
        if not tells_end(p, side) or w.strength[side] < MIN_VIEWS:
            continue
        outward, tip = 1.0 if side == 1 else -1.0, tip_at(w, side)
        off = tip - t - p.end[side] + outward * (0.5 * w.slack[side] - end_at(p.slack[side]) * p.slack[side])
        sd = end_sd(SLACK_SD * (p.slack[side] + w.slack[side]), noise)
        by_end, f = lengthwise(w, tip, pose), w.link[side]
        if f >= 0 and related(edges[f]):
            corner = corner_slopes(w, edges[f], tip, w.tip[side, 0], w.tip[side, 1])
            rows = np.array((row, row + 1, row_of(f), row_of(f) + 1))
            _observe(update, p.moment, by_end, rows, corner, off, sd * sd, END_SIGMAS)
        elif is_landmark(w, side):
            end, rows, slopes = row + 2 + side, np.zeros(6, np.int64), np.zeros(6)
            if update.joint[end, end] > 0.0:
                itself = np.array((end,)), np.array((-1.0,))
                _observe(update, p.moment, by_end, *itself, off, sd * sd, END_SIGMAS)
                continue
            _spread(rows, slopes, p.moment, by_end)
            settle(update)
            place_end(update.joint, end, rows, slopes, sd * sd)


@kernel
def _may_be_of_two_faces(p: Record, wall: Record, t: float, noise: float) -> bool:
    """Whether a piece of few beams, t metres along its wall, may have hits on the next face, too.

    Where it shares a corner with the next piece, both faces are told apart. In the middle of a wall there is no other.
    """
    if not is_unsure(p, noise) or p.label[0] == NOMINAL or p.label[1] == NOMINAL:
        return False
    margin = 0.5 * (p.end[1] - p.end[0])
    return bool(t + p.end[0] < tip_at(wall, 0) + margin or t + p.end[1] > tip_at(wall, 1) - margin)


@kernel
def _spread(rows: Ints, slopes: Floats, moment: float, by_pose: tuple[float, float, float]) -> None:
    """Write into the first six rows and slopes what depends on the pose at a moment of the revolution."""
    for k in range(3):
        rows[k], rows[3 + k] = k, BEGIN + k
        slopes[k], slopes[3 + k] = moment * by_pose[k], (1.0 - moment) * by_pose[k]


@kernel
def _observe(
    update: KalmanUpdate,
    moment: float,
    by_pose: tuple[float, float, float],
    rows: Ints,
    slopes: Floats,
    off: float,
    variance: float,
    sigmas: float,
) -> Innovation:
    """Take in a number that depends on the pose at a moment of the revolution, by_pose, and on other rows (k,)."""
    all_rows, all_slopes = np.empty(6 + len(rows), np.int64), np.empty(6 + len(rows))
    _spread(all_rows, all_slopes, moment, by_pose)
    all_rows[6:], all_slopes[6:] = rows, slopes
    return take(update, all_rows, all_slopes, off, variance, sigmas)
