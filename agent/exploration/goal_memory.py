"""Goals that were tried, remembered by place and direction, as a map's vertices come and go (ours)."""

import math
from dataclasses import dataclass, field

import numpy as np

from protocol.arrays import Floats, Ints

SAME_PLACE_M = 0.2
"""Goals closer than this are the same one: the end of a wall moves by less from scan to scan."""
SAME_DIRECTION_RAD = 0.8
"""They also go on in directions that differ by less: 45 degrees, as opposite faces and corners differ by 90."""
REMEMBERED = 400
"""Most goals kept in memory; a building of 600 m2 brings about 100."""


@dataclass(slots=True)
class Tried:
    """What became of a goal."""

    x: float
    y: float
    angle: float
    """Direction in which the wall goes on, radians."""
    attempts: int = 0
    blocked: int = 0
    """Times when a teammate was in the way; these are no attempts."""
    version: int = -1
    """Map version at the last attempt."""
    stands: list[tuple[float, float]] = field(default_factory=list)
    """Standing points that did not help."""
    reason: str = ""
    unreachable: bool = False


class GoalMemory:
    """What became of goals; the oldest are forgotten when there are too many."""

    def __init__(self, size: int = REMEMBERED) -> None:
        self.size = size
        self.tried: list[Tried] = []
        self._table = np.zeros((0, 4))

    @property
    def nbytes(self) -> int:
        """Bytes of what is remembered."""
        return sum(48 + 16 * len(record.stands) for record in self.tried)

    def find(self, points: Floats, along: Floats) -> Ints:
        """Per goal (g,) the index of what is remembered of it, or -1; points, along: (g, 2) metres and unit."""
        if not len(self.tried) or not len(points):
            return np.full(len(points), -1)
        d2 = ((points[:, None] - self._table[None, :, :2]) ** 2).sum(2)
        like = along @ self._table[:, 2:].T > math.cos(SAME_DIRECTION_RAD)
        d2 = np.where(like & (d2 < SAME_PLACE_M**2), d2, np.inf)
        best = d2.argmin(1)
        return np.where(np.isfinite(d2[np.arange(len(points)), best]), best, -1)

    def note(self, point: Floats, along: Floats) -> Tried:
        """The record of a goal, a new one if there is none."""
        k = int(self.find(point[None], along[None])[0])
        if k >= 0:
            return self.tried[k]
        if len(self.tried) >= self.size:
            del self.tried[0]
            self._table = self._table[1:]
        record = Tried(float(point[0]), float(point[1]), math.atan2(along[1], along[0]))
        self.tried.append(record)
        self._table = np.vstack((self._table, (*point, *along)))
        return record
