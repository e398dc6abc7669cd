"""The shell around an episode over Zenoh: the join, the ticks, and robots that die."""

import time
from collections import Counter
from collections.abc import Callable, Collection
from contextlib import ExitStack, suppress
from typing import Self

import zenoh

from protocol import keys
from protocol.codec import encode
from protocol.errors import Interrupted, LinkError, ProtocolError
from protocol.inbox import Arrival, Inbox
from protocol.messages import Clock, End, Progress, clipped
from protocol.session import at_once, wait_for_matching
from world.config import ServerConfig
from world.episode import Episode
from world.recorder import REPLACED
from world.shell.answers import Answers, LockstepAnswers, RealTimeAnswers
from world.shell.inbox import MOST_BYTES_WAITING, MOST_WAITING, WorldInbox, refuse
from world.shell.participants import Awaited, Participants
from world.shell.showing import Showing
from world.shell.wire import Wire
from world.tick import BadOutputsError, Inputs, Outputs

FAREWELL_S = 1.0
"""At the end of a run, robots have this long to go by themselves before the router closes."""
ENDED, LEFT, LOST = "its process ended", "it took its leave", "its link was lost"
"""Why a robot left."""
MOST_QUESTIONS = 16
"""Of a robot in a tick, or in SAY_AGAIN_S of a longer one (ours). One whose link is lost asks once when it is back."""
FLOODS = f"more than {MOST_WAITING} of its messages, or {MOST_BYTES_WAITING} bytes of them, waited for the world"
SAY_AGAIN_S = 2.0
"""In lockstep a tick is said again to robots whose answer takes longer, as a link that was lost loses messages."""
STALL_S = 1.0
"""In real time a world that is behind its clock by more stood still; what is less it makes up for."""
PROGRESS_S = 0.2
"""Time between two publications of clock and progress, so that a viewer looks alive."""
AWAITED_S = 5.0
"""Time between two tellings of who is awaited, where nobody comes."""

OnProgress = Callable[[Progress], None]
OnAwaited = Callable[[Awaited], None]
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
        self._awaited, self._written = awaited, written
        self.episode, self.config, self.inbox, self.progress = episode, config, inbox, progress
        self._lockstep = config.real_time is None
        self._session, self._declared = session, ExitStack()
        linked = self._linked if config.connect is None else None
        self._known = known
        self._participants = Participants(episode.robots, episode.dead, linked, known, goes_on=episode.goes_on)
        self._participants.processes.update(episode.processes)
        self._answers: Answers = LockstepAnswers(episode.robots)
        if not self._lockstep:
            self._answers = RealTimeAnswers(episode.robots, episode.actions)
        self._put: dict[tuple[str, str], zenoh.Publisher] = {}
        self._wire = Wire()
        self._away: set[str] = set()
        """Robots that were here and whose link is lost."""
        self._silent: Counter[str] = Counter()
        """How often each robot was waited for in vain: in lockstep for SAY_AGAIN_S of this tick, since it came back for
        the first time in it; in real time for a tick, since it was heard, or its link came or went."""
        self._returned: set[str] = set()
        """Robots that came back in this tick; who comes and goes is not waited for without end."""
        self._newcomers: dict[str, str] = {}
        """Robots whose process came in this tick, `joined` or `rejoined`."""
        self._losers: set[str] = set()
        """Robots whose link was lost in this tick."""
        self._asked: Counter[str] = Counter()
        """Questions of each robot in this tick."""
        self._began: float | None = None
        """time.monotonic() at the first tick; None before it and after the last one."""
        self._due = 0.0
        """time.monotonic() at which the tick is over in real time."""
        self._told = 0.0
        self._came: tuple[list[str], list[str]] = [], []
        """Robots that were ready, and those that were preparing, when `awaited` was told."""
        self._awaited_told = time.monotonic()

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
        self._showing = Showing(self.episode, session, self._declared)
        for channel in keys.NEEDED:
            declare(session.declare_subscriber(keys.from_robot("*", channel), at_once(self.inbox.hear)))
        declare(session.liveliness().declare_subscriber(keys.ALL_ALIVE, self.inbox.watch, history=True))
        declare(session.declare_queryable(keys.ALL_SRV, self.inbox.ask))
        declare(session.liveliness().declare_token(keys.WORLD_ALIVE))
        return self

    def __exit__(self, *_: object) -> None:
        self._declared.close()

    def gather(self, endpoint: str) -> None:
        """Wait until as many are ready as the run begins with; LinkError names those missing after join_timeout_s.

        Robots that were let in by then and have their link may still compile their kernels, for silence_s at most.
        In a run that goes on, those that were there come back by themselves, and are waited for as if they were away.
        Where it had ended, all that is left is to tell them so: they are waited for here, for join_timeout_s at most.
        """
        timeout_s = self.config.join_timeout_s
        begin = time.monotonic()
        while self.episode.ended and self._still_away and self._take(begin + timeout_s):
            pass
        deadline = begin + timeout_s
        everybody = len(self.episode.robots)  # with `settle_s` fewer may have come than begin_with
        first = min(self.config.begin_with or everybody, everybody)
        while not self._here and len(self._participants.ready) < first:
            if self._take_awaited(deadline, first):
                continue
            preparing = self._participants.preparing
            coming = len(self._participants.ready) + len(preparing)
            if coming >= first and time.monotonic() - begin < self.config.silence_s:
                deadline = time.monotonic() + SAY_AGAIN_S
                continue
            absent = [robot for robot in self._participants.missing if robot not in preparing]
            if not absent:
                late = f"did not become ready within {self.config.silence_s:g} s, though let in"
                raise LinkError(f"{', '.join(preparing)} {late}: look at the last words of each")
            where = endpoint.replace("/0.0.0.0:", "/HOST:").replace("/[::]:", "/HOST:")
            command = f"wireswarm agent --id {absent[0]} --connect {where}"
            certs = " --certs DIR" if where.startswith("tls/") else ""
            late = f"did not join within {timeout_s:g} s"
            raise LinkError(f"{', '.join(absent)} {late}: start each by `{command}{certs}`")
        ready = self._participants.ready
        to_robots = [put for (robot, _), put in self._put.items() if robot in ready]
        wait_for_matching(to_robots, timeout_s, lambda: self.inbox.stopped)
        self._wire.follow(self._far_ends())
        self._began = time.monotonic()
        self._away = set(self._still_away)
        if not self._lockstep and self.episode.ended is None:
            # in a run that goes on, all links were lost with its world, also of those that are back
            for robot in (robot for robot in self.episode.live if robot in self._here):
                self.episode.happened(robot, "left", LOST)
            self._newcomers |= {robot: "rejoined" for robot in ready if robot in self._here}
        for robot in ready:
            if robot not in self._newcomers:
                self._arrive(robot)

    def _take_awaited(self, deadline: float, first: int) -> bool:
        """As `_take`, and tell who is there of the robots with which the run begins, `first` of them."""
        while not self._take(min(deadline, self._awaited_told + AWAITED_S)):
            if time.monotonic() >= deadline:
                return False
            self._tell_awaited(first)
        if (self._participants.ready, self._participants.preparing) != self._came:
            self._tell_awaited(first)
        return True

    def _tell_awaited(self, first: int) -> None:
        self._awaited_told, there = time.monotonic(), self._participants
        ready, preparing = self._came = there.ready, there.preparing
        missing = [robot for robot in there.missing if robot not in preparing]
        self._awaited(Awaited(ready, preparing, missing, first - len(ready)))

    @property
    def _here(self) -> Collection[str]:
        """Robots that have joined the run; in lockstep their answers are waited for, even while they are away."""
        return self.episode.processes

    @property
    def _still_away(self) -> list[str]:
        """Robots that have joined the run, live, and are not ready now."""
        return [robot for robot in self._participants.missing if robot in self._here and robot in self.episode.live]

    def _arrive(self, robot: str) -> bool:
        """Keep in mind which process is the robot's; whether it is another than before."""
        if new := self.episode.processes.get(robot) != self._participants.processes[robot]:
            self.episode.arrive(robot, self._participants.processes[robot])
        return new

    def run(self) -> None:
        """Tick by tick, as fast as the robots answer or by the clock, until the episode ends."""
        assert self._began is not None
        self._due = self._began
        self.tell()
        while self.episode.ended is None:
            tick = self.episode.tick
            for robot, inputs in self.episode.hand_out():
                if robot in self._here:  # one that is about to join would answer ticks that nobody waits for
                    self._say_tick(robot, inputs)
            # what nobody waits for is done while they think
            self._showing.show(self.episode.inputs())
            self.episode.book()
            if time.monotonic() - self._told > PROGRESS_S:
                self._expel()
                self.tell()
            if self._lockstep:
                self._wait_for_all()
            else:
                self._wait_for_clock()
                self._count_silent()
                self._count_late()
            self._losers.clear()
            self._returned.clear()
            self._asked.clear()
            if self.episode.ended is None:
                self._note_newcomers()
                self._advance({robot: self._answers.take(robot, tick) for robot in self.episode.live})

    def tell(self, ended: str | None = None) -> None:
        """Publish clock, link table and progress, and call the callback."""
        self._told = time.monotonic()
        episode = self.episode
        status = {robot: "complete" if done else "exploring" for robot, done in episode.complete.items()}
        status |= dict.fromkeys(self._participants.missing, "away") | dict.fromkeys(episode.dead, "dead")
        clock = Clock(tick=episode.tick, t=episode.t, status=status, ended=ended)
        coverage, team = episode.coverage, episode.team_coverage
        progress = Progress(clock=clock, coverage=coverage, team=team, late_ticks=episode.late_ticks)
        self._clock.put(encode(clock))
        self._links.put(encode(episode.links))
        self._progress.put(encode(progress))
        self.progress(progress)

    def close(self) -> str:
        """Write the run directory and take leave, also where it cannot be written; returns how the run ended."""
        episode = self.episode
        if self._began is not None:
            episode.wall_s = time.monotonic() - self._began
        self._began = None
        episode.wire = self._wire.close()
        try:
            episode.close(self._written)
        finally:
            ended = episode.ended or "interrupted"
            self._take_leave(ended)
        return ended

    def _take_leave(self, ended: str) -> None:
        """Tell everybody that the run is over, and give robots a moment to go."""
        self.tell(ended)
        for robot in self.episode.live:
            self._say(robot, keys.END, encode(End(reason=ended)))
        deadline = time.monotonic() + FAREWELL_S
        with suppress(Interrupted):
            while self._participants.ready and time.monotonic() < deadline and self._take(deadline):
                pass

    def _lose(self, robot: str) -> None:
        """A link is lost: the process behind it may have ended, or stand still and come back.

        That is told once a tick, as a robot may take its token away and give it back as often as it likes.
        """
        self.episode.links_lost += 1
        self._away.add(robot)
        if robot in self._losers:
            if not self._lockstep:  # it has `left` in this tick, and has not come back
                self._newcomers.pop(robot, None)
            return
        self._losers.add(robot)
        if not self._lockstep:
            self._silent.pop(robot, None)
            self._note_newcomer(robot)
            self.episode.happened(robot, "left", LOST)
        self.tell()

    def _welcome_back(self, robot: str) -> None:
        """A robot that was away, or is late, may be ready now."""
        if self._began is None or not self._participants.is_ready(robot):
            return
        self._wire.follow(self._far_ends())
        if robot not in self._here:
            self._arrive(robot)
            self._newcomers[robot] = "joined"
        elif robot in self._away:
            self._away.remove(robot)
            if not self._lockstep:
                self._newcomers[robot] = "rejoined"
            if robot not in self._returned:
                self._returned.add(robot)
                self._silent.pop(robot, None)
        self._say_again(robot)

    def _note_newcomers(self) -> None:
        """Log who came in this tick. In lockstep a process that was away and is the same one has missed nothing."""
        for robot in self.episode.live:
            self._note_newcomer(robot)
        self._newcomers.clear()

    def _note_newcomer(self, robot: str) -> None:
        event = self._newcomers.pop(robot, None)
        if event is None:
            return
        replaced = self._arrive(robot)  # one that joined has arrived
        if event == "rejoined" and self._lockstep:
            self.episode.came_back(robot)
        else:
            self.episode.happened(robot, event, REPLACED if replaced else "its process is ready")

    def _count_silent(self) -> None:
        """Count the ticks in real time for which robots said nothing, with their link or without."""
        for robot in self.episode.live:
            if robot in self._here and not self._gave_up(robot, self._tick_s):
                self._silent[robot] += 1

    def _gave_up(self, robot: str, wait_s: float) -> bool:
        """Whether a robot has said nothing for silence_s, in waits of wait_s, and is given up for it."""
        if silent := self._silent[robot] * wait_s >= self.config.silence_s:
            who = f"{LOST}, and it" if robot in self._away else "it"
            self._kill(robot, f"{who} said nothing for {self.config.silence_s:g} s")
        return silent

    def _count_late(self) -> None:
        """Count the robots that had this tick in real time and have not answered it.

        One that is away has no tick to miss: that is told as `left`. One that came back in it was not told all of it.
        """
        had = (robot for robot in self._participants.ready if robot in self._here and robot not in self._newcomers)
        self.episode.late_ticks += len(self._answers.due(had, self.episode.tick))

    def _expel(self) -> None:
        """Give up robots whose credentials count no longer."""
        for robot, session in self._participants.sessions.items():
            if self._known is not None and robot in self.episode.live and self._known(robot) != session:
                self._kill(robot, "its certificate was revoked")

    def _say_tick(self, robot: str, inputs: Inputs) -> None:
        for heard in inputs.heard:
            self._say(robot, keys.RADIO, encode(heard))
        self._say(robot, keys.OBS, encode(inputs.observation))

    def _say_again(self, robot: str) -> None:
        """Say the tick again to a robot whose link was lost in lockstep; in real time the next one will do."""
        if self._lockstep and robot in self._here:
            self._answers.again(robot)
            self._say_tick(robot, self.episode.inputs()[robot])

    def _say(self, robot: str, channel: str, payload: bytes) -> None:
        if self._participants.is_ready(robot):  # else nobody reads it, and Zenoh sends it nowhere
            self._wire.told(robot, channel, payload)
        self._put[robot, channel].put(payload)

    def _far_ends(self) -> dict[str, str]:
        """Zenoh's address of each robot's end of its link."""
        linked, sessions = self._linked(), self._participants.sessions
        return {robot: linked[sessions[robot]] for robot in self.episode.robots if sessions.get(robot) in linked}

    def _linked(self) -> dict[str, str]:
        """Address of the far end of each link by its Zenoh ID."""
        return {str(link.zid): str(link.dst) for link in self._session.info.links()}

    def _wait_for_all(self) -> None:
        """Wait for the robots that are here; those that say nothing for silence_s are dead.

        Who comes back is given it once more. Waits are counted, not hours: a freeze of this process or of the machine
        is nobody's silence.
        """
        self._silent.clear()
        end = time.monotonic() + SAY_AGAIN_S
        tick = self.episode.tick
        while due := self._answers.due((robot for robot in self.episode.live if robot in self._here), tick):
            if time.monotonic() < end and self._take(end):
                continue
            end = time.monotonic() + SAY_AGAIN_S
            self._asked.clear()
            self._silent.update(due)
            for robot in due:
                if not self._gave_up(robot, SAY_AGAIN_S):
                    self._say_again(robot)
            self._expel()
            self.tell()

    @property
    def _tick_s(self) -> float:
        """Seconds that a tick takes in real time."""
        return self.episode.period_s / (self.config.real_time or 1.0)

    def _wait_for_clock(self) -> None:
        """Wait for the end of a tick in real time.

        Where this process stood still, the clock goes on from now, with a whole period: no robot is late by it. That is
        looked at before the wait and after it, when answers may still wait in sockets.
        """
        self._due += self._tick_s
        for _ in range(2):
            now = time.monotonic()
            if now > self._due + STALL_S:
                self._due = now + self._tick_s
            self._take_until(self._due)

    def _advance(self, outputs: dict[str, Outputs]) -> None:
        while True:
            try:
                return self.episode.advance(outputs)
            except BadOutputsError as error:  # raised before anything changed, so the others' answers still hold
                self._kill(error.robot, str(error))

    def _take_until(self, deadline: float) -> None:
        """Act on what arrives until the deadline, and on what waits then.

        What comes later belongs to the next tick, so nobody can hold a tick by sending without end.
        """
        while time.monotonic() < deadline and self._take(deadline):
            pass
        for _ in range(self.inbox.qsize()):
            self._take(deadline)

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
                self._welcome_back(arrival.robot)
            case WorldInbox.GONE:
                # before the first tick a robot may be started again, after the last one it leaves as asked
                self._participants.token_went(arrival.robot)
                if self._began is not None and arrival.robot in self._here and arrival.robot in self.episode.live:
                    self._lose(arrival.robot)
            case WorldInbox.ENDED:
                self._participants.token_went(arrival.robot)
                self._part_with(arrival.robot, ENDED)
            case WorldInbox.FLOOD if arrival.robot in self.episode.live:
                self._part_with(arrival.robot, FLOODS)
            case channel if channel in keys.NEEDED and self._began is not None:
                self._hear(arrival.robot, channel, arrival.payload)
        return True

    def _hear(self, robot: str, channel: str, payload: bytes) -> None:
        if not self._participants.is_ready(robot):
            return
        self._wire.heard(robot, payload)
        if not self._lockstep:  # where the world waits, only the answer that it waits for counts
            self._silent.pop(robot, None)
        try:
            if self._answers.hear(robot, channel, payload, self.episode.tick):
                self._say_again(robot)
        except ProtocolError as error:
            self._kill(robot, str(error))

    def _part_with(self, robot: str, reason: str) -> None:
        """Go on without a robot that will not come back; before the first tick it may be started again."""
        if self._began is not None:
            self._kill(robot, reason)

    def _kill(self, robot: str, reason: str) -> None:
        self._away.discard(robot)
        self._say(robot, keys.END, encode(End(reason=clipped(f"given up by the world: {reason}"))))
        self.episode.kill(robot, reason)

    def _reply(self, arrival: Arrival, query: zenoh.Query) -> None:
        """Answer a question. One too many gets no answer; who asks it honestly asks again."""
        self._asked[arrival.robot] += self._began is not None
        if self._asked[arrival.robot] > MOST_QUESTIONS:
            query.drop()  # type: ignore[no-untyped-call]
            return
        if arrival.what == keys.WHY:
            with query:
                refuse(query, self._participants.why_not(arrival.payload))
            return
        if arrival.what == keys.LEAVE:
            self._let_go(arrival, query)
            return
        robot, processes = arrival.robot, self._participants.processes
        before = processes.get(robot)
        with query:
            refusal = self._participants.admit(robot, arrival.what, arrival.payload)
            if refusal is not None:
                refuse(query, refusal)
            else:
                welcome = self.episode.welcome(robot, lockstep=self._lockstep)
                query.reply(query.key_expr, encode(welcome))
        if refusal is None:
            # in real time it has `left`, and has `rejoined` once it is ready
            if self._lockstep and robot in self._here and processes[robot] != before:
                self._newcomers.setdefault(robot, "rejoined")  # one that `joined` in this tick still has
            self._welcome_back(robot)

    def _let_go(self, arrival: Arrival, query: zenoh.Query) -> None:
        with query:
            refusal = self._participants.dismiss(arrival.robot, arrival.payload)
            if refusal is not None:
                refuse(query, refusal)
                return
            query.reply(query.key_expr, b"")
        self._part_with(arrival.robot, LEFT)
