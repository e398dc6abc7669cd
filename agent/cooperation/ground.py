"""What own scans say of a received map, piece by piece of its walls: as predicted, not there, or not looked at (ours).

Each piece of 10 cm counts once, however often it is seen, as scans are not independent. Pieces that the alignment
has already used are not fresh and count for nothing.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agent.corner_scan import CornerScan, Sight
from agent.geometry.transform import move
from agent.kernels import kernel
from agent.mapping.contradiction import GRAZING, ON, THROUGH, ViewRules, look_at
from agent.mapping.scan_merge import to_map_frame
from protocol.arrays import Bools, Floats, Ints
from protocol.geometry import Pose
from protocol.wireframe import Wireframe

PIECE_M = 0.1
"""Length of a piece of ground (facts/alignment.md)."""
MAX_PIECES = 20_000
"""Of one map: 2 km of wall."""
ALIKE = 0.94
"""Cosine of 20 degrees: walls that differ by less in direction may be one."""


class Ground:
    """The walls of a received map in pieces, in the sender's frame, and what own scans said of each."""

    def __init__(self) -> None:
        self.pieces = np.zeros((0, 4))
        """(k, 4) x, y and unit direction."""
        self.wall = np.zeros(0, np.int64)
        """(k,) index of the edge that each belongs to."""
        self.fresh = np.zeros(0, np.bool_)
        self.on = np.zeros(0, np.int64)
        """(k,) scans that found the wall in its place."""
        self.through = np.zeros(0, np.int64)
        """(k,) scans that saw through it."""
        self._keys = np.zeros(0, np.int64)

    def lay(self, wireframe: Wireframe, fresh: Bools | None = None) -> None:
        """Take a newer map of the same sender; what is known of pieces that it still has is kept.

        fresh: (k,) for the pieces of `pieces_of`; None: new ones are.
        """
        pieces, wall = pieces_of(wireframe)
        keys = _keys(pieces)
        order = np.argsort(self._keys, kind="stable")
        on, through, was_fresh = np.zeros(len(keys), np.int64), np.zeros(len(keys), np.int64), np.ones(len(keys), bool)
        if len(order):
            at = np.minimum(np.searchsorted(self._keys, keys, sorter=order), len(order) - 1)
            known = self._keys[order[at]] == keys
            on[known], through[known] = self.on[order[at[known]]], self.through[order[at[known]]]
            was_fresh[known] = self.fresh[order[at[known]]]
        self.pieces, self.wall, self._keys = pieces, wall, keys
        self.on, self.through = on, through
        self.fresh = was_fresh if fresh is None else fresh

    def look(self, transform: Floats, pose: Pose, scan: CornerScan, rules: ViewRules) -> None:
        """Hold one scan against all pieces; transform (3,) takes the sender's frame into the robot's."""
        _look(
            self.pieces,
            self.on,
            self.through,
            np.asarray(transform, np.float64),
            pose,
            scan.pieces,
            to_map_frame(scan.pieces, pose),
            scan.sight,
            rules,
        )

    def said(self, looks: int) -> tuple[float, float]:
        """Metres of fresh wall that own scans confirm, and that they contradict, each by so many scans."""
        confirmed = (self.on >= looks) & (self.on > self.through)
        against = (self.through >= looks) & (self.through > self.on)
        return PIECE_M * float((confirmed & self.fresh).sum()), PIECE_M * float((against & self.fresh).sum())

    def hidden(self, after: int, edges: int) -> Bools:
        """(edges,) walls that own scans have seen through along a third of their length or more."""
        seen_through = (self.through >= after) & (self.through > self.on)
        total = np.bincount(self.wall, minlength=edges)
        return np.asarray(3 * np.bincount(self.wall[seen_through], minlength=edges) >= np.maximum(total, 1))

    def unseen(self) -> Floats:
        """(n, 4) fresh pieces that no scan has said anything of."""
        left: Floats = self.pieces[self.fresh & (self.on == 0) & (self.through == 0)]
        return left


def pieces_of(wireframe: Wireframe) -> tuple[Floats, Ints]:
    """(k, 4) x, y and direction of all pieces of its walls, frame of the map, and (k,) their edges."""
    segments = wireframe.segments()
    along = segments[:, 2:] - segments[:, :2]
    length = np.hypot(along[:, 0], along[:, 1])
    step = max(PIECE_M, float(length.sum()) / MAX_PIECES)
    count = np.where(length > 1e-6, np.maximum(1, np.round(length / step)), 0).astype(np.int64)
    wall = np.repeat(np.arange(len(count)), count)
    share = (np.arange(len(wall)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[wall]
    places = segments[wall, :2] + share[:, None] * along[wall]
    return np.column_stack([places, (along / np.maximum(length, 1e-9)[:, None])[wall]]), wall


def _keys(pieces: Floats) -> Ints:
    """(k,) of cells of 10 cm and quarter turns, so that a piece is known again in a newer map."""
    x, y = (np.round(pieces[:, k] / PIECE_M).astype(np.int64) + (1 << 20) for k in (0, 1))
    quarter = np.round(np.arctan2(pieces[:, 3], pieces[:, 2]) / (math.pi / 2)).astype(np.int64) % 4
    keys: Ints = (x << 24) + (y << 2) + quarter
    return keys


@kernel
def _look(
    walls: Floats,
    on: Ints,
    through: Ints,
    t: Floats,
    pose: Pose,
    raw: NDArray[np.void],
    seen: NDArray[np.void],
    sight: Sight,
    rules: ViewRules,
) -> None:
    c, s = math.cos(t[2]), math.sin(t[2])
    for k in range(walls.shape[0]):
        x, y = move(t, walls[k, 0], walls[k, 1])
        dx, dy = pose[0] - x, pose[1] - y
        away = math.hypot(dx, dy)
        if away > sight.reach:
            continue
        ux, uy = c * walls[k, 2] - s * walls[k, 3], s * walls[k, 2] + c * walls[k, 3]
        side = dy * ux - dx * uy
        if abs(side) < GRAZING * away:
            continue  # the ray may as well pass beside it
        saw, piece = look_at(x, y, pose, raw, seen, sight, rules)
        if saw == THROUGH:
            through[k] += 1  # from behind, too: a robot is in no solid
        elif saw == ON and side > 0 and seen[piece].ux * ux + seen[piece].uy * uy > ALIKE:
            on[k] += 1


@kernel
def sees_place(
    x: float,
    y: float,
    radius: float,
    pose: Pose,
    raw: NDArray[np.void],
    seen: NDArray[np.void],
    sight: Sight,
    rules: ViewRules,
) -> bool:
    """Whether a scan sees through the middle and both sides of a disc at (x, y): nothing stands there."""
    dx, dy = x - pose[0], y - pose[1]
    away = max(math.hypot(dx, dy), 1e-6)
    for off in (-0.7 * radius, 0.0, 0.7 * radius):
        saw, _ = look_at(x - dy / away * off, y + dx / away * off, pose, raw, seen, sight, rules)
        if saw != THROUGH:
            return False
    return True
