"""Time in ticks, and work that is due every so many of them, of which a lidar's driver may leave some out (ours)."""


def in_ticks(seconds: float, rate_hz: float) -> int:
    """So many seconds, in ticks of which rate_hz come a second; at least one, however slow the lidar is."""
    return max(1, round(seconds * rate_hz))


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
