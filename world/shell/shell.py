"""The shell around an episode over Zenoh: what arrives is acted on, tick by tick, from the join to the farewell."""

import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from typing import Self

import zenoh

from protocol import keys
from protocol.codec import encode
from protocol.errors import Interrupted, ProtocolError
from protocol.inbox import Inbox
from protocol.messages import End
from protocol.session import at_once
from world.config import ServerConfig
from world.episode import Episode
from world.shell.answers import Answers, LockstepAnswers, RealTimeAnswers
from world.shell.gathering import Gathering, OnAwaited
from world.shell.inbox import MOST_BYTES_WAITING, MOST_WAITING, WorldInbox
from world.shell.pace import LockstepPace, Pace, RealTimePace
from world.shell.participants import Participants
from world.shell.presence import ENDED, Presence
from world.shell.questions import Questions
from world.shell.voice import OnProgress, Voice, linked
from world.tick import BadOutputsError, Outputs

FAREWELL_S = 1.0
"""At the end of a run, robots have this long to go by themselves before the router closes."""
FLOODS = f"more than {MOST_WAITING} of its messages, or {MOST_BYTES_WAITING} bytes of them, waited for the world"

OnWritten = Callable[[str], None]


class Shell:
    """An episode among its robots' processes."""

    def __init__(
        self,
        episode: Episode,
        config: ServerConfig,
        session: zenoh.Session,
        inbox: WorldInbox,
        progress: OnProgress,
        known: Callable[[str], str | None] | None = None,
        awaited: OnAwaited = lambda awaited: None,
        written: OnWritten = lambda ended: None,
    ) -> None:
        """known: the Zenoh ID that a robot must have, as in `Participants`. awaited, written: as in `serve`."""
        self._episode, self._config, self._session, self._inbox = episode, config, session, inbox
        self._written, self._declared = written, ExitStack()
        self._lockstep = config.real_time is None
        self._answers: Answers = LockstepAnswers(episode.robots)
        if not self._lockstep:
            self._answers = RealTimeAnswers(episode.robots, episode.actions)
        links = partial(linked, session) if config.connect is None else None
        there = Participants(episode.robots, episode.dead, links, known, goes_on=episode.goes_on)
        there.processes.update(episode.processes)
        self._participants = there
        self._voice = Voice(episode, there, session, progress)
        self._presence = Presence(episode, config, there, self._answers, self._voice, known)
        self._gathering = Gathering(episode, config, there, self._presence, self._take, awaited)
        self._questions = Questions(episode, there, self._presence, lockstep=self._lockstep)
        self._began: float | None = None
        """time.monotonic() at the first tick; None before it."""

    def __enter__(self) -> Self:
        """Declare everything, the world's token last."""
        declare, session = self._declared.enter_context, self._session
        self._voice.declare(self._declared, lockstep=self._lockstep)
        for channel in keys.NEEDED:
            declare(session.declare_subscriber(keys.from_robot("*", channel), at_once(self._inbox.hear)))
        declare(session.liveliness().declare_subscriber(keys.ALL_ALIVE, self._inbox.watch, history=True))
        declare(session.declare_queryable(keys.ALL_SRV, self._inbox.ask))
        declare(session.liveliness().declare_token(keys.WORLD_ALIVE))
        return self

    def __exit__(self, *_: object) -> None:
        self._declared.close()

    def gather(self, endpoint: str) -> None:
        """Wait for the robots with which the run begins, as `Gathering` does, and until they read. Raises LinkError."""
        self._gathering.wait(endpoint)
        ready = self._participants.ready
        self._voice.wait_for_readers(ready, self._config.join_timeout_s, lambda: self._inbox.stopped)
        self._voice.follow()
        self._began = time.monotonic()
        self._presence.begin(ready)

    def run(self) -> None:
        """Tick by tick, as fast as the robots answer or by the clock, until the episode ends.

        A tick: 1 hand out what robots get, 2 show and book it, 3 expel and tell, 4 wait for answers, 5 count who was
        silent, then who was late, 6 forget who came, went and asked, 7 log newcomers, 8 take the answers and advance.
        This order is that of the events in the log, so a change of it is one of the run's bytes.
        """
        episode, presence, voice, pace = self._episode, self._presence, self._voice, self._pace()
        voice.tell()
        while episode.ended is None:
            tick = episode.tick
            for robot, inputs in episode.hand_out():
                if robot in presence.here:  # one that is about to join would answer ticks that nobody waits for
                    voice.say_tick(robot, inputs)
            # what nobody waits for is done while they think
            voice.show(episode.inputs())
            episode.book()
            if voice.is_due:
                presence.expel()
                voice.tell()
            pace.wait()
            presence.end_tick()  # newcomers are kept for the log; they were not late
            self._questions.end_tick()
            if episode.ended is None:
                presence.note_newcomers()
                self._advance({robot: self._answers.take(robot, tick) for robot in episode.live})

    def _pace(self) -> Pace:
        episode, presence, answers, real_time = self._episode, self._presence, self._answers, self._config.real_time
        if real_time is None:
            return LockstepPace(episode, presence, answers, self._take, self._look_up)
        assert self._began is not None
        return RealTimePace(episode, presence, answers, self._take_until, episode.period_s / real_time, self._began)

    def _look_up(self) -> None:
        """In a tick that takes long."""
        self._questions.end_tick()
        self._presence.expel()
        self._voice.tell()

    def _advance(self, outputs: dict[str, Outputs]) -> None:
        while True:
            try:
                return self._episode.advance(outputs)
            except BadOutputsError as error:  # raised before anything changed, so the others' answers still hold
                self._presence.give_up(error.robot, str(error))

    def close(self) -> str:
        """Write the run directory and take leave, also where it cannot be written; returns how the run ended."""
        episode = self._episode
        if self._began is not None:
            episode.wall_s = time.monotonic() - self._began
        self._presence.began = False
        episode.wire = self._voice.close()
        try:
            episode.close(self._written)
        finally:
            ended = episode.ended or "interrupted"
            self._take_leave(ended)
        return ended

    def _take_leave(self, ended: str) -> None:
        """Tell everybody that the run is over, and give robots a moment to go."""
        self._voice.tell(ended)
        for robot in self._episode.live:
            self._voice.say(robot, keys.END, encode(End(reason=ended)))
        deadline = time.monotonic() + FAREWELL_S
        with suppress(Interrupted):
            while self._participants.ready and time.monotonic() < deadline and self._take(deadline):
                pass

    def _take_until(self, deadline: float) -> None:
        """Act on what arrives until the deadline, and on what waits then.

        What comes later belongs to the next tick, so nobody can hold a tick by sending without end.
        """
        while time.monotonic() < deadline and self._take(deadline):
            pass
        for _ in range(self._inbox.qsize()):
            self._take(deadline)

    def _take(self, deadline: float) -> bool:
        """Act on the next arrival, waiting for it until the deadline; whether there was one."""
        arrival = self._inbox.take(deadline)
        if arrival is None:
            return False
        match arrival.what:
            case _ if arrival.query is not None:  # first, because the question's key is the robot's choice
                self._questions.reply(arrival, arrival.query)
            case Inbox.STOP:
                raise Interrupted
            case WorldInbox.ALIVE:
                self._participants.token_came(arrival.robot)
                self._presence.welcome_back(arrival.robot)
            case WorldInbox.GONE:
                # before the first tick a robot may be started again, after the last one it leaves as asked
                self._participants.token_went(arrival.robot)
                self._presence.lose(arrival.robot)
            case WorldInbox.ENDED:
                self._participants.token_went(arrival.robot)
                self._presence.part_with(arrival.robot, ENDED)
            case WorldInbox.FLOOD if arrival.robot in self._episode.live:
                self._presence.part_with(arrival.robot, FLOODS)
            case channel if channel in keys.NEEDED and self._presence.began:
                self._hear(arrival.robot, channel, arrival.payload)
        return True

    def _hear(self, robot: str, channel: str, payload: bytes) -> None:
        if not self._participants.is_ready(robot):
            return
        self._voice.heard(robot, payload)
        if not self._lockstep:  # where the world waits, only the answer that it waits for counts
            self._presence.silent.pop(robot, None)
        try:
            if self._answers.hear(robot, channel, payload, self._episode.tick):
                self._presence.say_again(robot)
        except ProtocolError as error:
            self._presence.give_up(robot, str(error))
