"""When a tick is over: in lockstep once all have answered, in real time by the clock."""

import time
from collections.abc import Callable
from typing import Protocol

from world.episode import Episode
from world.shell.answers import Answers
from world.shell.presence import Presence

SAY_AGAIN_S = 2.0
"""In lockstep a tick is said again to robots whose answer takes longer, as a link that was lost loses messages."""
STALL_S = 1.0
"""In real time a world that is behind its clock by more stood still; what is less it makes up for."""

Take = Callable[[float], bool]
"""Acts on the next arrival, waiting for it until time.monotonic() reaches the deadline; whether there was one."""


class Pace(Protocol):
    """Waits for the end of a tick."""

    def wait(self) -> None:
        """Act on what arrives until this tick is over; those that say nothing for silence_s are dead."""


class LockstepPace:
    """A tick is over when all robots that are here have answered, however long that takes."""

    def __init__(
        self, episode: Episode, presence: Presence, answers: Answers, take: Take, between: Callable[[], None]
    ) -> None:
        """between: what is to be done every SAY_AGAIN_S of a tick that takes longer."""
        self._episode, self._presence, self._answers = episode, presence, answers
        self._take, self._between = take, between

    def wait(self) -> None:
        """Wait for the robots that are here.

        Who comes back is given silence_s once more. Waits are counted, not hours: a freeze of this process or of the
        machine is nobody's silence.
        """
        self._presence.silent.clear()
        end = time.monotonic() + SAY_AGAIN_S
        while due := self._answers.due(self._presence.live, self._episode.tick):
            if time.monotonic() < end and self._take(end):
                continue
            end = time.monotonic() + SAY_AGAIN_S
            self._presence.silent.update(due)
            for robot in due:
                if not self._presence.gave_up(robot, SAY_AGAIN_S):
                    self._presence.say_again(robot)
            self._between()


class RealTimePace:
    """A tick is over when the clock says so, whoever has answered."""

    def __init__(
        self,
        episode: Episode,
        presence: Presence,
        answers: Answers,
        take_until: Callable[[float], None],
        tick_s: float,
        began: float,
    ) -> None:
        """take_until: acts on all that arrives until a time.monotonic(). tick_s: seconds that a tick takes.

        began: time.monotonic() at the first tick.
        """
        self._episode, self._presence, self._answers = episode, presence, answers
        self._take_until, self._tick_s = take_until, tick_s
        self._due = began
        """time.monotonic() at which the tick is over."""

    def wait(self) -> None:
        """Wait for the clock, and count who was silent, then who was late."""
        self._wait_for_clock()
        self._count_silent()
        self._count_late()

    def _wait_for_clock(self) -> None:
        """Where this process stood still, the clock goes on from now, with a whole period: no robot is late by it.

        That is looked at before the wait and after it, when answers may still wait in sockets.
        """
        self._due += self._tick_s
        for _ in range(2):
            now = time.monotonic()
            if now > self._due + STALL_S:
                self._due = now + self._tick_s
            self._take_until(self._due)

    def _count_silent(self) -> None:
        """Count the ticks for which robots said nothing, with their link or without."""
        for robot in self._presence.live:
            if not self._presence.gave_up(robot, self._tick_s):
                self._presence.silent[robot] += 1

    def _count_late(self) -> None:
        """Count the robots that had this tick and have not answered it. That one is away is told as `left`."""
        self._episode.late_ticks += len(self._answers.due(self._presence.on_time, self._episode.tick))
