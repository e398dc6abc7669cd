"""Before the first tick: who is there, who is awaited, and who did not come."""

import time
from collections.abc import Callable, Collection

from protocol.errors import LinkError
from world.config import ServerConfig
from world.episode import Episode
from world.shell.pace import SAY_AGAIN_S, Take
from world.shell.participants import Awaited, Participants
from world.shell.presence import Presence

AWAITED_S = 5.0
"""Time between two tellings of who is awaited, where nobody comes."""

OnAwaited = Callable[[Awaited], None]


class Gathering:
    """Waits for the robots with which a run begins, or goes on."""

    def __init__(
        self,
        episode: Episode,
        config: ServerConfig,
        participants: Participants,
        presence: Presence,
        take: Take,
        awaited: OnAwaited,
    ) -> None:
        """awaited: is told who is there as that changes, and every AWAITED_S."""
        self._episode, self._config, self._participants, self._presence = episode, config, participants, presence
        self._take, self._on_awaited = take, awaited
        everybody = len(episode.robots)  # with `settle_s` fewer may have come than begin_with
        self._first = min(config.begin_with or everybody, everybody)
        """How many robots the run begins with."""
        self._came: tuple[list[str], list[str]] = [], []
        """Robots that were ready, and those that were preparing, when `awaited` was told."""
        self._told = time.monotonic()

    def wait(self, endpoint: str) -> None:
        """Wait until as many are ready as the run begins with; LinkError names those missing after join_timeout_s.

        Robots that were let in by then and have their link may still compile their kernels, for silence_s more,
        as one that came in the last moment has to.
        In a run that goes on, those that were there come back by themselves, and are waited for as if they were away.
        Where it had ended, all that is left is to tell them so: they are waited for here, for join_timeout_s at most.
        """
        there = self._participants
        deadline = time.monotonic() + self._config.join_timeout_s
        last = deadline + self._config.silence_s
        while self._episode.ended and self._presence.still_away and self._take(deadline):
            pass
        while not self._presence.here and len(there.ready) < self._first:
            if self._take_and_tell(deadline):
                continue
            if not self._enough_come or time.monotonic() >= last:
                raise LinkError(self._absence(endpoint))
            deadline = time.monotonic() + SAY_AGAIN_S

    @property
    def _enough_come(self) -> bool:
        """Whether the run could begin once those that prepare are ready."""
        there = self._participants
        return len(there.ready) + len(there.preparing) >= self._first

    def _absent(self, preparing: Collection[str]) -> list[str]:
        """Robots that are missing and do not prepare."""
        return [robot for robot in self._participants.missing if robot not in preparing]

    def _absence(self, endpoint: str) -> str:
        """Who did not come, and what to do."""
        preparing = self._participants.preparing
        if self._enough_come:
            waited_s = self._config.join_timeout_s + self._config.silence_s
            late = f"did not become ready within {waited_s:g} s, though let in"
            return f"{', '.join(preparing)} {late}: look at the last words of each"
        absent = self._absent(preparing)
        where = endpoint.replace("/0.0.0.0:", "/HOST:").replace("/[::]:", "/HOST:")
        command = f"wireswarm agent --id {absent[0]} --connect {where}"
        certs = " --certs DIR" if where.startswith("tls/") else ""
        late = f"did not join within {self._config.join_timeout_s:g} s"
        return f"{', '.join(absent)} {late}: start each by `{command}{certs}`"

    def _take_and_tell(self, deadline: float) -> bool:
        """Take the next arrival, as `Take` says, and tell who is there."""
        while not self._take(min(deadline, self._told + AWAITED_S)):
            if time.monotonic() >= deadline:
                return False
            self._tell()
        if (self._participants.ready, self._participants.preparing) != self._came:
            self._tell()
        return True

    def _tell(self) -> None:
        self._told, there = time.monotonic(), self._participants
        ready, preparing = self._came = there.ready, there.preparing
        self._on_awaited(Awaited(ready, preparing, self._absent(preparing), self._first - len(ready)))
