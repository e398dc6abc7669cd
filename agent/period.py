"""Work that is due every so many ticks, where ticks may be left out, as by a lidar's driver or a slow robot (ours)."""


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
