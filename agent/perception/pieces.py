"""From straight runs of beams to the pieces of a corner scan: lines, shared corners, and labels of ends (paper II)."""

import math
from typing import NamedTuple

import numpy as np

from agent.corner_scan import BRIDGE_M, CUT_SIGMAS, FRONTIER, NOISE_SIGMAS, NOMINAL, OCCLUSION, PIECE
from agent.geometry.lines import MIN_CORNER_SINE, Record, along, meet
from agent.kernels import kernel
from agent.perception.beams import Beams, width_of
from agent.perception.segmentation import LINE_COST, MIN_HITS, fit_line
from protocol.arrays import Bools, Floats, Ints, Records

SURE_HITS = 5
"""Hits that tell a line for sure, however far apart they are. Three hits of clutter often fit one: with 3 and gaps of
1 m, the share of csail's map that scans support fell from .91 to .88."""
OPEN_BEAMS = 3  # beams in a row of which none came back show free space: fewer may have dropped out
LOOK_PAST = 3  # beams beyond an end that may be asked: the next, and two more where dropouts or strays say nothing
MAX_STRAYS = 2  # stray beams across which a line may go on
STRAY_SIGMAS = 10.0  # standard deviations off its line from which a beam is none of a piece's hits
STRAY_END_SIGMAS = 6.0
"""Standard deviations off a wall's line up to which a beam may be noise, if the next one is on the line again. Of
1,000 scans in a corridor one has an end that such a beam makes. Without this bound the jambs of a door that one beam
passes were such ends, too, and one map of five in `symmetric` was 7 mm off in itself instead of 3."""
EDGE_OF_RANGE_SIGMAS = 3.5
"""A wall within so many standard deviations of the lidar's range may give no return. With 1.5, three views in a hundred
told of a corner where the range ends: a robot that stood for a minute cut the wall there, and all its peers drove to
look. Where noise grows with range, it was one end in ten in `symmetric`."""
UNSEEN_FACE_SIGMAS = 3.0
"""Standard deviations behind a wall's line up to which hits on the small face beyond its end pass for hits on the wall:
two of them cost the fit as much as two strays."""
CORNER_SIGMAS = 3.0
"""Standard deviations of a range by which two faces must lie apart along a beam for it to tell which of them it met.
Near a corner a beam counts for the face that noise puts it nearer to. A face that stands out into the room gains beams
from behind so: a column of 0.4 m seemed 1 mm too far away from 0.5 m and 5 mm from 2.7 m, and a robot that came nearer
took itself to have come 0.2 % farther than it had."""
DOUBTFUL = 0.1  # weight of a beam that may have met either of two faces; not 0, so that short pieces keep a line
CUT = 1e-6
"""Weight of a beam that meets its line where the lidar cuts off: it came back as noise has shortened it. A wall of
`hall` in 3.47 m seemed 50 mm nearer, scan after scan, and took a map along by 36 mm that had been right. A piece
without enough other beams is none. Not 0, so that a sum of weights never is."""
TELLING_NOISE_M = 0.015
"""Standard deviation of a range up to which a beam tells which wall of a corner it met. With 0.03 the last hits on one
pass for hits on the other, and slots were seen that are none: a robot took 511 s in `apartment` instead of 259."""
TELLING_APART_M = 0.1  # distance of two beams on a wall up to which they tell of a slot before its corner
DOORWAY_M = 0.5
"""Length of a wall without a hit, before its corner with the next one, in which a door may stand open. From 0.1 m off
a wall's line beams meet it a metre apart: a door of 0.9 m was wall for the robot and all its peers."""
MAX_SLACK_M = 0.1  # a corner lies at most so far off its walls' hits, however unsure the directions of few hits are


class RangeScan(NamedTuple):
    """The beams of a scan, and what kernels need to know of them and of their lidar."""

    beams: Beams  # (n,)
    noise: Floats  # (n,) m, standard deviation of each range
    hidden: Bools  # (n,) which were not measured, end on a teammate, or pass it narrowly
    used: Ints  # (m,) indices of those that may show walls, rising
    range_max: float  # m, beyond which nothing comes back
    silence: int  # silent beams in a row that show that a wall is not there: more than dropouts explain
    unit: float  # m, the standard deviation of a range that counts as one hit
    grows: bool  # whether noise grows with range, so that far beams tell little and bias what they are fitted to
    bridge_m: float  # between neighbouring hits of a sure line, up to which the wall goes on there


@kernel
def pieces_of(scan: RangeScan, cuts: Ints, sums: Floats) -> tuple[Records, Bools]:
    """Pieces (p,) of PIECE, and which beams (n,) are explained by one.

    cuts (k, 2) and sums (2 m + 1, 6): as from `segmentation.piecewise`, over the used beams.
    """
    cuts = _split_at_gaps(scan, cuts, sums)
    explained = np.zeros(len(scan.hidden), np.bool_)
    for k in range(len(cuts)):
        for j in range(cuts[k, 0], cuts[k, 1]):
            explained[scan.used[j % len(scan.used)]] = True
    cuts, totals = _join_across_strays(scan, cuts, sums)
    ends, worth = np.empty((len(cuts), 2), np.int64), np.ones(len(scan.hidden))
    for k in range(len(cuts)):
        for side in range(2):
            ends[k, side] = _beam(scan, cuts[k, side] - side)
    pieces = _with_corners(scan, cuts, ends, totals, worth)
    if scan.grows:
        whole = np.ones(len(cuts), np.bool_)
        for k in range(len(cuts)):
            for side in range(2):
                _doubt_beams(worth, pieces, k, side, scan, cuts[k])
            whole[k] = _beams_in_reach(worth, pieces[k], scan, cuts[k]) >= MIN_HITS
            for j in range(cuts[k, 0], cuts[k, 1]):
                beam = scan.used[j % len(scan.used)]
                if explained[beam]:  # a stray that the piece was joined across is in no sum
                    totals[k] -= (1.0 - worth[beam]) * (sums[j + 1] - sums[j])
        pieces = _with_corners(scan, cuts[whole], ends[whole], totals[whole], worth)
    return _plausible(pieces, scan.range_max), explained


@kernel
def _with_corners(scan: RangeScan, cuts: Ints, ends: Ints, totals: Floats, worth: Floats) -> Records:
    """Pieces (k,) of PIECE with labelled ends. cuts, ends (k, 2): their beams; totals (k, 6): sums of these.

    worth: (n,) what each beam counts for a line.
    """
    pieces = np.zeros(len(cuts), PIECE)
    for k in range(len(cuts)):
        _fill(pieces[k], scan, cuts[k], ends[k], totals[k], worth)
    for k in range(len(cuts)):
        _link_corner(pieces, k, scan, ends)
    for k in range(len(cuts)):
        for side in range(2):
            p = pieces[k]
            if p.label[side] != NOMINAL:
                p.label[side], decided, beyond = _predicted_label(scan, ends[k, side], side, totals[k])
                if p.label[side] == OCCLUSION:  # it may lie anywhere up to the ray that shows its wall's absence
                    p.face[side] = _on_small_face(p, scan, ends[k, side], side)
                    p.slack[side] = abs(_on_ray(p, scan.beams, beyond) - p.end[side])
                    p.stray[side] = scan.grows and _is_stray(p, scan, decided, side)
    return pieces


@kernel
def _plausible(pieces: Records, range_max: float) -> Records:
    """Those of pieces (k,) that a lidar of this range can have seen: that end after they begin, and not out of sight.

    Where beams run along the line that is fitted to them, they meet it anywhere. Seen where the robot seemed to pass
    through a wall, as the wheels slipped or the lidar is not where its specification says.
    """
    kept, new = np.empty(len(pieces), np.bool_), np.full(len(pieces), -1)
    for k in range(len(pieces)):
        tail, head = pieces[k].end
        kept[k] = tail < head and max(-tail, head) <= 2.0 * range_max
    new[kept] = np.arange(kept.sum())
    for k in range(len(pieces)):
        for side in range(2):
            p = pieces[k]
            if p.link[side] >= 0:
                p.link[side] = new[p.link[side]]
                p.label[side] = NOMINAL if p.link[side] >= 0 else FRONTIER
    return pieces[kept]


@kernel
def _doubt_beams(worth: Floats, pieces: Records, k: int, side: int, scan: RangeScan, cut: Ints) -> None:
    """Let those beams of piece k count little, in worth (n,), that may have met the face beyond its corner.

    Where that face is no piece, it is taken to be square, and out of sight unless the lidar stands beyond the corner.
    """
    p, m, outward = pieces[k], len(scan.used), 1.0 if side == 1 else -1.0
    x, y, ux, uy = p.x + p.end[side] * p.ux, p.y + p.end[side] * p.uy, -p.uy, p.ux
    if p.label[side] == NOMINAL:
        q = pieces[p.link[side]]
        x, y, ux, uy = q.x, q.y, q.ux, q.uy
    elif outward * (along(p, 0.0, 0.0) - p.end[side]) <= 0.0:
        return
    for i in range(cut[1] - cut[0]):
        beam = scan.used[(cut[1] - 1 - i if side == 1 else cut[0] + i) % m]
        apart = _range_to(p.x, p.y, p.ux, p.uy, scan.beams, beam) - _range_to(x, y, ux, uy, scan.beams, beam)
        if not abs(apart) < CORNER_SIGMAS * scan.noise[beam]:
            return
        worth[beam] = DOUBTFUL


@kernel
def _beams_in_reach(worth: Floats, p: Record, scan: RangeScan, cut: Ints) -> int:
    """Number of beams of piece p that meet its line where the lidar cuts off none; the others count for nothing, in
    worth (n,)."""
    number = 0
    for j in range(cut[0], cut[1]):
        beam = scan.used[j % len(scan.used)]
        if _range_to(p.x, p.y, p.ux, p.uy, scan.beams, beam) > scan.range_max - CUT_SIGMAS * scan.noise[beam]:
            worth[beam] = CUT
        else:
            number += 1
    return number


@kernel
def _range_to(x: float, y: float, ux: float, uy: float, beams: Beams, k: int) -> float:
    """Range of beam k to the line through a point in a direction, metres; inf where they are parallel."""
    c, s = beams.directions[k, 0], beams.directions[k, 1]
    cross = c * uy - s * ux
    return math.inf if abs(cross) < 1e-6 else ((x - beams.origins[k, 0]) * uy - (y - beams.origins[k, 1]) * ux) / cross


@kernel
def _beam(scan: RangeScan, j: int) -> int:
    """The beam of place j among the used ones; beyond one revolution the number of beams is added."""
    m = len(scan.used)
    return int(scan.used[j % m] + len(scan.hidden) * (j // m))


@kernel
def _split_at_gaps(scan: RangeScan, cuts: Ints, sums: Floats) -> Ints:
    """Cut pieces where two neighbouring hits are too far apart to show that the wall goes on, or free space is between.

    Sparse beams meet a wall far ahead a metre apart, and it is those hits that tell its direction best. Pieces seen
    from behind are left out: the lidar passed a wall's line on the way to the stamp.
    """
    m, count = len(scan.used), 0
    out = np.empty((m + 1, 2), np.int64)
    for k in range(len(cuts)):
        begin, line = cuts[k, 0], _line_of(sums[cuts[k, 1]] - sums[cuts[k, 0]])
        bridge = scan.bridge_m if cuts[k, 1] - begin >= SURE_HITS else BRIDGE_M
        for j in range(cuts[k, 0] + 1, cuts[k, 1] + 1):
            last, following = scan.used[(j - 1) % m], scan.used[j % m]
            if j < cuts[k, 1] and _goes_on(scan, line, last, following, bridge):
                continue
            seen_in_front = width_of(scan.beams, _beam(scan, begin), _beam(scan, j - 1)) > 0.0
            if j - begin >= MIN_HITS and seen_in_front:
                out[count, 0], out[count, 1] = begin, j
                count += 1
            begin = j
    return out[:count].copy()


@kernel
def _goes_on(
    scan: RangeScan, line: tuple[float, float, float, float], last: int, following: int, bridge: float
) -> bool:
    """Whether the hits of two beams on a line show that there is wall between them. bridge: metres, at most."""
    return _apart(line, scan.beams, last, following) <= bridge and not _opens(scan, last, following)


@kernel
def _opens(scan: RangeScan, last: int, following: int) -> bool:
    """Whether a scan shows free space between the hits of two beams, both well within the lidar's range.

    Two walls in one line with a slit of 0.2 m between them were one wall, in each view from where nothing stands behind
    the slit; from nearby they were two again, and a robot looked at the ends of both for minutes.
    """
    farthest = max(scan.beams.distances[last], scan.beams.distances[following])
    if farthest > scan.range_max - EDGE_OF_RANGE_SIGMAS * max(scan.noise[last], scan.noise[following]):
        return False
    n, silent = len(scan.hidden), 0
    for step in range(1, (following - last) % n):
        k = (last + step) % n
        silent = 0 if scan.hidden[k] or math.isfinite(scan.beams.ranges[k]) else silent + 1
        if silent == OPEN_BEAMS:
            return True
    return False


@kernel
def _line_of(total: Floats) -> tuple[float, float, float, float]:
    """The line fitted to sums (6,): a point on it, m, and its direction."""
    a, b, _ = fit_line(total)
    norm = math.hypot(a, b)
    return a / norm**2, b / norm**2, -b / norm, a / norm


@kernel
def _apart(line: tuple[float, float, float, float], beams: Beams, p: int, q: int) -> float:
    """Distance of two beams on a line, metres; inf where one does not meet it.

    Not of the points that they met, as their ranges err: far ones are farther apart, and would be left out sooner.
    """
    x, y, ux, uy = line
    r, s = _range_to(x, y, ux, uy, beams, p), _range_to(x, y, ux, uy, beams, q)
    if not (0.0 < r < math.inf and 0.0 < s < math.inf):
        return math.inf
    dx = beams.origins[q, 0] + s * beams.directions[q, 0] - beams.origins[p, 0] - r * beams.directions[p, 0]
    dy = beams.origins[q, 1] + s * beams.directions[q, 1] - beams.origins[p, 1] - r * beams.directions[p, 1]
    return math.hypot(dx, dy)


@kernel
def _join_across_strays(scan: RangeScan, cuts: Ints, sums: Floats) -> tuple[Ints, Floats]:
    """Join neighbouring pieces on one line that only a stray or two part; returns pieces and their sums.

    A stray is noise: what stands out farther is a post or the edge of a thin wall, at whose corners the pieces may end.
    """
    out, total, count = np.empty_like(cuts), np.empty((len(cuts), 6)), 0
    for k in range(len(cuts)):
        own = sums[cuts[k, 1]] - sums[cuts[k, 0]]
        if count:
            joint = total[count - 1] + own
            cost = fit_line(total[count - 1])[2] + fit_line(own)[2] + LINE_COST
            if fit_line(joint)[2] < cost and _only_strays(scan, out[count - 1, 1], cuts[k, 0], joint):
                out[count - 1, 1], total[count - 1] = cuts[k, 1], joint
                continue
        out[count], total[count] = cuts[k], own
        count += 1
    return out[:count].copy(), total[:count].copy()


@kernel
def _only_strays(scan: RangeScan, first: int, end: int, joint: Floats) -> bool:
    """Whether between two pieces only the beams [first, end) lie, few, and off the joint line by no more than noise."""
    m = len(scan.used)
    if end - first > MAX_STRAYS:
        return False
    a, b, _ = fit_line(joint)
    for j in range(first, end):
        beam = scan.used[j % m]
        bearing = scan.beams.bearings[beam]
        u = a * math.cos(bearing) + b * math.sin(bearing)
        if not abs(scan.beams.distances[beam] * u - 1.0) < NOISE_SIGMAS * scan.noise[beam] * u:
            return False
    last, following = scan.used[(first - 1) % m], scan.used[end % m]
    return _goes_on(scan, _line_of(joint), last, following, BRIDGE_M)


@kernel
def _nearer(scan: RangeScan, cut: Ints) -> float:
    """By what factor a line that is fitted to some beams lies too far away: ranges err, and the fit has their squares.

    With noise of 1.75 % of the range it is 1.0003: pieces of walls in `symmetric` lay 0.3 to 0.7 mm behind them.
    """
    total = 0.0
    for j in range(cut[0], cut[1]):
        k = scan.used[j % len(scan.used)]
        total += (scan.noise[k] / scan.beams.distances[k]) ** 2
    return 1.0 + total / (cut[1] - cut[0])


@kernel
def _fill(piece: Record, scan: RangeScan, cut: Ints, ends: Ints, total: Floats, worth: Floats) -> None:
    """Fill a piece with its line and hits. Both its ends are frontiers until more is known.

    cut: (2,) first and end of its beams in the doubled scan. ends: (2,) its first and last beam. total: (6,) sums over
    its beams. worth: (n,) what each beam counts.
    """
    m, beams = len(scan.used), scan.beams
    a, b, _ = fit_line(total)
    if scan.grows:
        nearer = _nearer(scan, cut)
        a, b = nearer * a, nearer * b
    norm = math.hypot(a, b)
    piece.ux, piece.uy = -b / norm, a / norm
    hits, sum_t, sum_tt, residual, moment = 0.0, 0.0, 0.0, 0.0, 0.0
    powers, offs = np.zeros(5), np.zeros(3)  # sums of t to the power of 0 to 4, and of those to 2 times the offset
    for j in range(cut[0], cut[1]):
        k = scan.used[j % m]
        angle, r = beams.bearings[k], beams.distances[k]
        off = (r * (a * math.cos(angle) + b * math.sin(angle)) - 1.0) / norm
        if abs(off) > STRAY_SIGMAS * scan.noise[k]:
            continue  # a stray that the piece was joined across
        t = r * (math.cos(angle) * piece.ux + math.sin(angle) * piece.uy)
        weight = worth[k] * (scan.unit / scan.noise[k]) ** 2
        hits += weight
        sum_t += weight * t
        sum_tt += weight * t * t
        residual += weight * off * off
        moment += weight * beams.moments[k]
        if not scan.grows:
            continue
        for power in range(5):
            powers[power] += weight * t**power
        for power in range(3):
            offs[power] += weight * off * t**power
    t = sum_t / hits
    if scan.grows:
        piece.bend[0], piece.bend[1] = _bend(powers, offs)
    piece.hits, piece.spread, piece.residual = hits, max(sum_tt - hits * t * t, 1e-9), residual
    piece.moment = moment / hits
    piece.x, piece.y = a / norm**2 + t * piece.ux, b / norm**2 + t * piece.uy
    piece.bearing[0] = beams.bearings[ends[0] % len(beams.bearings)] % (2 * math.pi)
    piece.bearing[1] = piece.bearing[0] + width_of(beams, ends[0], ends[1])
    for side in range(2):
        piece.end[side] = _on_ray(piece, beams, ends[side])
        piece.label[side], piece.link[side], piece.slack[side] = FRONTIER, -1, 0.0
        piece.gap[side], piece.face[side], piece.apart[side], piece.stray[side] = 0.0, 0.0, 0.0, 0


@kernel
def _bend(powers: Floats, offs: Floats) -> tuple[float, float]:
    """What hits tell of a parabola beside any line: the sum of their offsets times q, and that of q squared.

    q is the square of t less the line that fits it best. powers: (5,) sums of t to the power of 0 to 4; offs: (3,) of t
    to the power of 0 to 2, times the offset.
    """
    n, a, b, c, d = powers[0], powers[1], powers[2], powers[3], powers[4]
    det = n * b - a * a
    slope, level = (n * c - a * b) / det, (b * b - a * c) / det
    return offs[2] - slope * offs[1] - level * offs[0], max(d - slope * c - level * b, 0.0)


@kernel
def _on_ray(piece: Record, beams: Beams, k: int) -> float:
    """Where the ray of beam k meets the piece's line, metres from its centroid; inf where it does not."""
    k %= len(beams.ranges)
    c, s, x, y = beams.directions[k, 0], beams.directions[k, 1], beams.origins[k, 0], beams.origins[k, 1]
    cross = c * piece.uy - s * piece.ux
    return math.inf if abs(cross) < 1e-6 else -(c * (piece.y - y) - s * (piece.x - x)) / cross


@kernel
def _on_small_face(piece: Record, scan: RangeScan, beam: int, side: int) -> float:
    """Metres by which a wall may end before its last beam meets its line, as that beam may have hit the face beyond.

    A lidar that stands beyond the end of a thin wall sees its tip, too, whose hits lie behind the line within noise.
    """
    k = beam % len(scan.hidden)
    c, s = scan.beams.directions[k, 0], scan.beams.directions[k, 1]
    outward = (c * piece.ux + s * piece.uy) * (1.0 if side == 1 else -1.0)
    across = abs(c * piece.uy - s * piece.ux)
    behind = UNSEEN_FACE_SIGMAS * scan.noise[k]
    return min(behind * max(-outward, 0.0) / max(across, 1e-6), 0.5 * (piece.end[1] - piece.end[0]))


@kernel
def _link_corner(pieces: Records, k: int, scan: RangeScan, ends: Ints) -> None:
    """Let piece k and the next share a corner if their lines meet between their hits, give or take the noise."""
    count, n = len(pieces), len(scan.hidden)
    after = (k + 1) % count
    p, q = pieces[k], pieces[after]
    begins = ends[after, 0] + (n if k + 1 == count else 0)
    last = ends[k, 1]
    sine, along_p = meet(p, q)
    if count < 2 or begins - last > LOOK_PAST or abs(sine) < MIN_CORNER_SINE:
        return
    along_q = meet(q, p)[1]
    off_p = NOISE_SIGMAS * scan.unit * math.sqrt(1 / p.hits + along_p**2 / p.spread)
    off_q = NOISE_SIGMAS * scan.unit * math.sqrt(1 / q.hits + along_q**2 / q.spread)
    slack = min(math.hypot(off_p, off_q) / abs(sine), MAX_SLACK_M)
    next_p, next_q = _on_ray(p, scan.beams, begins), _on_ray(q, scan.beams, last)
    next_p = next_p if next_p > p.end[1] else math.inf  # the ray runs away from the line
    next_q = next_q if next_q < q.end[0] else -math.inf
    gap_p, gap_q = max(along_p - p.end[1], 0.0), max(q.end[0] - along_q, 0.0)
    if max(gap_p, gap_q) > max(DOORWAY_M, scan.bridge_m):
        return
    if p.end[1] - slack <= along_p <= next_p + slack and next_q - slack <= along_q <= q.end[0] + slack:
        p.label[1], q.label[0] = NOMINAL, NOMINAL
        p.link[1], q.link[0] = after, k
        p.gap[1], q.gap[0] = gap_p, gap_q
        if begins - last == 1:
            p.apart[1] = _telling_apart(p, scan, last, last - 1)
            q.apart[0] = _telling_apart(q, scan, begins, begins + 1)
        p.end[1], q.end[0] = along_p, along_q


@kernel
def _telling_apart(piece: Record, scan: RangeScan, beam: int, before: int) -> float:
    """Distance of two hits of a piece, the last one and that before it, metres; 0 where they tell of no slot."""
    apart = abs(_on_ray(piece, scan.beams, beam) - _on_ray(piece, scan.beams, before))
    telling = apart < TELLING_APART_M and scan.noise[beam % len(scan.noise)] < TELLING_NOISE_M
    return apart if telling else 0.0


@kernel
def _is_stray(piece: Record, scan: RangeScan, beam: int, side: int) -> bool:
    """Whether the beam that ended a piece may have met its line, and the next one is on the line again."""
    following = beam + 2 * side - 1
    return abs(_beyond(piece, scan, beam)) < STRAY_END_SIGMAS and abs(_beyond(piece, scan, following)) < NOISE_SIGMAS


@kernel
def _beyond(piece: Record, scan: RangeScan, beam: int) -> float:
    """How many standard deviations a beam went beyond a piece's line; inf where it tells nothing."""
    k = beam % len(scan.hidden)
    if scan.hidden[k] or not math.isfinite(scan.beams.ranges[k]):
        return math.inf
    return (scan.beams.ranges[k] - _range_to(piece.x, piece.y, piece.ux, piece.uy, scan.beams, k)) / scan.noise[k]


@kernel
def _predicted_label(scan: RangeScan, beam: int, side: int, sums: Floats) -> tuple[int, int, int]:
    """Label by prediction of a piece's end at a beam that is no corner, the beam that decided, and the first beam that
    the wall does not reach.

    The fitted line is prolonged to the next beam: if that went farther, the wall ends before it; if it hit
    something nearer, or nothing could be seen there, the wall is merely hidden or out of range. A silent beam that may
    have dropped out decides nothing, but once another has, it shows how far the wall goes.
    """
    beams, n = scan.beams, len(scan.hidden)
    a, b, _ = fit_line(sums)
    det = sums[0] * sums[2] - sums[1] * sums[1]
    step, silent, before, noise = 2 * side - 1, 0, beams.ranges[beam % n], scan.noise[beam % n]
    for ahead in range(1, LOOK_PAST + 1):
        k = (beam + step * ahead) % n
        c, s = beams.directions[k, 0], beams.directions[k, 1]
        away = 1.0 - a * beams.origins[k, 0] - b * beams.origins[k, 1]  # 0 on the line, 1 at the robot
        u = (a * c + b * s) / away if away > 0.0 else 0.0  # 1 / range at which the beam meets the line
        if scan.hidden[k] or u <= 1.0 / scan.range_max:
            return FRONTIER, k, k
        predicted = 1.0 / u
        spread = predicted**2 * math.sqrt((c * c * sums[2] - 2 * c * s * sums[1] + s * s * sums[0]) / det)
        sd = math.hypot(noise, spread)
        r = beams.ranges[k]
        if not math.isfinite(r):
            if predicted > scan.range_max - EDGE_OF_RANGE_SIGMAS * sd:
                return FRONTIER, k, k
            silent += 1
            if silent == scan.silence:
                return OCCLUSION, k, (k - step * (silent - 1)) % n
        elif r > predicted + NOISE_SIGMAS * sd:
            return OCCLUSION, k, (k - step * silent) % n
        elif r < predicted - NOISE_SIGMAS * sd:
            apart = math.sqrt(max(predicted**2 + before**2 - 2 * predicted * before * math.cos(beams.step), 0.0))
            # a hit no nearer than the beams are apart is where something meets the wall, and ends it
            return (OCCLUSION if ahead == 1 and predicted - r < apart else FRONTIER), k, k
        else:
            silent = 0
    return FRONTIER, k, k
