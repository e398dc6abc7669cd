"""Teammates in the way: seen lately, standing still, as obstacles for paths (ours)."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from agent.exploration.config import ExplorationConfig
from agent.geometry.clearance import distances_to_walls
from protocol.arrays import Floats

_SAME_M = 0.3
"""A disc this near to where a teammate was is the same one; it drives 0.05 m a tick."""
_STILL_M = 0.05
"""A teammate that moved less stands."""
_IN_WALL = 0.8
"""A disc nearer to a mapped wall than this share of the radius is the wall's end, taken for a teammate."""
_FIXED_SCANS = 5
"""Scans for which a disc in a wall is remembered; perception hides its beams for four."""
_FRONT = np.linspace(-1.2, 1.2, 5)
"""Bearings in radians of the corners of its front, from the direction of the eye; beyond, it may be narrower."""
_SIDES = 8
"""Corners of the polygon that stands for a teammate; its edges are within 8 % of the disc."""
_ANGLES = np.arange(_SIDES) * (2 * math.pi / _SIDES)
_OUTLINE = np.stack((np.cos(_ANGLES), np.sin(_ANGLES)), 1) / math.cos(math.pi / _SIDES)
"""(n, 2) those of a polygon around the unit disc."""


@dataclass(slots=True)
class Sighting:
    """One teammate, frame of the map."""

    x: float
    y: float
    seen: int
    """Tick of the last sighting."""
    still_x: float
    still_y: float
    still_since: int
    """Tick since which it has stood there."""
    avoid_until: int = -1
    """Tick until which it counts as an obstacle though it may move."""


class Teammates:
    """Short memory of the teammates seen."""

    def __init__(self, config: ExplorationConfig, radius_m: float, tick_s: float) -> None:
        self.config = config
        self.radius = radius_m
        self.tick_s = tick_s
        self.sightings: list[Sighting] = []
        self._fixed: deque[Floats] = deque(maxlen=_FIXED_SCANS)

    def update(self, tick: int, discs: Floats, walls: Floats) -> Floats:
        """Take in discs (k, 2) seen now; returns those of them that can be teammates. walls (m, 4): the map's."""
        if len(discs):
            free = distances_to_walls(np.ascontiguousarray(discs), walls) >= _IN_WALL * self.radius
            self._fixed.append(discs[~free])
            discs = discs[free]
        else:
            self._fixed.append(discs)
        memory = self.config.teammate_memory_s / self.tick_s
        self.sightings = [s for s in self.sightings if tick - s.seen <= memory or tick < s.avoid_until]
        for x, y in discs.tolist():
            known = min(self.sightings, key=lambda s: math.hypot(s.x - x, s.y - y), default=None)
            if known is None or math.hypot(known.x - x, known.y - y) > _SAME_M:
                self.sightings.append(Sighting(x, y, tick, x, y, tick))
                continue
            known.x, known.y, known.seen = x, y, tick
            if math.hypot(known.still_x - x, known.still_y - y) > _STILL_M:
                known.still_x, known.still_y, known.still_since = x, y, tick
        return discs

    def fronts(self, eye: Floats) -> Floats:
        """Walls (k, 4) where discs in walls were hit lately, seen from eye (2,): posts and ends, hidden from the map.

        What perception takes for a teammate is in no wall of the scan, and what stands in a wall is no teammate:
        without these fronts nothing would keep a robot from driving into it.
        """
        if not any(map(len, self._fixed)):
            return np.zeros((0, 4))
        discs = np.vstack(self._fixed)
        towards = np.arctan2(*(eye - discs).T[::-1])
        angles = towards[:, None] + _FRONT
        arcs = discs[:, None] + self.radius * np.stack((np.cos(angles), np.sin(angles)), 2)
        return np.concatenate((arcs[:, :-1], arcs[:, 1:]), 2).reshape(-1, 4)

    def near(self, x: float, y: float, reach_m: float) -> Sighting | None:
        """The teammate nearest to (x, y), if within reach."""
        known = min(self.sightings, key=lambda s: math.hypot(s.x - x, s.y - y), default=None)
        return known if known is not None and math.hypot(known.x - x, known.y - y) <= reach_m else None

    def in_the_way(self, tick: int) -> bool:
        """Whether any teammate is planned around."""
        return any(self._avoided(s, tick) for s in self.sightings)

    def _avoided(self, sighting: Sighting, tick: int) -> bool:
        still = self.config.still_s / self.tick_s
        return tick - sighting.still_since >= still or tick < sighting.avoid_until

    def obstacles(self, tick: int, clearance_m: float) -> tuple[Floats, Floats]:
        """Teammates that stand, or are to be avoided, as walls (k, 4) and path nodes (j, 2) around them."""
        avoided = [s for s in self.sightings if self._avoided(s, tick)]
        if not avoided:
            return np.zeros((0, 4)), np.zeros((0, 2))
        rings = [_ring(s.x, s.y, self.config.teammate_room_m) for s in avoided]
        walls = [np.hstack((ring, np.roll(ring, -1, 0))) for ring in rings]
        nodes = [_ring(s.x, s.y, self.config.teammate_room_m + 1.15 * clearance_m) for s in avoided]
        return np.vstack(walls), np.vstack(nodes)


def _ring(x: float, y: float, inner_m: float) -> Floats:
    """Corners (n, 2) of a polygon around a disc of this radius."""
    return np.array((x, y)) + inner_m * _OUTLINE
