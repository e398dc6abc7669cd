"""What own scans say of a received map, piece by piece of its walls: found, seen through, or not looked at (ours).

A piece of 10 cm counts once, however many scans show it, as scans are not independent. Pieces that lie on walls of the
own map are not fresh: the alignment has used them, so they count for nothing.
"""

import math

import numpy as np

from agent.geometry.transform import move
from agent.kernels import kernel
from agent.mapping.views import GRAZING, ON, THROUGH, View, look_at
from protocol.arrays import Bools, Floats, Ints
from protocol.walls import directions, lengths, points_along
from protocol.wireframe import Wireframe

PIECE_M = 0.1
"""Length of a piece of wall."""
MAX_PIECES = 20_000
"""Pieces of one map: 2 km of wall. A larger map is cut into longer pieces."""
STRETCH = 32
"""Pieces in a row of which one box tells whether all are out of sight: most walls of a building are."""
ALIKE = 0.94
"""Cosine of 20 degrees: walls whose directions differ by less may be one."""
WALL_MARGIN_M = 0.12
"""A wall within this of where the received map predicts one is the predicted one: 3 sigma of both maps' errors and of
the transform's."""
USED_M = 2.0 * WALL_MARGIN_M
"""A piece of a received map within this of an own wall, in x and in y, is not fresh if their directions are alike."""
SAME_COSINE = 0.9
"""Cosine of 26 degrees: pieces whose directions differ by less are alike."""
MOST_BESIDE = 32
"""Pieces that one is compared with in each column of places, at most: those of ten walls in 10 cm. In a pile of more,
which no building has, the nearest may be missed; compared with all, it would stop the robot for half a second."""


class WallEvidence:
    """The walls of a received map in pieces, in the sender's frame, and what own scans said of each."""

    def __init__(self) -> None:
        self.pieces = np.zeros((0, 4))
        """(k, 4) x, y and unit direction."""
        self.wall = np.zeros(0, np.int64)
        """(k,) index of the edge that each belongs to."""
        self.fresh = np.zeros(0, np.bool_)
        """(k,) whether no alignment has used it."""
        self.on = np.zeros(0, np.int64)
        """(k,) scans that found the wall in its place."""
        self.through = np.zeros(0, np.int64)
        """(k,) scans that saw through it."""
        self._sizes = np.zeros(0)  # (k,) metres, of the walls that the pieces are of
        self._edges = 0
        self._boxes = np.zeros((0, 4))
        self._doubted = False

    def lay(self, wireframe: Wireframe, transform: Floats, own: Wireframe) -> None:
        """Take a newer map of the same sender; what is known of pieces that it still has is kept.

        A piece is the one of the map before that is nearest to it, if it is nearest to that one in turn: so each hands
        on what is known of it once, and no more of a wall is known as it grows. Of the others, as of all after a jump
        by more than PIECE_M, nothing is known, and those on walls of the own map, as it is now, are not fresh.
        transform (3,) takes the sender's frame into the robot's own.
        """
        pieces, wall = pieces_of(wireframe)
        count = len(pieces)
        on, through, fresh = np.zeros(count, np.int64), np.zeros(count, np.int64), np.zeros(count, np.bool_)
        before = _nearest(pieces, np.zeros(3), self.pieces, PIECE_M)
        after = _nearest(self.pieces, np.zeros(3), pieces, PIECE_M)
        known = np.append(after, -1)[before] == np.arange(count)
        same, new = before[known], ~known
        on[known], through[known], fresh[known] = self.on[same], self.through[same], self.fresh[same]
        fresh[new] = _nearest(pieces[new], transform, pieces_of(own)[0], USED_M) < 0
        self.pieces, self.wall, self._edges = pieces, wall, len(wireframe.edges)
        self._sizes = lengths(wireframe.segments())[wall]
        self._boxes, self._doubted = _boxes_of(pieces), True
        self.on, self.through, self.fresh = on, through, fresh

    def look(self, transform: Floats, view: View) -> None:
        """Hold one scan against all pieces; transform (3,) takes the sender's frame into the robot's own."""
        seen_through = _look(
            self.pieces, self._sizes, self._boxes, self.on, self.through, np.asarray(transform, np.float64), view
        )
        self._doubted |= seen_through > 0

    def take_doubt(self) -> bool:
        """Whether a scan has seen through a piece, or a map was laid, since this was last asked."""
        doubted, self._doubted = self._doubted, False
        return doubted

    def said(self, looks: int) -> tuple[float, float]:
        """Metres of fresh wall that at least `looks` own scans confirm, and that at least so many contradict."""
        confirmed, against = _said(self.fresh, self.on, self.through, looks)
        return PIECE_M * confirmed, PIECE_M * against

    def hidden(self, after: int) -> Bools:
        """(edges,) walls that at least `after` own scans have seen through, along a third of the length or more."""
        return np.asarray(_hidden(self.wall, self.on, self.through, self._edges, after))

    def unseen(self) -> Floats:
        """(n, 4) fresh pieces that no scan has said anything of."""
        return np.asarray(self.pieces[self.fresh & (self.on == 0) & (self.through == 0)])


def pieces_of(wireframe: Wireframe) -> tuple[Floats, Ints]:
    """(k, 4) x, y and direction of all pieces of its walls, frame of the map, and (k,) their edges."""
    segments = wireframe.segments()
    length = lengths(segments)
    step = max(PIECE_M, float(length.sum()) / MAX_PIECES)
    count = np.where(length > 1e-6, np.maximum(1, np.round(length / step)), 0).astype(np.int64)
    places, wall = points_along(segments, count)
    return np.column_stack([places, directions(segments)[wall]]), wall


def _nearest(pieces: Floats, transform: Floats, others: Floats, within_m: float) -> Ints:
    """(k,) index of the one of others (m, 4) that is nearest to each piece (k, 4), moved by a transform (3,); -1: none.

    It is within so many metres, in x and in y, and its direction is alike.
    """
    columns = np.floor(others[:, 0] / within_m)
    order = np.lexsort((others[:, 1], columns))
    found = _nearest_by_column(pieces, np.asarray(transform, np.float64), others[order], columns[order], within_m)
    return np.append(order, -1)[found]


@kernel
def _nearest_by_column(pieces: Floats, t: Floats, others: Floats, columns: Floats, within: float) -> Ints:
    """The same with others (m, 4) in order of their columns (m,), which are so wide, and there of y."""
    nearest = np.full(len(pieces), -1, np.int64)
    c, s = math.cos(t[2]), math.sin(t[2])
    for k in range(len(pieces)):
        x, y = move(t, pieces[k, 0], pieces[k, 1])
        ux, uy = c * pieces[k, 2] - s * pieces[k, 3], s * pieces[k, 2] + c * pieces[k, 3]
        least, column = np.inf, math.floor(x / within)
        for beside in range(-1, 2):
            begin = np.searchsorted(columns, column + beside)
            end = np.searchsorted(columns, column + beside + 1)
            first = begin + np.searchsorted(others[begin:end, 1], y - within)
            for j in range(first, min(end, first + MOST_BESIDE)):
                dx, dy = others[j, 0] - x, others[j, 1] - y
                if dy >= within:
                    break
                off = dx * dx + dy * dy
                if off < least and abs(dx) < within and ux * others[j, 2] + uy * others[j, 3] > SAME_COSINE:
                    least, nearest[k] = off, j
    return nearest


@kernel
def _said(fresh: Bools, on: Ints, through: Ints, looks: int) -> tuple[float, float]:
    """How many fresh pieces at least `looks` scans confirm, and contradict."""
    confirmed = against = 0
    for k in range(len(fresh)):
        confirmed += fresh[k] and on[k] >= looks and on[k] > through[k]
        against += fresh[k] and through[k] >= looks and through[k] > on[k]
    return float(confirmed), float(against)


@kernel
def _hidden(wall: Ints, on: Ints, through: Ints, edges: int, after: int) -> Bools:
    """(edges,) of which walls a third of the pieces or more, at least one, is seen through."""
    seen_through, total = np.zeros(edges, np.int64), np.zeros(edges, np.int64)
    for k in range(len(wall)):
        total[wall[k]] += 1
        seen_through[wall[k]] += through[k] >= after and through[k] > on[k]
    return 3 * seen_through >= np.maximum(total, 1)


def _boxes_of(pieces: Floats) -> Floats:
    """(b, 4) least and greatest x, least and greatest y of each stretch of pieces (k, 4)."""
    starts = np.arange(0, len(pieces), STRETCH)
    if not len(starts):
        return np.zeros((0, 4))
    low, high = np.minimum.reduceat(pieces[:, :2], starts), np.maximum.reduceat(pieces[:, :2], starts)
    return np.column_stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]])


@kernel
def _look(walls: Floats, sizes: Floats, boxes: Floats, on: Ints, through: Ints, t: Floats, view: View) -> int:
    """Count what a scan says of pieces (k, 4), of walls (k,) metres long, in boxes (b, 4); how many it sees through.

    What is narrower than two beams are apart may stand between them.
    """
    c, s = math.cos(t[2]), math.sin(t[2])
    beyond, against = 1.000001 * view.sight.reach, 0
    dx, dy = view.pose[0] - t[0], view.pose[1] - t[1]
    eye_x, eye_y = c * dx + s * dy, c * dy - s * dx  # in the sender's frame
    for b in range(len(boxes)):
        box = boxes[b]
        off_x = max(box[0] - eye_x, eye_x - box[1], 0.0)
        off_y = max(box[2] - eye_y, eye_y - box[3], 0.0)
        if off_x * off_x + off_y * off_y > beyond * beyond:
            continue
        for k in range(b * STRETCH, min((b + 1) * STRETCH, len(walls))):
            x, y = t[0] + c * walls[k, 0] - s * walls[k, 1], t[1] + s * walls[k, 0] + c * walls[k, 1]
            dx, dy = view.pose[0] - x, view.pose[1] - y
            away = math.hypot(dx, dy)
            if away > view.sight.reach or 2.0 * view.sight.half_beam * away > sizes[k]:
                continue
            ux, uy = c * walls[k, 2] - s * walls[k, 3], s * walls[k, 2] + c * walls[k, 3]
            side = dy * ux - dx * uy
            if abs(side) < GRAZING * away:
                continue  # the ray may as well pass beside it
            saw, piece = look_at(x, y, view, 0.0)
            if saw == THROUGH:
                through[k] += 1  # from behind, too: a robot is in no solid
                against += 1
            elif saw == ON and side > 0 and view.pieces[piece].ux * ux + view.pieces[piece].uy * uy > ALIKE:
                on[k] += 1
    return against
