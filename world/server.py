"""The shell around an episode over Zenoh: an embedded router, the join, the ticks, and robots that die."""

import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Self

import zenoh

from protocol import keys
from protocol.access import Secrets
from protocol.codec import encode
from protocol.errors import LinkError, ProtocolError
from protocol.inbox import Arrival, Inbox
from protocol.messages import Clock, End, LinkTable, Progress, Refused
from protocol.session import at_once, open_router, wait_for_matching
from world.answers import LockstepAnswers, RealTimeAnswers
from world.config import ServerConfig, WorldConfig
from world.episode import Episode
from world.inbox import WorldInbox
from world.participants import Participants
from world.tick import BadOutputsError, Outputs
from world.wire import Wire

FAREWELL_S = 1.0
"""At the end of a run, robots have this long to go by themselves before the router closes."""
PROGRESS_S = 0.2
"""Clock and progress are published this often, so that a viewer looks alive."""


OnProgress = Callable[[Progress], None]


class Interrupted(Exception):  # noqa: N818
    """Somebody asked the world to stop; no error."""


def serve(
    config: WorldConfig,
    server: ServerConfig,
    out: Path | None,
    *,
    secrets: Secrets | None = None,
    inbox: WorldInbox | None = None,
    listening: Callable[[str], None] = lambda endpoint: None,
    progress: OnProgress = lambda progress: None,
) -> str:
    """Run one episode for robots that join over the network; returns how it ended.

    out: the run directory. secrets: of the robots and viewers that may connect; None lets everybody connect.
    `listening` is told the endpoint once robots may join, `progress` is called some times a second. Raises LinkError
    where the world cannot listen, or robots do not join in time.
    """
    episode = Episode(config, out)
    with (
        open_router(server.listen, secrets) as (session, endpoint),
        Shell(episode, server, session, inbox or WorldInbox(), progress) as shell,
    ):
        listening(endpoint)
        ended = "interrupted"
        try:
            shell.gather(endpoint)
            shell.run()
            ended = episode.ended or ended
        except Interrupted:
            pass
        finally:
            shell.close(ended)
    return ended


class Shell:
    """An episode among its robots' processes."""

    def __init__(
        self, episode: Episode, config: ServerConfig, session: zenoh.Session, inbox: WorldInbox, progress: OnProgress
    ) -> None:
        self.episode, self.config, self.inbox, self.progress = episode, config, inbox, progress
        self._lockstep = config.real_time is None
        self._session, self._declared = session, ExitStack()
        self._participants = Participants(episode.robots, episode.dead)
        self._answers = (LockstepAnswers if self._lockstep else RealTimeAnswers)(episode.robots)
        self._put: dict[tuple[str, str], zenoh.Publisher] = {}
        self._wire = Wire()
        self._began: float | None = None
        """time.monotonic() at the first tick; None before it and after the last one."""
        self._told = 0.0

    def __enter__(self) -> Self:
        """Declare everything, the world's token last."""
        declare, session = self._declared.enter_context, self._session
        congestion = zenoh.CongestionControl.BLOCK if self._lockstep else zenoh.CongestionControl.DROP
        for robot in self.episode.robots:
            for channel in keys.INPUTS:
                key = keys.to_robot(robot, channel)
                publisher = session.declare_publisher(key, congestion_control=congestion, express=True)
                self._put[robot, channel] = declare(publisher)
        self._clock, self._links, self._progress = (
            declare(session.declare_publisher(key)) for key in (keys.CLOCK, keys.LINKS, keys.PROGRESS)
        )
        for channel in keys.NEEDED:
            declare(session.declare_subscriber(keys.from_robot("*", channel), at_once(self.inbox.hear)))
        declare(session.liveliness().declare_subscriber(keys.ALL_ALIVE, self.inbox.watch, history=True))
        declare(session.declare_queryable(keys.ALL_SRV, self.inbox.ask))
        declare(session.liveliness().declare_token(keys.WORLD_ALIVE))
        return self

    def __exit__(self, *_: object) -> None:
        self._declared.close()

    def gather(self, endpoint: str) -> None:
        """Wait until every robot is ready; LinkError names those missing after join_timeout_s."""
        timeout_s = self.config.join_timeout_s
        deadline = time.monotonic() + timeout_s
        while missing := self._participants.missing:
            if not self._take(deadline):
                raise LinkError(
                    f"{', '.join(missing)} did not join within {timeout_s:g} s: start each by "
                    f"`wireswarm agent --id {missing[0]} --connect {endpoint}`"
                )
        wait_for_matching(self._put.values(), timeout_s)
        self._wire.begin(self._ports())
        self._began = time.monotonic()

    def run(self) -> None:
        """Tick by tick, as fast as the robots answer or by the clock, until the episode ends."""
        assert self._began is not None
        self.tell()
        while self.episode.ended is None:
            tick = self.episode.tick
            for robot, inputs in self.episode.inputs().items():
                for heard in inputs.heard:
                    self._say(robot, keys.RADIO, encode(heard))
                self._say(robot, keys.OBS, encode(inputs.observation))
            self.episode.book()
            if self.config.real_time is None:
                self._wait_for_all(time.monotonic() + self.config.silence_s)
            else:
                deadline = self._began + (tick + 1) * self.episode.period_s / self.config.real_time
                while self._take(deadline):
                    pass
            if self.episode.ended is None:
                self._advance({robot: self._answers.take(robot, tick) for robot in self._participants.ready})
            if time.monotonic() - self._told > PROGRESS_S:
                self.tell()

    def tell(self, ended: str | None = None) -> None:
        """Publish clock, link table and progress, and call the callback."""
        self._told = time.monotonic()
        episode = self.episode
        episode.late_ticks = self._answers.late_ticks
        status = {robot: "complete" if done else "exploring" for robot, done in episode.complete.items()}
        status |= dict.fromkeys(episode.dead, "dead")
        clock = Clock(tick=episode.tick, t=episode.t, status=status, ended=ended)
        coverage, team = episode.coverage, episode.team_coverage
        progress = Progress(clock=clock, coverage=coverage, team=team, late_ticks=episode.late_ticks)
        self._clock.put(encode(clock))
        self._links.put(encode(LinkTable(tick=episode.tick, links=episode.links)))
        self._progress.put(encode(progress))
        self.progress(progress)

    def close(self, ended: str) -> None:
        """Write the run directory, tell everybody that the run is over, and give robots a moment to go."""
        episode = self.episode
        if self._began is not None:
            episode.wall_s = time.monotonic() - self._began
        self._began = None
        episode.wire, episode.late_ticks = self._wire.as_dict(), self._answers.late_ticks
        episode.close(ended)
        self.tell(ended)
        for robot in self._participants.ready:
            self._say(robot, keys.END, encode(End(reason=ended)))
        deadline = time.monotonic() + FAREWELL_S
        with suppress(Interrupted):
            while self._participants.ready and self._take(deadline):
                pass

    def _say(self, robot: str, channel: str, payload: bytes) -> None:
        self._wire.told(robot, channel, payload)
        self._put[robot, channel].put(payload)

    def _ports(self) -> dict[str, int]:
        """Port of each robot's end of its link."""
        far_ends = {str(link.zid): str(link.dst).rsplit(":", 1)[-1] for link in self._session.info.links()}
        ports = {robot: far_ends.get(session, "") for robot, session in self._participants.sessions.items()}
        return {robot: int(ports[robot]) for robot in self.episode.robots if ports.get(robot, "").isdigit()}

    def _wait_for_all(self, deadline: float) -> None:
        while due := self._answers.due(self._participants.ready):
            if not self._take(deadline):
                for robot in due:
                    self._kill(robot, f"said nothing for {self.config.silence_s:g} s")

    def _advance(self, outputs: dict[str, Outputs]) -> None:
        while True:
            try:
                return self.episode.advance(outputs)
            except BadOutputsError as error:  # raised before anything changed, so the others' answers still hold
                self._kill(error.robot, str(error))

    def _take(self, deadline: float) -> bool:
        """Act on the next arrival, waiting for it until the deadline; whether there was one."""
        arrival = self.inbox.take(deadline)
        if arrival is None:
            return False
        match arrival.what:
            case _ if arrival.query is not None:  # first, because the question's key is the robot's choice
                self._reply(arrival, arrival.query)
            case Inbox.STOP:
                raise Interrupted
            case WorldInbox.ALIVE:
                self._participants.token_came(arrival.robot)
            case WorldInbox.GONE:
                # a robot that leaves before the first tick may be started again; after the last one it leaves as asked
                if self._participants.token_went(arrival.robot) and self._began is not None:
                    self._kill(arrival.robot, "its process or its link ended")
            case channel if channel in keys.NEEDED and self._began is not None:
                self._hear(arrival.robot, channel, arrival.payload)
        return True

    def _hear(self, robot: str, channel: str, payload: bytes) -> None:
        if not self._participants.is_ready(robot):
            return
        self._wire.heard(robot, payload)
        try:
            self._answers.hear(robot, channel, payload, self.episode.tick)
        except ProtocolError as error:
            self._kill(robot, str(error))

    def _kill(self, robot: str, reason: str) -> None:
        self.episode.kill(robot, reason)
        self._say(robot, keys.END, encode(End(reason=f"given up by the world: {reason}")))

    def _reply(self, arrival: Arrival, query: zenoh.Query) -> None:
        with query:
            refusal = self._participants.admit(arrival.robot, arrival.what, arrival.payload)
            if refusal is not None:
                query.reply_err(encode(Refused(reason=refusal)))
            else:
                welcome = self.episode.welcome(arrival.robot, lockstep=self._lockstep)
                query.reply(query.key_expr, encode(welcome))
