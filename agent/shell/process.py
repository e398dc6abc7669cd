"""The thin shell around a robot: joins the world, hands the robot what it hears and sees, sends its answers."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import TYPE_CHECKING, NamedTuple, Protocol, Self

import zenoh

from agent.config import AgentConfig
from protocol import keys
from protocol.codec import decode, encode
from protocol.errors import LinkError, ProtocolError, RefusedError
from protocol.messages import PROTOCOL_VERSION, End, Heard, Join, Observation, Refused, RobotSpec, Welcome
from protocol.session import at_once, open_client, wait_for_matching

if TYPE_CHECKING:
    from agent.robot import Step

RECONNECT_S = 2.0
"""How long a robot waits for a world that is gone: one that restarts is found 0.5 s after it is up."""
JOIN_TIMEOUT_S = 10.0
"""How long a robot tries to reach a world: one that starts at the same time is up after 1 to 5 s."""
ANSWER_S = 5.0
"""For the answer to one question; a world that answers later has let in a robot that gave up asking."""
RETRY_S = 0.1
"""Between two questions to a world that does not answer yet."""


class Mind(Protocol):
    """What the shell needs of a robot: agent.robot.Robot."""

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
        """Take one tick."""
        ...


RobotFactory = Callable[[str, RobotSpec, AgentConfig, int], Mind]
"""Makes a robot of its name, its body, its thresholds and its seed, as agent.robot.Robot does."""


class Arrival(NamedTuple):
    """One thing that came in: the last part of a key under robots/ID/in/, or one of Inbox's own words."""

    channel: str
    payload: bytes = b""


class Inbox(SimpleQueue[Arrival]):
    """What came in, in order; safe to fill from callbacks and signal handlers."""

    WORLD, STOP = "world", "stop"
    stopped = False
    world_up = False
    """Whether the world's liveliness token is there."""
    turns = 0
    """How often that has changed: who saw another number has been to another world, or to none."""

    def stop(self) -> None:
        """End the run of this robot at its next tick."""
        self.stopped = True
        self.put(Arrival(self.STOP))

    def hear(self, sample: zenoh.Sample) -> None:
        """Take a sample of robots/ID/in/**."""
        self.put(Arrival(keys.channel_of(str(sample.key_expr)), sample.payload.to_bytes()))

    def watch(self, sample: zenoh.Sample) -> None:
        """Take a change of the world's liveliness token."""
        self.world_up = sample.kind == zenoh.SampleKind.PUT
        self.turns += 1
        self.put(Arrival(self.WORLD))


def run_agent(
    robot: str,
    connect: str,
    config: AgentConfig,
    *,
    secret: str | None = None,
    reconnect_s: float = RECONNECT_S,
    join_timeout_s: float = JOIN_TIMEOUT_S,
    robot_factory: RobotFactory | None = None,
    inbox: Inbox | None = None,
) -> str:
    """Live as `robot` in the world at the endpoint `connect` until its run ends.

    secret: of this robot, where the world asks for one.
    Returns why it ended: `complete`, `time`, `dead`, `interrupted`, or why the world gave this robot up.
    Raises LinkError where no world is found, or it is gone for reconnect_s seconds; RefusedError where it does
    not let the robot in; ProtocolError where what it says makes no sense.
    """
    if robot_factory is None:
        from agent.robot import Robot
        from agent.warmup import rehearse

        rehearse()
        robot_factory = Robot
    inbox = inbox or Inbox()
    with open_client(connect, join_timeout_s, robot, secret) as session:
        # history: the end of a token that was not reported is not reported either
        session.liveliness().declare_subscriber(keys.WORLD_ALIVE, inbox.watch, history=True)
        ended = None
        while ended is None:  # again where the world was gone and is back, as a new run
            joined = join(session, robot, inbox, join_timeout_s)
            if joined is None:
                return "interrupted"
            welcome, turns = joined
            mind = robot_factory(robot, welcome.spec, config, welcome.seed)
            # closed as soon as the world is gone: an old token that is told to the next one would hide the new one
            with Link(session, robot, welcome.lockstep, inbox, join_timeout_s) as link:
                ended = live(mind, link, inbox, turns)
            ended = ended or await_world(inbox, reconnect_s)
    return ended


def join(session: zenoh.Session, robot: str, inbox: Inbox, timeout_s: float) -> tuple[Welcome, int] | None:
    """Ask the world to let `robot` in, again and again for timeout_s seconds; None where the inbox is stopped.

    Returns the answer and the inbox's turns of the world that gave it. Raises RefusedError where the world says no,
    LinkError where it says nothing.
    """
    question = encode(Join(version=PROTOCOL_VERSION, robot=robot, session=str(session.info.zid())))
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if inbox.stopped:
            return None
        turns = inbox.turns
        if not inbox.world_up:
            time.sleep(RETRY_S)
            continue
        for reply in session.get(keys.service(robot, keys.JOIN), payload=question, timeout=ANSWER_S):
            if reply.ok is not None and inbox.turns == turns:  # else nobody knows which world has answered
                return decode(Welcome, reply.ok.payload.to_bytes()), turns
            if reply.err is not None and (refused := _refused(reply.err.payload.to_bytes())):
                raise RefusedError(f"the world does not let {robot} in: {refused.reason}")
        time.sleep(RETRY_S)
    raise LinkError(f"the world does not answer {robot} within {timeout_s:g} s: is it busy, or something else?")


def await_world(inbox: Inbox, timeout_s: float) -> str | None:
    """Wait for a world that is gone, and forget what it said; why the run ended after all, or None.

    Raises LinkError where it is not back in timeout_s seconds.
    """
    deadline = time.monotonic() + timeout_s
    while not (inbox.world_up and inbox.empty()):
        try:
            channel, payload = inbox.get(timeout=max(0.0, deadline - time.monotonic()))
        except Empty:
            raise LinkError(f"the world is gone for {timeout_s:g} s: look at its last words for why") from None
        if channel == keys.END:  # its last word may come after the news of its end
            return decode(End, payload).reason
        if inbox.stopped:
            return "interrupted"
    return None


def _refused(payload: bytes) -> Refused | None:
    try:
        return decode(Refused, payload)
    except ProtocolError:  # zenoh's own words, such as that the time is out
        return None


class Link:
    """A welcomed robot's subscriber, publishers and liveliness token: once entered, the world may begin."""

    def __init__(self, session: zenoh.Session, robot: str, lockstep: bool, inbox: Inbox, timeout_s: float) -> None:
        self.lockstep = lockstep
        self._session, self._robot, self._inbox, self._timeout_s = session, robot, inbox, timeout_s
        self._declared = ExitStack()
        self._publishers: dict[str, zenoh.Publisher] = {}

    def __enter__(self) -> Self:
        """Declare all, the token last and only when nothing said would be lost; LinkError on a time-out."""
        block, drop = zenoh.CongestionControl.BLOCK, zenoh.CongestionControl.DROP
        declare = self._declared.enter_context
        declare(self._session.declare_subscriber(keys.all_in(self._robot), at_once(self._inbox.hear)))
        for channel in keys.OUTPUTS:
            self._publishers[channel] = declare(
                self._session.declare_publisher(
                    keys.from_robot(self._robot, channel),
                    congestion_control=block if self.lockstep else drop,
                    express=True,
                )
            )
        wait_for_matching((self._publishers[channel] for channel in keys.NEEDED), self._timeout_s)
        declare(self._session.liveliness().declare_token(keys.alive(self._robot)))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._declared.close()

    def answer(self, step: Step) -> None:
        """Send all of a tick: what the radio carries, telemetry, and last the action."""
        put = {channel: publisher.put for channel, publisher in self._publishers.items()}
        for send in step.sends:
            put[keys.RADIO](encode(send))
        for channel, report in ((keys.SCAN, step.scan), (keys.POSE, step.pose)):
            if self._publishers[channel].matching_status:
                put[channel](encode(report))
        if step.map is not None:
            put[keys.MAP](encode(step.map))
        put[keys.ACT](encode(step.action))


def live(mind: Mind, link: Link, inbox: Inbox, turns: int) -> str | None:
    """Tick by tick until the run ends; returns why, or None where the world that was joined is gone.

    turns: the inbox's when that world let the robot in. A slow world is waited for without end.
    """
    heard: list[Heard] = []
    while not inbox.stopped:
        channel, payload = inbox.get()
        match channel:
            case keys.RADIO:
                heard.append(decode(Heard, payload))
            case keys.OBS:
                observation = decode(Observation, payload)
                if link.lockstep and observation.heard != len(heard):
                    raise ProtocolError(f"{observation.heard} messages were due at tick {observation.tick}, "
                                        f"{len(heard)} came")  # fmt: skip
                if not link.lockstep and not inbox.empty():
                    continue  # late: a newer scan is there or on its way, what was heard is kept
                link.answer(mind.step(observation, heard))
                heard = []
            case keys.END:
                return decode(End, payload).reason
            case Inbox.WORLD if inbox.turns != turns:
                return None
            case _:
                pass  # the world's token at the start, or a channel of a later version
    return "interrupted"
