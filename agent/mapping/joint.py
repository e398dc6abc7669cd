"""What is known of pose, wheels and walls together: one Gaussian over their errors, as in EKF-SLAM (ours).

A wall is placed from where the robot believes to be, so both share that error; a wall that is seen beside an older one
is known better against that than against the map's origin. The joint covariance holds all this (Smith, Self and
Cheeseman, "Estimating uncertain spatial relationships in robotics", 1990): when a robot comes back to walls that it
knows well, what it mapped on the way moves with it.
"""

import math

import numpy as np

from agent.corner_scan import NOISE_FLOOR_M, OCCLUSION
from agent.geometry.lines import Record, along
from agent.kernels import kernel
from agent.mapping.edges import FREE, TENTATIVE, WALL, related, set_tip, spread, squares_beside, tip_at
from agent.mapping.kalman import observe
from agent.mapping.tentative import is_steady
from protocol.arrays import Bools, Floats, Ints, Records
from protocol.geometry import Pose

AXIS = 6  # row of the walls' common axis, after the pose (x, y, theta) and the wheels' three constants
BEGIN = 7  # first row of the pose at the begin of the revolution, which was that of the last scan
WALLS = 10
"""Row of the first wall. Each has four: its offset to the left, m, at the point that its record holds, its direction,
rad, and how far along it its tail and its head are, m. What is not known, or exact, has zeros."""
PER_WALL = 4
SLACK_SD = 0.5
"""Standard deviation of an end in one scan, as a share of its slack: 0.46 to 0.65 in 10,000 views of columns, of half a
beam's worth or of a hundred. Were all places within the slack alike it would be 0.29, but beams are mixed or lost."""
END_AT = 0.53
"""Where in its slack an end is in the mean, as a share: beams at edges are mixed or lost, more so at grazing incidence.
Taken to be in the middle, ends are 0.02 to 0.07 of it too near (27,000 views in five layouts), which shortened maps
along corridors of rooms."""
FLAT_SLACK_M, FLATTEST = 0.2, 0.3
"""Slack from which an end is farther out in it, by as much of its share as it has metres more, and by how much at most.
Beams that meet a wall flat reach its end seldom, and the last are mixed or lost: the mean share was 0.66 from 0.24 m on
and 0.8 from 0.4 m on (870 views by 360 and 180 beams). Corridors of rooms were mapped too short, by 0.4 % with 180."""
MIN_VIEWS = 2.0  # views that must have confirmed an end before it holds the robot
END_SIGMAS = 5.0
"""Deviations that the end of a piece may be off its wall's. A stray beam ends a piece in the middle of a wall, in a
corridor 30 m away from that wall's corner; where the robot's place is uncertain, Cauchy's weight let that pull it by
0.15 m."""
_Slopes = tuple[float, float, float, float, float]
MAX_JOINT = 512  # walls beyond have no rows: 34 MB of covariances


@kernel
def row_of(wall: int) -> int:
    """First of the rows of a wall."""
    return WALLS + PER_WALL * wall


@kernel
def has_rows(joint: Floats) -> int:
    """How many walls may have rows."""
    return (len(joint) - WALLS) // PER_WALL


@kernel
def relate(edges: Records, count: int, joint: Floats, pose: Pose) -> None:
    """Write into each wall of edges (n,) how well its line is known from where the robot is, and its ends along it.

    joint: (m, m). pose: map frame.
    """
    rows = has_rows(joint)
    for e in range(count):
        edges[e].held[:] = 0
        edges[e].tip_sd[:] = 0.0
        if e >= rows or joint[row_of(e), row_of(e)] == 0.0:
            edges[e].relative[:] = 0.0  # what was cut off a wall in the last scan has its numbers still
        elif edges[e].kind != FREE:
            _relate(edges[e], row_of(e), joint, pose)
            for side in range(2):
                end = row_of(e) + 2 + side
                edges[e].held[side] = 1 if joint[end, end] > 0.0 and is_landmark(edges[e], side) else 0
                edges[e].tip_sd[side] = _tip_sd(edges, e, side, joint, pose)


@kernel
def crosswise(wall: Record, pose: Pose) -> tuple[_Slopes, _Slopes]:
    """By how much a wall seems farther to its left by errors of its line (offset, direction) and of the pose.

    That is at the point that its record holds, and how much more a metre along it. Of the pose: x, y, theta.
    """
    return (1.0, 0.0, wall.uy, -wall.ux, along(wall, pose[0], pose[1])), (0.0, 1.0, 0.0, 0.0, -1.0)


@kernel
def _relate(wall: Record, row: int, joint: Floats, pose: Pose) -> None:
    """The line's distance from the robot errs by a part that is the same all along it, and one that grows."""
    rows = (row, row + 1, 0, 1, 2)
    same, grows = crosswise(wall, pose)
    for k in range(3):
        wall.relative[k] = 0.0
    for i in range(5):
        for j in range(5):
            v = joint[rows[i], rows[j]]
            wall.relative[0] += same[i] * v * same[j]
            wall.relative[1] += same[i] * v * grows[j]
            wall.relative[2] += grows[i] * v * grows[j]
    wall.relative[0] = max(wall.relative[0], 1e-12)


@kernel
def _tip_sd(edges: Records, e: int, side: int, joint: Floats, pose: Pose) -> float:
    """Standard deviation of an end along its wall as seen from the robot, m; 0 where it is not known."""
    w, row, f = edges[e], row_of(e), edges[e].link[side]
    tip = tip_at(w, side)
    rows, slopes = np.array((0, 1, 2, row + 2 + side, 0, 0, 0)), np.zeros(7)
    slopes[0], slopes[1], slopes[2] = lengthwise(w, tip, pose)
    if 0 <= f < has_rows(joint) and joint[row_of(f), row_of(f)] > 0.0:
        rows[3], rows[4], rows[5], rows[6] = row, row + 1, row_of(f), row_of(f) + 1
        slopes[3:] = corner_slopes(w, edges[f], tip, w.tip[side, 0], w.tip[side, 1])
    elif w.held[side] == 1:
        slopes[3] = -1.0
    else:
        return 0.0
    variance = 0.0
    for i in range(7):
        for j in range(7):
            variance += slopes[i] * joint[rows[i], rows[j]] * slopes[j]
    return math.sqrt(max(variance, 0.0))


@kernel
def is_landmark(wall: Record, side: int) -> bool:
    """Whether an end has rows of its own: a corner of which one wall is known, and that often enough."""
    return bool(wall.label[side] == OCCLUSION and wall.link[side] < 0 and wall.strength[side] >= MIN_VIEWS)


@kernel
def tells_end(p: Record, side: int) -> bool:
    """Whether a piece of a scan tells where its wall ends: the face beyond is out of sight, and it is no stray's end.

    Hits on that face lengthen the piece by 0.1 to 1.6 of the distance of two beams: by up to 90 mm from 2.5 m away.
    A stray's end, taken for the corner of a corridor, moved a robot by 0.65 m that knew its place there to 0.2 m.
    """
    return bool(p.label[side] == OCCLUSION and p.face[side] == 0.0 and p.stray[side] == 0)


@kernel
def end_at(slack: float) -> float:
    """Where in its slack, metres, an end is in the mean: a share."""
    return END_AT + min(max(slack - FLAT_SLACK_M, 0.0), FLATTEST)


@kernel
def end_sd(slack: float, noise: float) -> float:
    """Standard deviation of an end that lies somewhere in so much slack, metres. noise: of a near range."""
    return math.hypot(slack, NOISE_FLOOR_M + noise)


@kernel
def place_end(joint: Floats, row: int, rows: Ints, slopes: Floats, variance: float) -> None:
    """Give a row (m,) to an end that errs as others (k,) do, and by a variance of its own."""
    for i in range(len(joint)):
        joint[row, i] = 0.0
    for k in range(len(rows)):
        for i in range(len(joint)):
            joint[row, i] += slopes[k] * joint[rows[k], i]
    joint[:, row] = joint[row]
    own = variance
    for k in range(len(rows)):
        own += slopes[k] * joint[row, rows[k]]
    joint[row, row] = own


@kernel
def carry(edges: Records, joint: Floats, shift: Floats, pose: Pose) -> None:
    """Let errors go along as pose and walls are about to move by shift (m,): joint (m, m) is updated in place.

    How robot and walls together are turned and shifted shows in no scan. Slopes depend on the estimates, so those taken
    before a move and after it are blind to different turns, and the filter would take itself to learn the frame's. So a
    turn of the robot swings all about the origin from where it is now, as in the invariant filter of Barrau and
    Bonnabel ("An EKF-SLAM algorithm with consistency properties", 2015). pose: of the robot, before the move.
    """
    swung = np.zeros((3, len(shift)))
    for e in range(min(len(edges), (len(shift) - WALLS) // PER_WALL)):
        w, row = edges[e], row_of(e)
        aside, turn = shift[row], shift[row + 1]
        if w.kind == FREE or (aside == 0.0 and turn == 0.0):
            continue
        angle = math.atan2(w.uy, w.ux) + turn
        ux, uy = math.cos(angle), math.sin(angle)
        x, y, dx, dy = w.x - aside * w.uy, w.y + aside * w.ux, ux - w.ux, uy - w.uy
        swung[0, row], swung[1, row] = -dy, dx
        swung[2, row] = ux * x + uy * y - w.ux * w.x - w.uy * w.y - dy * pose[1] - dx * pose[0]
        swings = uy * x - ux * y - w.uy * w.x + w.ux * w.y + dx * pose[1] - dy * pose[0]
        for end in range(row + 2, row + PER_WALL):
            if joint[end, end] > 0.0:
                swung[0, end], swung[1, end], swung[2, end] = dx, dy, swings
    swung[2, 0], swung[2, 1] = -shift[1], shift[0]
    _go_along(joint, swung)


@kernel
def _go_along(joint: Floats, by: Floats) -> None:
    """Let errors depend on those of the pose (x, y, theta) by so much more, (3, m)."""
    m = by.shape[1]
    if not by.any():
        return
    for i in range(m - 1, -1, -1):  # the pose last: the others depend on it as it was
        if by[0, i] != 0.0 or by[1, i] != 0.0 or by[2, i] != 0.0:
            for k in range(m):
                joint[i, k] += by[0, i] * joint[0, k] + by[1, i] * joint[1, k] + by[2, i] * joint[2, k]
    for i in range(m):
        x, y, theta, row = joint[i, 0], joint[i, 1], joint[i, 2], joint[i]
        if x != 0.0 or y != 0.0 or theta != 0.0:
            for k in range(m):
                row[k] += by[0, k] * x + by[1, k] * y + by[2, k] * theta


@kernel
def move_walls(edges: Records, shift: Floats) -> None:
    """Move walls of edges (n,) and their ends by what a scan has shown of them, shift (m,)."""
    for e in range(min(len(edges), (len(shift) - WALLS) // PER_WALL)):
        wall, row = edges[e], row_of(e)
        aside, turn = shift[row], shift[row + 1]
        if wall.kind == FREE or (aside == 0.0 and turn == 0.0):
            continue
        ends, size = (tip_at(wall, 0) + shift[row + 2], tip_at(wall, 1) + shift[row + 3]), spread(wall)
        beside = squares_beside(wall)
        wall.x -= aside * wall.uy
        wall.y += aside * wall.ux
        angle = math.atan2(wall.uy, wall.ux) + turn
        wall.ux, wall.uy = math.cos(angle), math.sin(angle)
        wall.xx, wall.yy = size * wall.ux**2 + beside * wall.uy**2, size * wall.uy**2 + beside * wall.ux**2
        wall.xy = (size - beside) * wall.ux * wall.uy
        set_tip(wall, 0, ends[0])
        set_tip(wall, 1, ends[1])


@kernel
def know_walls(edges: Records, count: int, joint: Floats, pose: Pose, noise: float, tentative: Bools) -> Ints:
    """Give rows to what has become a wall or a steady tentative one in this scan, and take those of others away.

    tentative: (k,) which records were tentative walls before the scan. Returns the new walls.
    """
    new, number = np.empty(len(edges), np.int64), 0
    for e in range(has_rows(joint), count):
        edges[e].twin = 0
    for e in range(min(len(edges), has_rows(joint))):
        wall, row, twin = edges[e], row_of(e), edges[e].twin
        wall.twin = 0
        is_wall = e < count and wall.kind == WALL
        holds = is_wall or (e < count and wall.kind == TENTATIVE and is_steady(wall, noise))
        if holds and twin == 0 and related(wall):
            if is_wall and e < len(tentative) and tentative[e]:
                new[number] = e
                number += 1
            for side in range(2):
                if not is_landmark(wall, side) and wall.link[side] < 0:
                    forget(joint, row + 2 + side)
            continue
        if joint[row, row] > 0.0:
            joint[row : row + PER_WALL] = 0.0
            joint[:, row : row + PER_WALL] = 0.0
        if not holds:
            wall.relative[:] = 0.0
            continue
        if 0 < twin <= has_rows(joint) and related(wall) and joint[row_of(twin - 1), row_of(twin - 1)] > 0.0:
            _copy_rows(joint, row_of(twin - 1), row)
        else:
            _place(wall, row, joint, pose, noise)
            if is_wall:
                new[number] = e
                number += 1
        _relate(wall, row, joint, pose)
    return new[:number]


@kernel
def forget(joint: Floats, row: int) -> None:
    """Take its row away from what is not known any more."""
    if joint[row, row] > 0.0:
        joint[row] = 0.0
        joint[:, row] = 0.0


@kernel
def middle_of_end(wall: Record, side: int) -> float:
    """Coordinate along its wall at which an end is taken to be: the middle of its slack."""
    return float(tip_at(wall, side) + (0.5 if side == 1 else -0.5) * wall.slack[side])


@kernel
def lengthwise(wall: Record, tip: float, pose: Pose) -> tuple[float, float, float]:
    """By how much an end, `tip` along its wall, seems farther on by errors of the pose (x, y, theta)."""
    x, y = wall.x + tip * wall.ux - pose[0], wall.y + tip * wall.uy - pose[1]
    return wall.ux, wall.uy, wall.uy * x - wall.ux * y


@kernel
def corner_slopes(wall: Record, other: Record, tip: float, x: float, y: float) -> Floats:
    """(4,) by how much a corner at (x, y), `tip` along its wall, lies less far on, by errors of both walls' lines."""
    sine, cosine = other.ux * wall.uy - other.uy * wall.ux, other.ux * wall.ux + other.uy * wall.uy
    slopes: Floats = np.array((cosine, cosine * tip, -1.0, -along(other, x, y))) / sine
    return slopes


@kernel
def hold_corners(edges: Records, before: Records, joint: Floats, shift: Floats, noise: float) -> None:
    """Let known ends that have become corners say where the other wall lies: joint (m, m) and shift (m,) in place.

    Else what is known of the end were lost with its row, and the corner as well known as the newer wall. before: (k,)
    the walls before the scan was merged.
    """
    rows, slopes = np.zeros(5, np.int64), np.full(5, -1.0)
    for e in range(min(len(before), has_rows(joint), (len(shift) - WALLS) // PER_WALL)):
        w = edges[e]
        for side in range(2):
            f, end = w.link[side], row_of(e) + 2 + side
            if f < 0 or f >= has_rows(joint) or joint[end, end] == 0.0:
                continue
            if before[e].held[side] == 1 and related(w) and related(edges[f]):
                tip = tip_at(w, side)
                off = along(w, before[e].tip[side, 0], before[e].tip[side, 1]) - tip
                off += middle_of_end(before[e], side) - tip_at(before[e], side)
                rows[0], rows[1], rows[2], rows[3], rows[4] = end, row_of(e), row_of(e) + 1, row_of(f), row_of(f) + 1
                slopes[1:] = -corner_slopes(w, edges[f], tip, w.tip[side, 0], w.tip[side, 1])
                sd = NOISE_FLOOR_M + noise
                observe(joint, shift, rows, slopes, off, sd * sd, END_SIGMAS)
            forget(joint, end)
            shift[end] = 0.0


@kernel
def _copy_rows(joint: Floats, old: int, row: int) -> None:
    """Two parts of a wall that was cut lie on one line."""
    for k in range(2):
        joint[row + k] = joint[old + k]
    for k in range(2):
        joint[:, row + k] = joint[:, old + k]


@kernel
def _place(wall: Record, row: int, joint: Floats, pose: Pose, noise: float) -> None:
    """A new wall errs as the pose does that it was seen from, and by its own hits."""
    at = along(wall, pose[0], pose[1])
    for k in range(len(joint)):
        joint[row, k] = -wall.uy * joint[0, k] + wall.ux * joint[1, k] - at * joint[2, k]
        joint[row + 1, k] = joint[2, k]
    for k in range(len(joint)):
        joint[k, row], joint[k, row + 1] = joint[row, k], joint[row + 1, k]
    for a in range(2):
        of_pose = -wall.uy * joint[0, row + a] + wall.ux * joint[1, row + a] - at * joint[2, row + a]
        joint[row, row + a], joint[row + 1, row + a] = of_pose, joint[2, row + a]
    joint[row, row] += noise**2 / wall.hits
    joint[row + 1, row + 1] += noise**2 / spread(wall)
