"""The wireframe of the walls of submaps: sure and long enough ones, once each, with corners where ends meet (ours)."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from agent.corner_scan import FRONTIER, NOMINAL
from agent.geometry.chains import chained
from agent.geometry.lines import MIN_CORNER_SINE, meet
from agent.kernels import kernel
from agent.mapping.edges import CONFIRMATIONS, EDGE, WALL
from agent.mapping.submaps.board_tips import with_tips
from agent.mapping.submaps.crossings import CORNER_M, ended
from agent.mapping.submaps.segments import tips_of
from agent.mapping.submaps.smears import lie_across, stand_before, stand_once
from protocol.arrays import Floats, Ints, Labels, Records
from protocol.grid_map import MAX_TOLD
from protocol.wireframe import MAX_VERTICES, Wireframe

SEEN = 2.0  # looks from different places that must have shown a wall: legs and people stand in one
LENGTH_M = 0.17  # shorter ones are the clutter on desks: cluttered offices with them take more than 8 kB
HITS = 1.0  # that a wall of submaps is worth: 1 cm


class Joined(NamedTuple):
    """Walls of a map, longest first, and the faces between them."""

    walls: Records  # (n,) of SEGMENT
    tips: Floats  # (n, 2, 2) tail and head, m
    following: Ints  # (n,) the wall whose tail is this one's head, or -1


def wireframe_of(segments: Records, overrun_m: float, most: int = MAX_VERTICES) -> Wireframe:
    """The map of merged segments (n,) of SEGMENT, in their frame: no scan follows that would put it right.

    overrun_m: how far walls run on past where they end, as of `overrun_of`. most: vertices, as of `_joined`.
    """
    walls = _sure(segments)
    walls = walls[~stand_before(walls) & ~lie_across(walls, overrun_m)]
    walls, tips, following = _joined(_longest_first(ended(walls, overrun_m)), most, with_tips)
    points, labels, edges = chained(tips, _labels(following), following)
    likelihood = (walls["seen"] / (walls["seen"] + 1)).astype(np.float32)
    return Wireframe(points, labels, edges, likelihood, np.ones(len(walls), np.bool_))


def records_of(segments: Records) -> Records:
    """The same as walls (m,) of EDGE for the filter, whose next scans soon outweigh lines that submaps know to 1 cm.

    Its corners follow their lines, so walls whose lines hardly cross have none. The next scans tell where walls end,
    and which are none. There are as many as peers may be told.
    """
    walls, tips, following = _joined(_sure(segments), MAX_TOLD)
    ux, uy = walls["ux"], walls["uy"]
    sine = ux * uy[following] - uy * ux[following]
    following = np.where(np.abs(sine) >= MIN_CORNER_SINE, following, -1)
    out = np.zeros(len(walls), EDGE)
    out["kind"], out["own"], out["hits"], out["tip"] = WALL, 1, HITS, tips
    for name in ("x", "y", "ux", "uy"):
        out[name] = walls[name]
    for name in ("xx", "xy", "yy"):
        out[name] = walls[name] * HITS / walls["hits"]
    out["seen"] = out["due"] = np.minimum(walls["seen"], CONFIRMATIONS)
    out["label"], out["link"], out["link"][:, 1] = _labels(following), -1, following
    heads = np.flatnonzero(following >= 0)
    out["link"][following[heads], 0] = heads
    out["strength"][out["link"] >= 0] = 1.0
    return out


def _sure(segments: Records) -> Records:
    """Those of merged segments (n,) that several looks have shown, each wall once, the longest first."""
    sure = (segments["seen"] >= SEEN) & (segments["high"] - segments["low"] >= LENGTH_M)
    walls = _longest_first(segments[sure])
    return walls[stand_once(walls)]


def _joined(
    walls: Records, most: int, with_faces: Callable[[Records, Floats, Ints], tuple[Records, Floats, Ints]] = Joined
) -> Joined:
    """Walls (n,) of SEGMENT, the longest first, with corners where their ends meet, and the faces that those tell of.

    most: vertices; the shortest walls are left away where there would be more.
    """
    while True:
        tips, following, shown = tips_of(walls), np.full(len(walls), -1), walls
        if len(walls):
            following = _followers(tips)
            shown, tips, following = with_faces(walls, tips, following)
            _meet_at_corners(shown, tips, following)
        too_many = 2 * len(shown) - int((following >= 0).sum()) - most
        if too_many <= 0:
            return Joined(shown, tips, following)
        walls = walls[: len(walls) - max(1, int(0.5 * too_many))]


def _longest_first(walls: Records) -> Records:
    """Walls (n,) by their length."""
    return walls[np.argsort(walls["low"] - walls["high"], kind="stable")]


def _labels(following: Ints) -> Labels:
    """(n, 2) labels of tails and heads."""
    labels = np.full((len(following), 2), FRONTIER, np.uint8)
    labels[following >= 0, 1] = NOMINAL
    labels[following[following >= 0], 0] = NOMINAL
    return labels


@kernel
def _followers(tips: Floats) -> Ints:
    """(n,) the wall whose tail is at each wall's head, each taken once and the nearest pairs first; or -1."""
    n = len(tips)
    following, taken = np.full(n, -1), np.zeros(n, np.bool_)
    rows, columns, apart, count = np.empty(16 * n, np.int64), np.empty(16 * n, np.int64), np.empty(16 * n), 0
    order = np.argsort(tips[:, 0, 0], kind="mergesort")  # tails from left to right
    lefts = tips[:, 0, 0][order]
    for a in range(n):
        x = tips[a, 1, 0]
        for b in order[np.searchsorted(lefts, x - CORNER_M) : np.searchsorted(lefts, x + CORNER_M)]:
            d = math.hypot(x - tips[b, 0, 0], tips[a, 1, 1] - tips[b, 0, 1])
            if a != b and d < CORNER_M and count < len(rows):
                rows[count], columns[count], apart[count] = a, b, d
                count += 1
    for k in np.argsort(apart[:count], kind="mergesort"):
        a, b = rows[k], columns[k]
        if following[a] < 0 and not taken[b]:
            following[a], taken[b] = b, True
    return following


@kernel
def _meet_at_corners(walls: Records, tips: Floats, following: Ints) -> None:
    """Move heads and the tails that follow them to where their lines meet, or between them where that is far off."""
    for a in range(len(walls)):
        b = following[a]
        if b < 0:
            continue
        x, y = 0.5 * (tips[a, 1, 0] + tips[b, 0, 0]), 0.5 * (tips[a, 1, 1] + tips[b, 0, 1])
        sine, t = meet(walls[a], walls[b])
        if sine != 0.0:
            cx, cy = walls[a].x + t * walls[a].ux, walls[a].y + t * walls[a].uy
            if math.hypot(cx - x, cy - y) < CORNER_M:
                x, y = cx, cy
        tips[a, 1, 0], tips[a, 1, 1] = x, y
        tips[b, 0, 0], tips[b, 0, 1] = x, y
