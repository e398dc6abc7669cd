"""Time in ticks, and work that is due every so many of them, of which a lidar's driver may leave some out (ours)."""


def in_ticks(seconds: float, rate_hz: float) -> int:
    """So many seconds, in ticks of which rate_hz come a second; at least one, however slow the lidar is."""
    return max(1, round(seconds * rate_hz))


HELD_S = 0.5  # who takes no step for longer was held: so long a ROS 2 robot without scans drives on (`ros2.silence_s`)


class WakingTime:
    """Ticks that passed, but for those in which the robot was held: nothing could come of its driving then."""

    def __init__(self, rate_hz: float) -> None:
        self._most, self._ticks = in_ticks(HELD_S, rate_hz), 0
        self._before: int | None = None  # the tick of the last call

    def at(self, tick: int) -> int:
        """How many there were from the first step to the one at a tick. To be asked at each."""
        self._ticks += 0 if self._before is None else min(tick - self._before, self._most)
        self._before = tick
        return self._ticks


class Period:
    """One piece of such work. What was due at a tick that was left out is due at the next one."""

    def __init__(self, ticks: int) -> None:
        self._ticks = ticks
        self._before: int | None = None  # the tick of the last call

    def take_due(self, tick: int) -> bool:
        """Whether it is due at a tick, as a multiple of its ticks has come since the last call; counts that."""
        before = tick - 1 if self._before is None else self._before
        self._before = tick
        return tick // self._ticks > before // self._ticks
