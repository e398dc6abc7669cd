"""The shell around a robot over Zenoh: join the world, hand its messages to the mind, publish the mind's answers."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING

import zenoh

from agent.config import AgentConfig, JoinConfig
from agent.shell.mind import MakeMind, Mind
from protocol import keys
from protocol.codec import decode, encode
from protocol.errors import LinkError, ProtocolError, RefusedError
from protocol.inbox import Arrival, Inbox
from protocol.messages import PROTOCOL_VERSION, End, Heard, Join, Observation, Refused, Welcome
from protocol.session import at_once, open_client, wait_for_matching

if TYPE_CHECKING:
    from agent.robot import Step

ANSWER_S = 5.0
"""A robot asks again where the world has not answered its question by then."""
RETRY_S = 0.1
"""Pause between two questions to a world that does not answer yet."""


class AgentInbox(Inbox):
    """What comes to one robot: samples of robots/ID/in/**, and changes of the world's liveliness token."""

    WORLD = "world"
    world_up = False
    """Whether the world's liveliness token is there."""
    world_changes = 0
    """How often that has changed. Where it changed since a question was asked, nobody knows which world answered."""

    def watch(self, sample: zenoh.Sample) -> None:
        """Take a change of the world's liveliness token."""
        self.world_up = sample.kind == zenoh.SampleKind.PUT
        self.world_changes += 1
        self.put(Arrival(self.WORLD))


def run_agent(
    robot: str,
    connect: str,
    config: AgentConfig,
    *,
    secret: str | None = None,
    patience: JoinConfig | None = None,
    make_mind: MakeMind | None = None,
    inbox: AgentInbox | None = None,
) -> str:
    """Live as `robot` in the world at the endpoint `connect` until its run ends.

    secret: of this robot, where the world asks for one. patience: how long to look for a world.
    Returns why the run ended: `complete`, `time`, `dead`, `interrupted`, or why the world gave this robot up.
    Raises LinkError where no world is found or it does not come back in time, RefusedError where the world does not
    let the robot in, ProtocolError where the world's messages make no sense.
    """
    if make_mind is None:
        from agent.robot import Robot
        from agent.warmup import rehearse

        rehearse()
        make_mind = Robot
    patience, inbox = patience or JoinConfig(), inbox or AgentInbox()
    with open_client(connect, patience.join_timeout_s, robot, secret) as session:
        # with history: Zenoh reports the end of a token only to those to whom it reported the token
        session.liveliness().declare_subscriber(keys.WORLD_ALIVE, inbox.watch, history=True)
        ended = None
        while ended is None:  # a world that was gone and is back begins a new run
            joined = join(session, robot, inbox, patience.join_timeout_s)
            if joined is None:
                return "interrupted"
            welcome, changes = joined
            mind = make_mind(robot, welcome.spec, config, welcome.seed)
            # left as soon as the world is gone: Zenoh would tell the next world of the old token and hide the new one
            with declared(session, robot, welcome.lockstep, inbox, patience.join_timeout_s) as publishers:
                ended = live(mind, publishers, welcome.lockstep, inbox, changes)
            ended = ended or await_world(inbox, patience.reconnect_s)
    return ended


def join(session: zenoh.Session, robot: str, inbox: AgentInbox, timeout_s: float) -> tuple[Welcome, int] | None:
    """Ask the world to let `robot` in, again and again for timeout_s seconds; None where the inbox is stopped.

    Returns the answer, and the inbox's `world_changes` when it came. Raises RefusedError where the world says no,
    LinkError where it does not answer.
    """
    question = encode(Join(version=PROTOCOL_VERSION, robot=robot, session=str(session.info.zid())))
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if inbox.stopped:
            return None
        changes = inbox.world_changes
        if not inbox.world_up:
            time.sleep(RETRY_S)
            continue
        for reply in session.get(keys.service(robot, keys.JOIN), payload=question, timeout=ANSWER_S):
            if reply.ok is not None and inbox.world_changes == changes:
                return decode(Welcome, reply.ok.payload.to_bytes()), changes
            if reply.err is not None:
                with suppress(ProtocolError):  # an error of Zenoh itself, such as a time-out, is no answer
                    refused = decode(Refused, reply.err.payload.to_bytes())
                    raise RefusedError(f"the world does not let {robot} in: {refused.reason}")
        time.sleep(RETRY_S)
    raise LinkError(f"the world does not answer {robot} within {timeout_s:g} s: is it busy, or another program?")


def await_world(inbox: AgentInbox, timeout_s: float) -> str | None:
    """Wait for a world that is gone to come back, and drop its last messages; None when it is there.

    Returns why the run ended where it is over for this robot. Raises LinkError after timeout_s seconds.
    """
    deadline = time.monotonic() + timeout_s
    while not (inbox.world_up and inbox.empty()):
        arrival = inbox.take(deadline)
        if arrival is None:
            raise LinkError(f"the world is gone for {timeout_s:g} s: look at its last words for why")
        if arrival.what == keys.END:  # the message may come after the news that the world's token is gone
            return decode(End, arrival.payload).reason
        if inbox.stopped:
            return "interrupted"
    return None


@contextmanager
def declared(
    session: zenoh.Session, robot: str, lockstep: bool, inbox: AgentInbox, timeout_s: float
) -> Iterator[dict[str, zenoh.Publisher]]:
    """Declare a welcomed robot's subscriber, publishers and liveliness token, with which the world may begin.

    The token comes last, when every publisher that the world needs has its reader; LinkError on a time-out.
    """
    congestion = zenoh.CongestionControl.BLOCK if lockstep else zenoh.CongestionControl.DROP
    with ExitStack() as stack:
        declare = stack.enter_context
        declare(session.declare_subscriber(keys.to_robot(robot), at_once(inbox.hear)))
        publishers: dict[str, zenoh.Publisher] = {}
        for channel in keys.OUTPUTS:
            key = keys.from_robot(robot, channel)
            publishers[channel] = declare(session.declare_publisher(key, congestion_control=congestion, express=True))
        wait_for_matching((publishers[channel] for channel in keys.NEEDED), timeout_s)
        declare(session.liveliness().declare_token(keys.alive(robot)))
        yield publishers


def answer(publishers: Mapping[str, zenoh.Publisher], step: Step) -> None:
    """Publish a tick's messages for the radio, its telemetry, and last its action."""
    for send in step.sends:
        publishers[keys.RADIO].put(encode(send))
    for channel, report in ((keys.SCAN, step.scan), (keys.POSE, step.pose)):
        if publishers[channel].matching_status:
            publishers[channel].put(encode(report))
    if step.map is not None:
        publishers[keys.MAP].put(encode(step.map))
    publishers[keys.ACT].put(encode(step.action))


def live(
    mind: Mind, publishers: Mapping[str, zenoh.Publisher], lockstep: bool, inbox: AgentInbox, changes: int
) -> str | None:
    """Step once per observation until the run ends; returns why, or None where the world that was joined is gone.

    changes: the inbox's `world_changes` when that world let the robot in. A slow world is waited for without limit.
    """
    heard: list[Heard] = []
    while not inbox.stopped:
        what, _, payload, _ = inbox.get()
        match what:
            case keys.RADIO:
                heard.append(decode(Heard, payload))
            case keys.OBS:
                observation = decode(Observation, payload)
                if lockstep and observation.heard != len(heard):
                    raise ProtocolError(f"{observation.heard} messages were due at tick {observation.tick}, "
                                        f"{len(heard)} came")  # fmt: skip
                if not lockstep and not inbox.empty():
                    continue  # late: it steps on the newest scan only, with all messages heard since its last step
                answer(publishers, mind.step(observation, heard))
                heard = []
            case keys.END:
                return decode(End, payload).reason
            case AgentInbox.WORLD if inbox.world_changes != changes:
                return None
            case _:
                pass  # the world's token at the start, or a key of a later version
    return "interrupted"
