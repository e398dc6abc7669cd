"""A constant error of odometry, measured by each stretch of way between two scans that walls hold (ours)."""

import math

STRETCH_M = 1.0
"""Of way, at least, that is compared at once. Odometry's error grows as the root of the way: steps of 0.1 m err by a
tenth, and more of those that were told too long count as held. Learned from steps, a length's scale came out 0.86 for
0.98."""
LOST_WAY_M = 10.0  # of way without a scan that walls hold, after which a new stretch begins
SIGMAS = 3.0  # of a measurement's error: what differs by more was matched to another wall, or the wheels slipped


class Stretches:
    """The constant as a Gaussian, and the stretch under way; sums along that are those of whoever measures it."""

    def __init__(self, mean: float, sd: float, held_sd: float) -> None:
        """sd: of the constant at first; 0 where it is known. held_sd: up to which walls hold what is measured."""
        self.mean, self._variance, self._held = mean, sd**2, held_sd**2
        self.begin(math.inf)

    @property
    def known(self) -> bool:
        """Whether there is nothing to learn."""
        return self._variance == 0.0

    def begin(self, variance: float) -> None:
        """Begin a stretch at a scan that is held to a variance; infinite where nothing holds it."""
        self._way, self._odometry, self._first = 0.0, 0.0, variance

    def may_end(self, way_m: float, variance: float) -> bool:
        """Take a step, with the variance that odometry has in it; whether the stretch may end after it."""
        self._way += way_m
        self._odometry += variance
        return self._lost or self._way >= STRETCH_M

    def end(self, held: float, off: float, by: float) -> bool:
        """Whether a stretch ends at a scan held to a variance; the constant is learned from it.

        off: what was measured, less what the mean lets expect. by: how much that grows for each unit of the constant.
        """
        if self._lost:
            self.begin(held if held <= self._held else math.inf)
            return True
        if held > self._held:
            return False
        variance = self._odometry + self._first + held + by**2 * self._variance
        if off**2 > SIGMAS**2 * variance:
            self.begin(math.inf)
            return True
        gain = by * self._variance / variance
        self.mean += gain * off
        self._variance -= gain * by * self._variance
        self.begin(held)
        return True

    @property
    def _lost(self) -> bool:
        return math.isinf(self._first) or self._way > LOST_WAY_M
