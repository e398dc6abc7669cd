"""How long a robot stands and looks before it drives (ours)."""

import math
from collections.abc import Callable

from agent.perception.median_scan import MOST_SCANS
from agent.period import in_ticks

FIRST_LOOK_S = 10.0
"""Seconds that a robot stands and looks before it drives, where odometry errs, or less where it has MOST_SCANS before.
The walls that it sees then hold its heading against wheels of which it knows nothing yet, and its whole map against its
frame: after 3 s, 15 scans, that of a building of 30 m was turned by 0.24 degrees, after 10 s by 0.06."""
HELD_RAD = math.radians(0.05)
"""Standard deviation of its heading by these walls from which on it need not look longer: 9 mm at 10 m. Between rooms
it is 0.02 degrees after 10 s. In `hall`, where it may be 1, worst recalls of 12 teams were 0.50 to 0.95 in four runs
and at least 0.98 in the others. With this they are so in two (0.68, 0.91), at least 0.99 in the others, and runs take
0.93 times as long in the mean."""
LONGER = 4
"""Times as long that it looks at most. Of 24 starts in `hall` headings would be off by 0.32 degrees after 10 s, 0.11
after 20 s and 0.09 after 39 s (rms), as both faces of a column come to be told apart."""


class LookRound:
    """The first look, while it lasts."""

    def __init__(self, rate_hz: float) -> None:
        self._ticks = 0
        self._until = min(in_ticks(FIRST_LOOK_S, rate_hz), MOST_SCANS)
        self._most = LONGER * self._until

    def goes_on(self, knows_little: Callable[[], bool]) -> bool:
        """Whether the robot looks on in this tick. knows_little: whether it should look longer, where it may."""
        self._ticks += 1
        if self._ticks > self._until:
            return False
        if self._ticks == self._until < self._most and knows_little():
            self._until += 1
        return True

    @property
    def scans(self) -> int:
        """How many scans it takes, as far as is known."""
        return self._until
