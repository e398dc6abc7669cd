"""When merged maps are laid over the own one anew (ours)."""

from agent.period import in_ticks

LAY_S = 0.6  # least time from one laying to the next for what is new of own walls: until then the scan shows it
LAY_MORE_S = 0.2
"""More of it for each map beyond two. A map of 490 walls takes 3 ms to lay: ten or more take about 20 ms of each
second."""
LAY_COMPLETE_S = 10.0
"""More of it for a robot that is complete: it goes nowhere, and tells others' news that much later. Towards the end of
a run most of a crowd are, and laid and told maps of hundreds of walls to each other that all of them knew."""


class Laying:
    """What has changed since merged maps were laid last, and when. Merged maps that are new need not wait LAY_S."""

    def __init__(self, rate_hz: float) -> None:
        """rate_hz: ticks a second."""
        self._rate_hz = rate_hz
        self._last = -in_ticks(LAY_S, rate_hz)
        self._own_changed = self._merged_changed = False
        self.merged_anew = False
        """Whether merged maps had changed before the last laying, or which of them there are."""

    @property
    def waits(self) -> bool:
        """Whether there is something new that is not laid yet."""
        return self._own_changed or self._merged_changed

    def take_due(self, tick: int, maps: int, own_changed: bool, merged_changed: bool, rests: bool) -> bool:
        """Whether so many merged maps are to be laid in this tick, and count that as done.

        own_changed, merged_changed: of what there is something new in this tick. rests: whether the robot is complete.
        """
        self._own_changed |= own_changed
        self._merged_changed |= merged_changed
        wait_s = LAY_MORE_S * max(0, maps - 2) + (LAY_COMPLETE_S if rests else 0.0)
        wait_s += 0.0 if self._merged_changed else LAY_S
        if tick - self._last < in_ticks(wait_s, self._rate_hz) or not self.waits:
            return False
        self._last, self.merged_anew = tick, self._merged_changed
        self._own_changed = self._merged_changed = False
        return True
