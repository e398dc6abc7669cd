"""From where robots have looked: what was seen, kept sparsely."""

import math

import numpy as np

from protocol.arrays import Floats

SPACING_M = 0.5
"""Distance between kept places: half of what would leave gaps in a swept corridor 1.9 m to either side."""
MOST_KEPT = 3000
"""Most own places kept (24 bytes each), 1.5 km of path; then every second one is forgotten."""


class Viewpoints:
    """The robot's own places so far, about every half metre, and those of teammates whose maps are merged."""

    def __init__(self) -> None:
        self.own: list[tuple[float, float]] = []
        """Metres, frame of the map."""
        self.ticks: list[int] = []
        """When the robot was there."""
        self.told = np.zeros((0, 2))
        """(k, 2) those of teammates."""

    @property
    def nbytes(self) -> int:
        """Bytes of what is kept."""
        return 24 * len(self.own) + self.told.nbytes

    def keep(self, tick: int, here: Floats, spacing_m: float = SPACING_M) -> bool:
        """Keep the present place (2,) if it is so far from the last one; true if kept."""
        x, y = here.tolist()
        if self.own and math.hypot(self.own[-1][0] - x, self.own[-1][1] - y) < spacing_m:
            return False
        self.own.append((x, y))
        self.ticks.append(tick)
        if len(self.own) > MOST_KEPT:
            del self.own[1::2], self.ticks[1::2]
        return True

    def hear(self, told: Floats) -> int:
        """Take in the teammates' places (k, 2); how many more these are than before."""
        more = len(told) - len(self.told)
        self.told = told
        return more

    def own_places(self) -> Floats:
        """(k, 2) the robot's own."""
        return np.array(self.own).reshape(-1, 2)

    def all(self) -> Floats:
        """(k, 2) own ones and teammates'."""
        return np.vstack((self.own_places(), self.told))
