"""What the world says on its links, to robots and to viewers, and the count of what goes over them."""

import time
from collections.abc import Callable, Collection, Mapping
from contextlib import ExitStack
from typing import Any

import zenoh

from protocol import keys
from protocol.codec import encode
from protocol.messages import Clock, Progress
from protocol.session import wait_for_matching
from world.episode import Episode
from world.shell.participants import Participants
from world.shell.showing import Showing
from world.shell.wire import Wire
from world.tick import Inputs

PROGRESS_S = 0.2
"""Time between two publications of clock and progress, so that a viewer looks alive."""

OnProgress = Callable[[Progress], None]


def linked(session: zenoh.Session) -> dict[str, str]:
    """Address of the far end of each link by its Zenoh ID, as Zenoh writes both."""
    return {str(link.zid): str(link.dst) for link in session.info.links()}


class Voice:
    """The world's publishers."""

    def __init__(
        self, episode: Episode, participants: Participants, session: zenoh.Session, progress: OnProgress
    ) -> None:
        """Nothing is declared yet."""
        self._episode, self._participants = episode, participants
        self._session, self._on_progress = session, progress
        self._put: dict[tuple[str, str], zenoh.Publisher] = {}
        self._wire = Wire()
        self._told = 0.0

    def declare(self, declared: ExitStack, *, lockstep: bool) -> None:
        """Declare all publishers; those to robots drop nothing in lockstep. declared: what closes them."""
        session = self._session
        congestion = zenoh.CongestionControl.BLOCK if lockstep else zenoh.CongestionControl.DROP
        for robot in self._episode.robots:
            for channel in keys.INPUTS:
                key = keys.to_robot(robot, channel)
                publisher = session.declare_publisher(key, congestion_control=congestion, express=True)
                self._put[robot, channel] = declared.enter_context(publisher)
        self._clock, self._links, self._progress = (
            declared.enter_context(session.declare_publisher(key)) for key in (keys.CLOCK, keys.LINKS, keys.PROGRESS)
        )
        self._showing = Showing(self._episode, session, declared)

    def wait_for_readers(self, robots: Collection[str], timeout_s: float, stopped: Callable[[], bool]) -> None:
        """Wait until these robots read what they are told; raises as `wait_for_matching` does."""
        wait_for_matching([put for (robot, _), put in self._put.items() if robot in robots], timeout_s, stopped)

    def say(self, robot: str, channel: str, payload: bytes) -> None:
        """Say something to a robot."""
        if self._participants.is_ready(robot):  # else nobody reads it, and Zenoh sends it nowhere
            self._wire.told(robot, channel, payload)
        self._put[robot, channel].put(payload)

    def say_tick(self, robot: str, inputs: Inputs) -> None:
        """Say to a robot what it hears and observes at this tick."""
        for heard in inputs.heard:
            self.say(robot, keys.RADIO, encode(heard))
        self.say(robot, keys.OBS, encode(inputs.observation))

    def show(self, inputs: Mapping[str, Inputs]) -> None:
        """Show a tick to viewers, as `Showing` does."""
        self._showing.show(inputs)

    @property
    def is_due(self) -> bool:
        """Whether it is time to `tell` again."""
        return time.monotonic() - self._told > PROGRESS_S

    def tell(self, ended: str | None = None) -> None:
        """Publish clock, link table and progress, and call the callback. ended: how the run ended."""
        self._told = time.monotonic()
        episode = self._episode
        status = {robot: "complete" if done else "exploring" for robot, done in episode.complete.items()}
        status |= dict.fromkeys(self._participants.missing, "away") | dict.fromkeys(episode.dead, "dead")
        clock = Clock(tick=episode.tick, t=episode.t, status=status, ended=ended)
        coverage, team = episode.coverage, episode.team_coverage
        progress = Progress(clock=clock, coverage=coverage, team=team, late_ticks=episode.late_ticks)
        self._clock.put(encode(clock))
        self._links.put(encode(episode.links))
        self._progress.put(encode(progress))
        self._on_progress(progress)

    def heard(self, robot: str, payload: bytes) -> None:
        """Count what came from a robot."""
        self._wire.heard(robot, payload)

    def follow(self) -> None:
        """Count from now on what the links of robots carry that were let in."""
        links, sessions = linked(self._session), self._participants.sessions
        self._wire.follow(
            {robot: links[sessions[robot]] for robot in self._episode.robots if sessions.get(robot) in links}
        )

    def close(self) -> dict[str, Any] | None:
        """End the count; returns it as `Wire.close` does."""
        return self._wire.close()
