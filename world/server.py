"""The thin shell around an episode: an embedded router, the join, the ticks, and what happens when a robot dies."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import NamedTuple, Self

import zenoh

from protocol import keys
from protocol.access import Secrets
from protocol.codec import decode, encode
from protocol.errors import LinkError, ProtocolError
from protocol.messages import (
    PROTOCOL_VERSION,
    Action,
    Clock,
    End,
    Event,
    Join,
    LinkTable,
    MapReport,
    Progress,
    Refused,
    Send,
)
from protocol.session import at_once, open_router, wait_for_matching
from world.config import ServerConfig, WorldConfig
from world.episode import BadOutputsError, Episode, Outputs
from world.wire import Wire


class Arrival(NamedTuple):
    """One thing that came in, of one robot: the last part of its key and its bytes, or one of Inbox's words."""

    robot: str
    what: str
    payload: bytes = b""
    query: zenoh.Query | None = None


class Inbox(SimpleQueue[Arrival]):
    """What came in, in order; safe to fill from callbacks and signal handlers, taken by one thread only."""

    ALIVE, GONE, STOP = "token", "no token", "stop"

    def stop(self) -> None:
        """End the episode as interrupted."""
        self.put(Arrival("", self.STOP))

    def hear(self, sample: zenoh.Sample) -> None:
        """Take a sample of what a robot says."""
        key = str(sample.key_expr)
        self.put(Arrival(keys.robot_of(key), keys.channel_of(key), sample.payload.to_bytes()))

    def watch(self, sample: zenoh.Sample) -> None:
        """Take a change of a robot's liveliness token."""
        what = self.ALIVE if sample.kind == zenoh.SampleKind.PUT else self.GONE
        self.put(Arrival(keys.robot_of(str(sample.key_expr)), what))

    def ask(self, query: zenoh.Query) -> None:
        """Take a question on robots/*/srv/**."""
        key = str(query.key_expr)
        payload = query.payload.to_bytes() if query.payload is not None else b""
        self.put(Arrival(keys.robot_of(key), keys.channel_of(key), payload, query))


class Interrupted(Exception):  # noqa: N818
    """Somebody asked the world to stop; no error."""


class Phase(Enum):
    """Where a robot stands."""

    AWAITED = "awaited"
    WELCOMED = "welcomed"
    """Let in, but it may still miss messages."""
    READY = "ready"
    """Its token is there: it reads and is read, so no message is lost."""
    DEAD = "dead"


@dataclass
class Answer:
    """What a robot said since its last action was taken."""

    sends: list[Send] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    map: MapReport | None = None
    action: Action | None = None
    """None until the action came, which is the last of a tick."""


def serve(
    config: WorldConfig,
    server: ServerConfig,
    out: Path | None,
    *,
    secrets: Secrets | None = None,
    inbox: Inbox | None = None,
    listening: Callable[[str], None] = lambda endpoint: None,
    progress: Callable[[Progress], None] = lambda progress: None,
) -> str:
    """Run one episode for robots that join over the network; returns how it ended.

    out: the run directory. secrets: of the robots and viewers that may connect; None: everybody. listening is told
    the endpoint once robots may join; progress is called some times a second. Raises LinkError where the world
    cannot listen, or robots do not join in time.
    """
    episode = Episode(config, out)
    with (
        open_router(server.listen, secrets) as (session, endpoint),
        Shell(episode, server, session, inbox or Inbox(), progress) as shell,
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
        self,
        episode: Episode,
        config: ServerConfig,
        session: zenoh.Session,
        inbox: Inbox,
        progress: Callable[[Progress], None],
    ) -> None:
        self.episode, self.config, self.inbox, self.progress = episode, config, inbox, progress
        self._lockstep = config.real_time is None
        self._session = session
        self._declared = ExitStack()
        self._phase = dict.fromkeys(episode.robots, Phase.AWAITED)
        self._answers = {robot: Answer() for robot in episode.robots}
        self._last: dict[str, Action] = {}
        self._missed: dict[str, int] = dict.fromkeys(episode.robots, 0)
        self._put: dict[tuple[str, str], zenoh.Publisher] = {}
        self._wire = Wire()
        self._sessions: dict[str, str] = {}
        """Zenoh IDs of the robots that joined."""
        self._began: float | None = None
        """Monotonic seconds at the first tick, where ticks go on: all robots are ready, and it has not ended."""
        self._told = 0.0

    def __enter__(self) -> Self:
        """Declare everything, the world's token last."""
        declare, session = self._declared.enter_context, self._session
        congestion = zenoh.CongestionControl.BLOCK if self._lockstep else zenoh.CongestionControl.DROP
        for robot in self.episode.robots:
            for channel in keys.INPUTS:
                self._put[robot, channel] = declare(
                    session.declare_publisher(
                        keys.to_robot(robot, channel), congestion_control=congestion, express=True
                    )
                )
        self._clock = declare(session.declare_publisher(keys.CLOCK))
        self._links = declare(session.declare_publisher(keys.LINKS))
        self._progress = declare(session.declare_publisher(keys.PROGRESS))
        for channel in keys.NEEDED:
            declare(session.declare_subscriber(keys.from_all(channel), at_once(self.inbox.hear)))
        declare(session.liveliness().declare_subscriber(keys.ALL_ALIVE, self.inbox.watch, history=True))
        declare(session.declare_queryable(keys.ALL_SRV, self.inbox.ask))
        declare(session.liveliness().declare_token(keys.WORLD_ALIVE))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._declared.close()

    def gather(self, endpoint: str) -> None:
        """Wait until every robot is ready; LinkError names those missing after join_timeout_s."""
        deadline = time.monotonic() + self.config.join_timeout_s
        while missing := [robot for robot, phase in self._phase.items() if phase != Phase.READY]:
            if not self._take(deadline):
                raise LinkError(
                    f"{', '.join(missing)} did not join within {self.config.join_timeout_s:g} s: start each by "
                    f"`wireswarm agent --id {missing[0]} --connect {endpoint}`"
                )
        wait_for_matching(self._put.values(), self.config.join_timeout_s)
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
                self._wait_until(self._began + (tick + 1) * self.episode.period_s / self.config.real_time)
            if self.episode.ended is None:
                self._advance({robot: self._outputs(robot, tick) for robot in self._ready()})
            if time.monotonic() - self._told > self.config.progress_s:
                self.tell()

    def _say(self, robot: str, channel: str, payload: bytes) -> None:
        self._wire.told(robot, channel, payload)
        self._put[robot, channel].put(payload)

    def _ports(self) -> dict[str, int]:
        """Each robot's end of its link."""
        far_ends = {str(link.zid): str(link.dst).rsplit(":", 1)[-1] for link in self._session.info.links()}
        ports = {robot: far_ends.get(self._sessions.get(robot, ""), "") for robot in self.episode.robots}
        return {robot: int(port) for robot, port in ports.items() if port.isdigit()}

    def tell(self, ended: str | None = None) -> None:
        """Publish clock and progress, and call the callback."""
        self._told = time.monotonic()
        episode = self.episode
        clock = Clock(
            tick=episode.tick,
            t=episode.t,
            status={robot: self._status(robot) for robot in episode.robots},
            ended=ended,
        )
        progress = Progress(
            clock=clock,
            coverage=episode.coverage,
            team=episode.team_coverage,
            late_ticks=episode.late_ticks,
        )
        self._clock.put(encode(clock))
        self._links.put(encode(LinkTable(tick=episode.tick, links=episode.links)))
        self._progress.put(encode(progress))
        self.progress(progress)

    def close(self, ended: str) -> None:
        """Write the run directory, tell everybody that it is over, and give robots a moment to go by themselves."""
        if self._began is not None:
            self.episode.wall_s = time.monotonic() - self._began
        self._began = None
        self.episode.wire = self._wire.as_dict()
        self.episode.close(ended)
        self.tell(ended)
        for robot in self._ready():
            self._say(robot, keys.END, encode(End(reason=ended)))
        deadline = time.monotonic() + self.config.farewell_s
        with suppress(Interrupted):
            while self._ready() and self._take(deadline):
                pass

    def _ready(self) -> list[str]:
        return [robot for robot in self.episode.robots if self._phase[robot] == Phase.READY]

    def _status(self, robot: str) -> str:
        if robot in self.episode.dead:
            return "dead"
        return "complete" if self.episode.complete[robot] else "exploring"

    def _wait_for_all(self, deadline: float) -> None:
        while any(self._answers[robot].action is None for robot in self._ready()):
            if not self._take(deadline):
                for robot in self._ready():
                    if self._answers[robot].action is None:
                        self._kill(robot, f"said nothing for {self.config.silence_s:g} s")

    def _wait_until(self, deadline: float) -> None:
        while self._take(deadline):
            pass

    def _outputs(self, robot: str, tick: int) -> Outputs:
        """What a robot said since the last tick, in real time as if it had been said for this one.

        A robot without an action goes on with its last for one tick, then stands still until it answers.
        """
        answer, self._answers[robot] = self._answers[robot], Answer()
        action = answer.action
        if self._lockstep:
            assert action is not None
            return Outputs(answer.sends, action, answer.map)
        if action is None or action.tick < tick:
            self.episode.late_ticks += 1
        self._missed[robot] = 0 if action is not None else self._missed[robot] + 1
        action = action or self._last.get(robot) or Action(tick=tick, speed_mps=0.0, turn_rps=0.0)
        self._last[robot] = action
        now = {"tick": tick}
        then = {"sent": len(answer.sends), "events": answer.events}
        stop = {"speed_mps": 0.0, "turn_rps": 0.0} if self._missed[robot] > 1 else {}
        return Outputs(
            [send.model_copy(update=now) for send in answer.sends],
            action.model_copy(update=now | then | stop),
            answer.map and answer.map.model_copy(update=now),
        )

    def _advance(self, outputs: dict[str, Outputs]) -> None:
        while True:
            try:
                return self.episode.advance(outputs)
            except BadOutputsError as error:  # raised before anything changed: once more without that robot
                self._kill(error.robot, str(error))

    def _take(self, deadline: float) -> bool:
        """Take one thing that came in, waiting for it until the deadline; whether there was one."""
        try:
            robot, what, payload, query = self.inbox.get(timeout=max(0.0, deadline - time.monotonic()))
        except Empty:
            return False
        if what == Inbox.STOP:
            raise Interrupted
        if query is not None:
            with query:
                self._reply(query, robot, what, payload)
            return True
        phase = self._phase.get(robot)
        if what == Inbox.ALIVE and phase == Phase.WELCOMED:
            self._phase[robot] = Phase.READY
        elif what == Inbox.GONE and phase in (Phase.READY, Phase.WELCOMED):
            if self._began is not None:
                self._kill(robot, "its process or its link ended")
            else:
                self._phase[robot] = Phase.AWAITED  # before, it may be started again; after, it has left as it should
        elif what in keys.NEEDED and phase == Phase.READY and self._began is not None:
            self._wire.heard(robot, payload)
            try:
                self._hear(robot, what, payload)
            except ProtocolError as error:
                self._kill(robot, str(error))
        return True

    def _hear(self, robot: str, channel: str, payload: bytes) -> None:
        answer = self._answers[robot]
        match channel:
            case keys.RADIO:
                answer.sends.append(decode(Send, payload))
            case keys.MAP:
                answer.map = decode(MapReport, payload)
            case keys.ACT:
                answer.action = action = decode(Action, payload)
                answer.events.extend(action.events)
                if self._lockstep and (action.tick, action.sent) != (self.episode.tick, len(answer.sends)):
                    raise ProtocolError(
                        f"an action of tick {action.tick} after {action.sent} messages, "
                        f"where tick {self.episode.tick} and {len(answer.sends)} were due"
                    )

    def _kill(self, robot: str, reason: str) -> None:
        self._phase[robot] = Phase.DEAD
        self.episode.kill(robot, reason)
        self._say(robot, keys.END, encode(End(reason=f"given up by the world: {reason}")))

    def _reply(self, query: zenoh.Query, robot: str, service: str, payload: bytes) -> None:
        join = self._admitted(robot, service, payload)
        if isinstance(join, str):
            query.reply_err(encode(Refused(reason=join)))
            return
        self._sessions[robot] = join.session
        self._phase[robot] = Phase.WELCOMED
        welcome = self.episode.welcome(robot).model_copy(update={"lockstep": self._lockstep})
        query.reply(query.key_expr, encode(welcome))

    def _admitted(self, robot: str, service: str, payload: bytes) -> Join | str:
        """The question of a robot that is welcome, else why it is not."""
        if service != keys.JOIN:
            return f"the world offers no {service!r}"
        try:
            join = decode(Join, payload)
        except ProtocolError as error:
            return str(error)
        if join.version != PROTOCOL_VERSION:
            return f"it speaks version {join.version} of the protocol, the world version {PROTOCOL_VERSION}"
        if join.robot != robot:
            return f"it says that it is {join.robot}"
        match self._phase.get(robot):
            case None:
                return f"no {robot} takes part, only {', '.join(self.episode.robots)}"
            case Phase.WELCOMED if self._sessions[robot] == join.session:
                pass  # it asks again where a world before this one was gone while it asked
            case Phase.WELCOMED | Phase.READY:
                return f"another {robot} is there already"
            case Phase.DEAD:
                return f"it was given up: {self.episode.dead[robot]}"
        return join
