"""The shell around a robot over Zenoh: join the world, hand its messages to the mind, publish the mind's answers."""

from __future__ import annotations

import sys
import time
import uuid
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import zenoh

from agent.config import AgentConfig, JoinConfig
from agent.shell.checkpoint import Keeps, period, revived, save
from agent.shell.mind import MakeMind, Mind
from protocol import keys
from protocol.access import Credentials
from protocol.codec import decode, encode
from protocol.command import tell
from protocol.errors import InputError, Interrupted, LinkError, ProtocolError, RefusedError
from protocol.inbox import Arrival, Inbox
from protocol.messages import PROTOCOL_VERSION, End, Heard, Join, Observation, Refused, Welcome
from protocol.session import at_once, is_read, open_as_first, open_client, wait_for_matching

if TYPE_CHECKING:
    from agent.robot import Step

LEAVE_S = 1.0
"""A robot that takes its leave waits so long for the world to hear it."""
ANSWER_S = 5.0
"""A robot asks again where the world has not answered its question by then."""
RETRY_S = 0.1
"""Pause between two questions to a world that does not answer yet."""
SILENT_WORLD = (
    "the world is there and does not answer: it counts who comes (`wireswarm world --settle`), or the router between "
    "began before this robot's certificate was made"
)
"""What a robot says of a world whose token it sees: a router passes on no question of one that is not in its rules."""


class AgentInbox(Inbox):
    """What comes to one robot: samples of robots/ID/in/**, and changes of the world's liveliness token."""

    WORLD = "world"
    world_up = False
    """Whether the world's liveliness token is there."""
    world_changes = 0
    """How often that has changed. Where it changed since a question was asked, nobody knows which world answered."""

    def __init__(self) -> None:
        super().__init__()
        self.process = uuid.uuid4().hex[:16]
        """By which the world knows this process, as another may take its place."""
        self.robot = ""
        """Who this process is, once it is known."""

    def last_words(self) -> None:
        """Do what is left to do where this process ends at once; called on another thread."""

    def watch(self, sample: zenoh.Sample) -> None:
        """Take a change of the world's liveliness token."""
        self.world_up = sample.kind == zenoh.SampleKind.PUT
        self.world_changes += 1
        self.put(Arrival(self.WORLD))


def run_agent(
    robot: str | None,
    connect: str,
    config: AgentConfig,
    *,
    credentials: Credentials | None = None,
    patience: JoinConfig | None = None,
    make_mind: MakeMind | None = None,
    inbox: AgentInbox | None = None,
    checkpoints: Path | None = None,
    by_hand: bool = False,
) -> str:
    """Live as `robot` in the world at the endpoint `connect` until its run ends; None: as any that is missing there.

    credentials: of this robot, or of all that it may be, where the world asks for them. patience: how long to look for
    a world. checkpoints: folder where a mind that can be is kept, from which it goes on when its process is started
    again; None keeps nothing. by_hand: nobody else tells the world that this process ends; where it is stopped and
    keeps no checkpoint, from which it could come back, it takes its leave, so that the others need not wait for it.
    Returns why the run ended: `complete`, `time`, `dead`, `interrupted`, or why the world gave this robot up.
    Raises LinkError where no world is found or it does not come back in time, RefusedError where the world does not
    let the robot in, ProtocolError where the world's messages make no sense.
    """
    patience, inbox = patience or JoinConfig(), inbox or AgentInbox()
    with opened(robot, connect, patience.join_timeout_s, credentials) as (robot, session):
        inbox.robot = robot
        # with history: Zenoh reports the end of a token only to those to whom it reported the token
        session.liveliness().declare_subscriber(keys.WORLD_ALIVE, inbox.watch, history=True)
        entry = join(session, robot, inbox, patience.join_timeout_s)
        make_mind = make_mind or own_mind(inbox)  # the world waits for a robot that is let in and compiles
        may_return = checkpoints is not None
        while isinstance(entry, Entry):  # a world that was gone and is back may begin a new run
            welcome = entry.welcome
            make = partial(make_mind, robot, welcome.spec, config, welcome.seed)
            life = Life(revived(make, checkpoints, robot, welcome.run, welcome.tick), entry, robot, checkpoints)
            ended: str | None = "interrupted"
            with (
                suppress(Interrupted),
                declared(session, robot, welcome.lockstep, inbox, patience.join_timeout_s) as publishers,
            ):
                while (ended := life.live(publishers, inbox)) is None:
                    # the link was lost: this process, the world or the network stood still
                    entry = join(session, robot, inbox, patience.reconnect_s)
                    if not isinstance(entry, Entry) or not life.goes_on(entry):
                        break
            entry, may_return = ended or entry, life.is_kept
        if inbox.stopped and by_hand and not may_return:
            _leave(session, robot, inbox)
    return entry


def _leave(session: zenoh.Session, robot: str, inbox: AgentInbox) -> None:
    """Tell the world that this robot goes."""
    for _ in session.get(keys.service(robot, keys.LEAVE), payload=_question(session, robot, inbox), timeout=LEAVE_S):
        pass


def _question(session: zenoh.Session, robot: str, inbox: AgentInbox) -> bytes:
    """What a robot asks the world with: who it is."""
    zid = str(session.info.zid())
    return encode(Join(version=PROTOCOL_VERSION, robot=robot, session=zid, process=inbox.process))


def own_mind(inbox: AgentInbox) -> MakeMind:
    """What makes minds of ours, with their kernels loaded."""
    with inbox.long_work():
        from agent.robot import Robot
        from agent.warmup import rehearse

        rehearse()
    return Robot


@contextmanager
def opened(
    robot: str | None, connect: str, timeout_s: float, credentials: Credentials | None
) -> Iterator[tuple[str, zenoh.Session]]:
    """A session of the robot, or of the first of those with credentials that nobody else is, with its name."""
    if robot is None:
        if credentials is None:
            raise InputError("a robot without a name takes that of its secret or certificate: give one of them")
        with open_as_first(connect, timeout_s, credentials) as (name, session):
            tell(f"{name}: takes part")
            yield name, session
    else:
        with open_client(connect, timeout_s, robot, credentials) as session:
            yield robot, session


class Entry(NamedTuple):
    """A robot was let in."""

    welcome: Welcome
    changes: int
    """The inbox's `world_changes` at that time."""


def join(session: zenoh.Session, robot: str, inbox: AgentInbox, timeout_s: float) -> Entry | str:
    """Ask the world to let `robot` in, first or again, for timeout_s seconds without one. What came before is dropped.

    Returns why the run ended where it is over for this robot. Raises RefusedError where the world says no, LinkError
    where it is not there. One whose token is there is waited for without limit; that it does not answer is told once,
    on stderr.
    """
    question, left_s, silent_s = _question(session, robot, inbox), timeout_s, 0.0
    while True:
        began, changes = time.monotonic(), inbox.world_changes
        for reply in _ask(session, robot, question) if inbox.world_up else ():
            if reply.ok is not None and inbox.world_changes == changes:
                return Entry(decode(Welcome, reply.ok.payload.to_bytes()), changes)
            if reply.err is not None:
                with suppress(ProtocolError):  # an error of Zenoh itself, such as a time-out, is no answer
                    refused = decode(Refused, reply.err.payload.to_bytes())
                    raise RefusedError(f"the world does not let {robot} in: {refused.reason}")
        retry = time.monotonic() + RETRY_S
        while arrival := inbox.take(retry):
            if arrival.what == keys.END:  # the message may come after the news that the world's token is gone
                return decode(End, arrival.payload).reason
            if inbox.stopped:
                return "interrupted"
            if arrival.what == inbox.WORLD:
                break
        waited_s = min(time.monotonic() - began, ANSWER_S + RETRY_S)  # while this process stood still it did not wait
        if not inbox.world_up:
            left_s -= waited_s
        elif silent_s < timeout_s:
            silent_s += waited_s
            if silent_s >= timeout_s:
                print(f"{robot}: {SILENT_WORLD}", file=sys.stderr, flush=True)
        if left_s <= 0:
            break
    raise LinkError(
        f"the world does not answer {robot} for {timeout_s:g} s: it ended or stands still, the network is cut, or this "
        "is another program's address; look at the world's last words"
    )


def _ask(session: zenoh.Session, robot: str, question: bytes) -> list[zenoh.Reply]:
    """What the world says to a robot that asks to be let in; why not, where its question may not come that far."""

    def replies(service: str) -> list[zenoh.Reply]:
        return list(session.get(keys.service(robot, service), payload=question, timeout=ANSWER_S))

    return replies(keys.JOIN) or replies(keys.WHY)


@contextmanager
def declared(
    session: zenoh.Session, robot: str, lockstep: bool, inbox: AgentInbox, timeout_s: float
) -> Iterator[dict[str, zenoh.Publisher]]:
    """Declare a welcomed robot's subscriber, publishers and liveliness token, with which the world may begin.

    The token comes last, when every publisher that the world needs has its reader; LinkError on a time-out, Interrupted
    where the robot is to stop before.
    """
    with ExitStack() as stack:
        declare = stack.enter_context
        declare(session.declare_subscriber(keys.to_robot(robot), at_once(inbox.hear)))
        publishers = {channel: declare(one) for channel, one in publishers_of(session, robot, lockstep).items()}
        wait_for_matching([publishers[channel] for channel in keys.NEEDED], timeout_s, lambda: inbox.stopped)
        declare(session.liveliness().declare_token(keys.alive(robot)))
        yield publishers


def publishers_of(session: zenoh.Session, robot: str, lockstep: bool) -> dict[str, zenoh.Publisher]:
    """A robot's publishers by the last part of their keys; in lockstep nothing may be dropped."""
    congestion = zenoh.CongestionControl.BLOCK if lockstep else zenoh.CongestionControl.DROP
    return {
        channel: session.declare_publisher(keys.from_robot(robot, channel), congestion_control=congestion, express=True)
        for channel in keys.OUTPUTS
    }


def answer(publishers: Mapping[str, zenoh.Publisher], step: Step) -> None:
    """Publish a tick's messages for the radio, its telemetry, and last its action."""
    for send in step.sends:
        publishers[keys.RADIO].put(encode(send))
    if is_read(publishers[keys.SCAN]):
        publishers[keys.SCAN].put(encode(step.scan))
    if is_read(publishers[keys.POSE]):
        publishers[keys.POSE].put(encode(step.pose))
    if step.map is not None:
        publishers[keys.MAP].put(encode(step.map))
    publishers[keys.ACT].put(encode(step.action))


class Life:
    """A mind in one run of a world: what it heard, and what it last did, which it says again where that was lost."""

    def __init__(self, mind: Mind, entry: Entry, robot: str, checkpoints: Path | None) -> None:
        """entry: how the robot was let in. checkpoints: the folder where its mind is kept; None keeps nothing."""
        self._mind, self._entry = mind, entry
        self._robot, self._checkpoints = robot, checkpoints
        self._keeping = period(entry.welcome.spec.lidar.rate_hz)
        self._heard: list[Heard] = []
        self._tick = -1
        """Of the last step; -1 before the first."""
        self._step: Step | None = None

    @property
    def is_kept(self) -> bool:
        """Whether another process may go on with this mind, as far as its checkpoints can be written."""
        return self._checkpoints is not None and isinstance(self._mind, Keeps)

    def goes_on(self, entry: Entry) -> bool:
        """Whether the robot was let in again to the run that it lives in, at a tick that is not past."""
        before, self._entry = self._entry.welcome, entry
        return (entry.welcome.run, entry.welcome.lockstep) == (before.run, before.lockstep) and (
            entry.welcome.tick >= self._tick
        )

    def live(self, publishers: Mapping[str, zenoh.Publisher], inbox: AgentInbox) -> str | None:
        """Step once per observation until the run ends; returns why, or None where the link to the world was lost.

        A slow world is waited for without limit.
        """
        lockstep = self._entry.welcome.lockstep
        while not inbox.stopped:
            what, _, payload, _ = inbox.next()
            match what:
                case keys.RADIO:
                    self._heard.append(decode(Heard, payload))
                case keys.OBS:
                    observation = decode(Observation, payload)
                    observation.check(self._entry.welcome.spec.lidar.beams)
                    if not lockstep and not inbox.empty():
                        continue  # late: it steps on the newest scan only, with all messages heard since its last step
                    if step := (self._take if lockstep else self._step_on)(observation):
                        answer(publishers, step)
                        self._keep(observation.tick)
                    self._heard = []
                case keys.END:
                    return decode(End, payload).reason
                case AgentInbox.WORLD if inbox.world_changes != self._entry.changes:
                    return None
                case _:
                    pass  # the world's token at the start, or a key of a later version
        return "interrupted"

    def _keep(self, tick: int) -> None:
        """Keep the mind after its step at a tick, if a checkpoint is due."""
        if self._checkpoints is None or not self._keeping.take_due(tick) or not isinstance(self._mind, Keeps):
            return
        try:
            save(self._checkpoints, self._robot, self._entry.welcome.run, tick, self._mind.state())
        except OSError as error:  # the robot goes on without
            print(f"{self._robot}: no checkpoint: {error}", file=sys.stderr)
            self._checkpoints = None

    def _take(self, observation: Observation) -> Step | None:
        """The step on an observation in lockstep, once, however often it is said; None where messages were lost.

        The world says a tick again where a link was lost.
        """
        heard = [message for message in self._heard if message.tick == observation.tick]
        if observation.tick == self._tick:
            return self._step
        if observation.tick < self._tick or len(heard) < observation.heard:
            return None
        self._heard = heard[len(heard) - observation.heard :]
        return self._step_on(observation)

    def _step_on(self, observation: Observation) -> Step:
        """The step on an observation, with all that was heard since the last one."""
        self._step, self._tick = self._mind.step(observation, self._heard), observation.tick
        return self._step
