"""People who walk about: the lidar sees their legs or coats, and they touch nobody.

Each walks straight to a place in view, may stand there for a while, and goes on. Who would come too near to a robot or
to another stops, and after a moment goes elsewhere. Sizes and speeds are those of adults indoors (ours).
"""

import math
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon

from protocol.arrays import Floats
from world.checkpoint import State, restore_array, restore_rng, rng_state
from world.worldfile import World, WorldFileError

LEG_M, COAT_M = 0.06, 0.2
"""Radius of a leg at the height of a lidar, and of a long coat; every second person wears one."""
APART_M, STEP_M = 0.2, 0.25
"""Distance between the middles of two standing legs, and how far a leg gets ahead of and behind the body in a step."""
STRIDE_M = 4 * STEP_M
"""Way of two steps."""
ROOM_M = 0.4
"""The middle of a body stays this far from walls; its legs reach 0.33 m."""
GAP_M = 0.6
"""Nobody goes nearer than this to the middle of another: their bodies are 0.2 m apart then. From a robot that is wider
than a coat all stay as much farther away."""
SPEEDS_MPS, WAYS_M, REST_S = (0.4, 1.2), (0.5, 8.0), 5.0
"""Bounds of a walk's speed and length, and of the rest after it."""
PATIENCE_S = 1.0
"""Whoever is stopped for this long goes elsewhere."""
TRIES = 30
"""Ways that are drawn until one is free; else the person stands for a tick."""


class People:
    """The people of one run."""

    def __init__(
        self, count: int, world: World, robots: Floats, radius_m: float, period_s: float, rng: np.random.Generator
    ) -> None:
        """`robots` are their start poses (k, 3); people stand where these can get, in places drawn from rng.

        Raises WorldFileError where there is no room.
        """
        self._period_s, self._rng = period_s, rng
        self._robot_gap_m = GAP_M + max(0.0, radius_m - COAT_M)
        self._homes: list[Polygon] = []
        self.places = np.zeros((count, 2))
        """(m, 2) where they are, in the world."""
        self._before = self.places
        self._heading, self._walked, self._walked_before = np.zeros((3, count))
        self._target, self._speed, self._rest, self._stopped = np.zeros((count, 2)), *np.zeros((3, count))
        for person in range(count):
            self._homes.append(self._enter(person, world, robots[:, :2], radius_m))
        self._before, self._target = self.places.copy(), self.places.copy()

    def advance(self, robots: Floats) -> None:
        """Walk for one period, among robots at (k, 2)."""
        self._before, self._walked_before = self.places.copy(), self._walked.copy()
        for person in range(len(self.places)):
            others = np.vstack([robots, np.delete(self.places, person, 0)])
            self._step(person, others, self._gaps(len(robots), len(others)))

    def bodies(self, steps: int) -> Floats:
        """(steps, d, 3) x, y, radius of legs and coats at equal steps of the last period (`world.way`)."""
        if not len(self.places):
            return np.zeros((steps, 0, 3))
        share = np.linspace(1, 0, steps)[::-1, None]  # of one step, the end
        walked = self._walked_before + share * (self._walked - self._walked_before)
        middle = self._before + share[..., None] * (self.places - self._before)
        ahead = np.stack([np.cos(self._heading), np.sin(self._heading)], -1)
        aside = np.stack([-ahead[:, 1], ahead[:, 0]], -1)
        swing = STEP_M * np.sin(walked * (2 * math.pi / STRIDE_M))[..., None] * ahead
        coats = np.arange(len(self.places)) % 2 == 1
        parts = [_discs(middle[:, coats], COAT_M)]
        for side in (1, -1):
            legs = middle + side * (swing + APART_M / 2 * aside)
            parts.append(_discs(legs[:, ~coats], LEG_M))
        return np.concatenate(parts, 1)

    def state(self) -> State:
        """For a checkpoint."""
        return {"rng": rng_state(self._rng)} | {name: part.tobytes() for name, part in self._parts().items()}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        for name, part in self._parts().items():
            restore_array(part, state[name])
        restore_rng(self._rng, state["rng"])

    def _parts(self) -> dict[str, NDArray[Any]]:
        names = ("places", "_before", "_heading", "_walked", "_walked_before", "_target", "_speed", "_rest", "_stopped")
        return {name: getattr(self, name) for name in names}

    def _gaps(self, robots: int, others: int) -> Floats:
        """(others,) m, how far to stay away from others, of whom so many are robots and the first."""
        return np.repeat([self._robot_gap_m, GAP_M], [robots, others - robots])

    def _enter(self, person: int, world: World, robots: Floats, radius_m: float) -> Polygon:
        """Draw a place, and return the region in which the person can walk."""
        x, y = robots[0].tolist()
        there = world.region_of(x, y, radius_m)
        regions = [region for region in world.regions(ROOM_M) if there is not None and region.intersects(there)]
        others = np.vstack([robots, self.places[:person]])
        gaps, area = self._gaps(len(robots), len(others)), shapely.union_all(regions)
        for _ in range(100 * TRIES if regions else 0):
            place = self._rng.uniform(area.bounds[:2], area.bounds[2:])
            if shapely.contains_xy(area, *place) and (np.hypot(*(others - place).T) > gaps).all():
                self.places[person] = place
                return next(region for region in regions if shapely.contains_xy(region, *place))
        raise WorldFileError(f"{world.source}: no room for {len(self.places)} people beside the robots")

    def _step(self, person: int, others: Floats, gaps: Floats) -> None:
        """Move one person for a period, unless it rests or would come nearer to others (n, 2) than gaps (n,)."""
        self._rest[person] -= self._period_s
        here, way = self.places[person], self._target[person] - self.places[person]
        left = math.hypot(*way)
        close = np.hypot(*(others - here).T) < gaps + SPEEDS_MPS[1] * self._period_s
        near = others[close] - here
        arrived = left < 1e-9
        move = way * min(1.0, self._speed[person] * self._period_s / max(left, 1e-9))
        closer = np.hypot(*(near - move).T) < np.minimum(np.hypot(*near.T), gaps[close])
        in_the_way = len(near) > 0 if arrived else bool(closer.any())
        self._stopped[person] = self._stopped[person] + self._period_s if in_the_way else 0.0
        if self._stopped[person] > PATIENCE_S or (arrived and self._rest[person] <= 0):
            self._choose(person, near)
        elif not arrived and not in_the_way:
            self.places[person] = here + move
            self._walked[person] += math.hypot(*move)
            if math.hypot(*move) >= left:
                self._rest[person] = self._rng.uniform(0, REST_S)

    def _choose(self, person: int, near: Floats) -> None:
        """Draw a new way, free of walls and away from who is near: (n, 2), from here."""
        here = self.places[person]
        for _ in range(TRIES):
            angle, length = self._rng.uniform(-math.pi, math.pi), self._rng.uniform(*WAYS_M)
            ahead = np.array([math.cos(angle), math.sin(angle)])
            if (near @ ahead > 0).any():
                continue
            target = here + length * ahead
            if self._homes[person].covers(shapely.LineString([here, target])):
                self._target[person], self._heading[person] = target, angle
                self._speed[person], self._stopped[person] = self._rng.uniform(*SPEEDS_MPS), 0.0
                return


def _discs(places: Floats, radius_m: float) -> Floats:
    """(s, d, 3) of places (s, d, 2)."""
    return np.concatenate([places, np.full((*places.shape[:2], 1), radius_m)], 2)
