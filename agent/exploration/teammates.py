"""Teammates in the way: seen lately, standing still, as obstacles for paths (ours)."""

import math
from dataclasses import dataclass

import numpy as np

from agent.corner_scan import STILL_M
from agent.exploration.close_walls import blind_m
from agent.exploration.driving import horizon_m
from agent.exploration.planning import NODE_SHARE, circle
from protocol.arrays import Floats
from protocol.messages import RobotSpec

_SAME_M = 0.3  # a teammate seen this near to where one was is the same one, and a fast one also farther
TEAMMATE_STILL_S = 2.0  # a teammate that has not moved for so long is planned around like a wall
MEMORY_S = 3.0  # how long a teammate is planned around after it was seen last
AVOID_S = 10.0
"""A teammate that did not clear the way is planned around for so long after it was seen last: it drives 2 m in the
time."""
ROOM_M = 0.045  # air around a teammate that is planned around: with a tight path's, a little more than driving asks
_SIDES = 8  # corners of the polygon that stands for a teammate; its edges are within 8 % of the disc
_OUTLINE = circle(_SIDES)[np.arange(_SIDES + 1) % _SIDES] / math.cos(math.pi / _SIDES)
"""(n + 1, 2) corners of a polygon around the unit disc, the first one again at the end."""


@dataclass(slots=True)
class Teammate:
    """One teammate, frame of the map."""

    x: float
    y: float
    seen: int  # tick at which it was seen last
    still_x: float
    still_y: float
    still_since: int  # tick since which it has stood there
    avoid_until: int = -1  # tick until which it counts as an obstacle though it may move


class Teammates:
    """Short memory of the teammates seen."""

    def __init__(self, spec: RobotSpec) -> None:
        """spec: of the robot; teammates have the same body."""
        self.radius, self.rate_hz = spec.radius_m, spec.lidar.rate_hz
        self._blind_m = self.radius + blind_m(spec)
        """Metres between centres within which the front of a teammate may be too near to be measured."""
        self._same_m = max(_SAME_M, horizon_m(spec))
        self.known: list[Teammate] = []

    def update(self, tick: int, places: Floats) -> None:
        """Take in where teammates are seen now (k, 2): of two side by side each keeps its own place."""
        memory = MEMORY_S * self.rate_hz
        self.known = [mate for mate in self.known if tick - mate.seen <= memory or tick < mate.avoid_until]
        seen = places.tolist()
        offs = (
            (math.dist((mate.x, mate.y), at), k, m) for k, at in enumerate(seen) for m, mate in enumerate(self.known)
        )
        mates: dict[int, Teammate] = {}
        for _, k, m in sorted(off for off in offs if off[0] <= self._same_m):  # the nearest pair first, each one once
            if self.known[m].seen < tick and k not in mates:
                mates[k], self.known[m].seen = self.known[m], tick
        for k, (x, y) in enumerate(seen):
            if k not in mates:
                self.known.append(Teammate(x, y, tick, x, y, tick))
                continue
            mate = mates[k]
            mate.x, mate.y = x, y
            if math.hypot(mate.still_x - x, mate.still_y - y) > STILL_M:
                mate.still_x, mate.still_y, mate.still_since = x, y, tick

    def too_near_to_see(self, tick: int, x: float, y: float) -> Floats:
        """(k, 2) those that are not seen now, and were last where the lidar of a robot at (x, y) measures nothing.

        In `maze-15` three robots met in a corridor of 1 m. One saw another 0.26 m ahead and not at 0.25 m, drove on,
        and pushed it into a wall.
        """
        places = [(mate.x, mate.y) for mate in self.known if mate.seen < tick]
        return np.array([at for at in places if math.dist(at, (x, y)) <= self._blind_m]).reshape(-1, 2)

    def near(self, x: float, y: float, reach_m: float) -> Teammate | None:
        """The teammate nearest to (x, y), if within reach."""
        mate = min(self.known, key=lambda mate: math.hypot(mate.x - x, mate.y - y), default=None)
        return mate if mate is not None and math.hypot(mate.x - x, mate.y - y) <= reach_m else None

    def avoid(self, mate: Teammate) -> None:
        """Plan around a teammate for a while after it was seen last, as it did not clear the way.

        A column beside a robot in `hall` was once taken for one. Held by it, and by what it no longer measured, the
        robot put that while off for ever and stood for 830 s.
        """
        mate.avoid_until = mate.seen + math.ceil(AVOID_S * self.rate_hz)

    def in_the_way(self, tick: int) -> list[Teammate]:
        """Those that are planned around, as they stand or did not clear the way."""
        still = TEAMMATE_STILL_S * self.rate_hz
        return [mate for mate in self.known if tick - mate.still_since >= still or tick < mate.avoid_until]

    def take(self, tick: int, x: float, y: float, clearance_m: float) -> bool:
        """Whether one that is planned around leaves no room to stand at (x, y) with this clearance."""
        apart_m = self.radius + ROOM_M + clearance_m
        return any(math.hypot(mate.x - x, mate.y - y) < apart_m for mate in self.in_the_way(tick))

    def walls(self, tick: int) -> Floats:
        """(k, 4) outlines of the teammates that are planned around."""
        rings = self._rings(tick, self.radius + ROOM_M)
        return np.concatenate((rings[:, :-1], rings[:, 1:]), 2).reshape(-1, 4)

    def nodes(self, tick: int, clearance_m: float) -> Floats:
        """(j, 2) places where paths that keep the clearance bend around these teammates."""
        return self._rings(tick, self.radius + ROOM_M + NODE_SHARE * clearance_m)[:, :-1].reshape(-1, 2)

    def _rings(self, tick: int, inner_m: float) -> Floats:
        """(k, n, 2) closed polygons around discs of this radius."""
        mates = self.in_the_way(tick)
        if not mates:
            return np.zeros((0, _SIDES + 1, 2))
        return np.array([[(mate.x, mate.y)] for mate in mates]) + inner_m * _OUTLINE
