"""From straight runs of beams to the pieces of a corner scan: lines, shared corners, and labels of ends (paper II)."""

import math
from typing import NamedTuple

import numpy as np

from agent.corner_scan import BRIDGE_M, FRONTIER, NOISE_SIGMAS, NOMINAL, OCCLUSION, PIECE
from agent.geometry.lines import MIN_CORNER_SINE, Record, meet
from agent.kernels import kernel
from agent.perception.segmentation import LINE_COST, MIN_HITS, fit
from protocol.arrays import Bools, Floats, Ints, Records

LOOK_PAST = 3  # beams beyond an end that may be asked: the next, and two more where dropouts or strays say nothing
MAX_STRAYS = 2  # stray beams across which a line may go on
STRAY_SIGMAS = 10.0  # standard deviations off its line from which a beam is none of a piece's hits
EDGE_OF_RANGE_SIGMAS = 1.5  # a wall within so many standard deviations of the lidar's range may give no return
MAX_SLACK_M = 0.1  # a corner is at most this far outside its walls' hits, as directions of few hits excuse any place


class Beams(NamedTuple):
    """A full turn of beams."""

    ranges: Floats  # (n,) m, inf where nothing came back
    hidden: Bools  # (n,) those that end on a teammate, or pass it narrowly
    used: Ints  # (m,) indices of those that may show walls, rising
    step: float  # rad, from each to the next
    noise: float  # m, standard deviation of a range
    range_max: float  # m, beyond which nothing comes back
    silence: int  # silent beams in a row that show that a wall is not there: more than dropouts explain


@kernel
def pieces_of(turn: Beams, cuts: Ints, sums: Floats) -> tuple[Records, Bools]:
    """Pieces (p,) of PIECE, and which beams (n,) are explained by one.

    cuts (k, 2) and sums (2 m + 1, 6): as from `segmentation.piecewise`, over the used beams.
    """
    cuts = _split_at_gaps(turn, cuts)
    explained = np.zeros(len(turn.ranges), np.bool_)
    for k in range(len(cuts)):
        for j in range(cuts[k, 0], cuts[k, 1]):
            explained[turn.used[j % len(turn.used)]] = True
    cuts, totals = _join_across_strays(turn, cuts, sums)
    pieces = np.zeros(len(cuts), PIECE)
    for k in range(len(cuts)):
        _fill(pieces[k], turn, cuts[k], totals[k])
    for k in range(len(cuts)):
        _link_corner(pieces, k, turn)
    for k in range(len(cuts)):
        for side in range(2):
            if pieces[k].label[side] != NOMINAL:
                p = pieces[k]
                p.label[side], decided = _predicted_label(turn, p, side, totals[k])
                if p.label[side] == OCCLUSION:  # it may lie anywhere up to the ray that shows its wall's absence
                    p.slack[side] = abs(_on_ray(p, decided * turn.step) - p.end[side])
    return pieces, explained


@kernel
def _split_at_gaps(turn: Beams, cuts: Ints) -> Ints:
    """Cut pieces where neighbouring hits are too far apart on the wall to show that it goes on between them."""
    m, count = len(turn.used), 0
    out = np.empty((m + 1, 2), np.int64)
    for k in range(len(cuts)):
        begin = cuts[k, 0]
        for j in range(cuts[k, 0] + 1, cuts[k, 1] + 1):
            if j < cuts[k, 1]:
                p, q = turn.used[j % m], turn.used[(j - 1) % m]
                bearing = p * turn.step - q * turn.step
                r, s = turn.ranges[p], turn.ranges[q]
                if r * r + s * s - 2 * r * s * math.cos(bearing) <= BRIDGE_M * BRIDGE_M:
                    continue
            if j - begin >= MIN_HITS:
                out[count, 0], out[count, 1] = begin, j
                count += 1
            begin = j
    return out[:count].copy()


@kernel
def _join_across_strays(turn: Beams, cuts: Ints, sums: Floats) -> tuple[Ints, Floats]:
    """Join neighbouring pieces on one line that only a stray or two part; returns pieces and their sums.

    A stray is noise: what stands out farther is a post or the edge of a thin wall, at whose corners the pieces may end.
    """
    out, total, count = np.empty_like(cuts), np.empty((len(cuts), 6)), 0
    for k in range(len(cuts)):
        own = sums[cuts[k, 1]] - sums[cuts[k, 0]]
        if count:
            joint = total[count - 1] + own
            cost = fit(total[count - 1])[2] + fit(own)[2] + LINE_COST
            if fit(joint)[2] < cost and _only_strays(turn, out[count - 1, 1], cuts[k, 0], joint):
                out[count - 1, 1], total[count - 1] = cuts[k, 1], joint
                continue
        out[count], total[count] = cuts[k], own
        count += 1
    return out[:count].copy(), total[:count].copy()


@kernel
def _only_strays(turn: Beams, first: int, end: int, joint: Floats) -> bool:
    """Whether the beams [first, end) between two pieces are few, and off the joint line by no more than noise."""
    m = len(turn.used)
    if end - first > MAX_STRAYS:
        return False
    p, q = turn.used[(first - 1) % m], turn.used[end % m]
    gap = math.hypot(
        turn.ranges[p] * math.cos(p * turn.step) - turn.ranges[q] * math.cos(q * turn.step),
        turn.ranges[p] * math.sin(p * turn.step) - turn.ranges[q] * math.sin(q * turn.step),
    )
    a, b, _ = fit(joint)
    for j in range(first, end):
        beam = turn.used[j % m]
        u = a * math.cos(beam * turn.step) + b * math.sin(beam * turn.step)
        if not abs(turn.ranges[beam] * u - 1.0) < NOISE_SIGMAS * turn.noise * u:
            return False
    return gap <= BRIDGE_M


@kernel
def _fill(piece: Record, turn: Beams, cut: Ints, total: Floats) -> None:
    """Fill a piece with its line and hits. Both ends are frontiers until more is known."""
    n, m = len(turn.ranges), len(turn.used)
    first = turn.used[cut[0] % m] + n * (cut[0] // m)
    last = turn.used[(cut[1] - 1) % m] + n * ((cut[1] - 1) // m)
    a, b, _ = fit(total)
    norm = math.hypot(a, b)
    piece.ux, piece.uy = -b / norm, a / norm
    hits, sum_t, sum_tt, residual = 0.0, 0.0, 0.0, 0.0
    for j in range(cut[0], cut[1]):
        angle, r = turn.used[j % m] * turn.step, turn.ranges[turn.used[j % m]]
        off = (r * (a * math.cos(angle) + b * math.sin(angle)) - 1.0) / norm
        if abs(off) > STRAY_SIGMAS * turn.noise:
            continue  # a stray that the piece was joined across
        t = r * (math.cos(angle) * piece.ux + math.sin(angle) * piece.uy)
        hits += 1.0
        sum_t += t
        sum_tt += t * t
        residual += off * off
    t = sum_t / hits
    piece.hits, piece.spread, piece.residual = hits, max(sum_tt - hits * t * t, 1e-9), residual
    piece.x, piece.y = a / norm**2 + t * piece.ux, b / norm**2 + t * piece.uy
    piece.bearing[0], piece.bearing[1] = first * turn.step, last * turn.step
    for side in range(2):
        piece.end[side] = _on_ray(piece, piece.bearing[side])
        piece.label[side], piece.link[side], piece.slack[side], piece.gap[side] = FRONTIER, -1, 0.0, 0.0


@kernel
def _on_ray(piece: Record, bearing: float) -> float:
    """Where a ray at the bearing meets the piece's line, metres from its centroid; inf where it does not."""
    c, s = math.cos(bearing), math.sin(bearing)
    cross = c * piece.uy - s * piece.ux
    return math.inf if abs(cross) < 1e-6 else -(c * piece.y - s * piece.x) / cross


@kernel
def _link_corner(pieces: Records, k: int, turn: Beams) -> None:
    """Let piece k and the next share a corner if their lines meet between their hits, give or take the noise."""
    count, n = len(pieces), len(turn.ranges)
    after = (k + 1) % count
    p, q = pieces[k], pieces[after]
    begins = round(q.bearing[0] / turn.step) + (n if k + 1 == count else 0)
    last = round(p.bearing[1] / turn.step)
    sine, along_p = meet(p, q)
    if count < 2 or begins - last > LOOK_PAST or abs(sine) < MIN_CORNER_SINE:
        return
    along_q = meet(q, p)[1]
    off_p = NOISE_SIGMAS * turn.noise * math.sqrt(1 / p.hits + along_p**2 / p.spread)
    off_q = NOISE_SIGMAS * turn.noise * math.sqrt(1 / q.hits + along_q**2 / q.spread)
    slack = min(math.hypot(off_p, off_q) / abs(sine), MAX_SLACK_M)
    next_p, next_q = _on_ray(p, begins * turn.step), _on_ray(q, last * turn.step)
    next_p = next_p if next_p > p.end[1] else math.inf  # the ray runs away from the line
    next_q = next_q if next_q < q.end[0] else -math.inf
    if p.end[1] - slack <= along_p <= next_p + slack and next_q - slack <= along_q <= q.end[0] + slack:
        p.label[1], q.label[0] = NOMINAL, NOMINAL
        p.link[1], q.link[0] = after, k
        p.gap[1], q.gap[0] = max(along_p - p.end[1], 0.0), max(q.end[0] - along_q, 0.0)
        p.end[1], q.end[0] = along_p, along_q


@kernel
def _predicted_label(turn: Beams, piece: Record, side: int, sums: Floats) -> tuple[int, int]:
    """Label by prediction of a piece's end that is no corner, and the beam that decided.

    The fitted line is prolonged to the next beam: if that went farther, the wall ends before it; if it hit
    something nearer, or nothing could be seen there, the wall is merely hidden or out of range.
    """
    n, beam = len(turn.ranges), round(piece.bearing[side] / turn.step)
    a, b, _ = fit(sums)
    det = sums[0] * sums[2] - sums[1] * sums[1]
    silent, before = 0, turn.ranges[beam % n]
    for ahead in range(1, LOOK_PAST + 1):
        k = beam + (2 * side - 1) * ahead
        c, s = math.cos(2 * math.pi * k / n), math.sin(2 * math.pi * k / n)
        u = a * c + b * s
        if turn.hidden[k % n] or u <= 1.0 / turn.range_max:
            return FRONTIER, k
        predicted = 1.0 / u
        spread = predicted**2 * math.sqrt((c * c * sums[2] - 2 * c * s * sums[1] + s * s * sums[0]) / det)
        sd = math.hypot(turn.noise, spread)
        r = turn.ranges[k % n]
        if not math.isfinite(r):
            if predicted > turn.range_max - EDGE_OF_RANGE_SIGMAS * sd:
                return FRONTIER, k
            silent += 1
            if silent == turn.silence:
                return OCCLUSION, k
        elif r > predicted + NOISE_SIGMAS * sd:
            return OCCLUSION, k
        elif r < predicted - NOISE_SIGMAS * sd:
            apart = math.sqrt(max(predicted**2 + before**2 - 2 * predicted * before * math.cos(2 * math.pi / n), 0.0))
            # a hit no nearer than the beams are apart is where something meets the wall, and ends it
            return (OCCLUSION if ahead == 1 and predicted - r < apart else FRONTIER), k
    return FRONTIER, k
