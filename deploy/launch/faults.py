"""A fault schedule: robots whose process is killed at a tick, before they answer it, and started again."""

from __future__ import annotations

import os
import signal
from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING

from agent.shell.mind import MakeMind, Mind
from protocol.messages import Heard, Observation, RobotSpec

if TYPE_CHECKING:
    from agent.config import AgentConfig
    from agent.robot import Step
    from agent.state import State


def schedule(robots: Iterable[str], faults: Iterable[str]) -> dict[str, set[int]]:
    """Ticks at which each of the robots is killed, from settings such as r2@100."""
    ticks: dict[str, set[int]] = {robot: set() for robot in robots}
    for fault in faults:
        robot, _, tick = fault.partition("@")
        ticks[robot].add(int(tick))
    return ticks


def doomed(ticks: Collection[int], make_mind: MakeMind | None) -> MakeMind | None:
    """Makes minds that kill their process at these ticks; `make_mind` where there are none."""
    if not ticks:
        return make_mind

    def make(robot: str, spec: RobotSpec, config: AgentConfig, seed: int) -> Mind:
        from agent.robot import Robot

        return Doomed((make_mind or Robot)(robot, spec, config, seed), ticks)

    return make


class Doomed:
    """A mind that kills its process at some ticks, but not at its first one, which is that of its return.

    In real time a late robot skips ticks: it dies at the first one that it steps at from a tick of the schedule on.
    """

    def __init__(self, mind: Mind, ticks: Collection[int]) -> None:
        self._mind, self._ticks = mind, ticks
        self._stepped: int | None = None
        """The tick of its last step."""

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
        """As its mind."""
        now = observation.tick
        if self._stepped is not None and any(self._stepped < tick <= now for tick in self._ticks):
            os.kill(os.getpid(), signal.SIGKILL)
        self._stepped = now
        return self._mind.step(observation, heard)

    def state(self) -> State:
        """As its mind; of one that cannot be kept nothing."""
        from agent.shell.checkpoint import Keeps

        return self._mind.state() if isinstance(self._mind, Keeps) else {}

    def restore(self, state: State) -> None:
        """As its mind."""
        from agent.shell.checkpoint import Keeps

        if isinstance(self._mind, Keeps):
            self._mind.restore(state)
