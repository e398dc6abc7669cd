"""Which robots take part in a run, and who is let in."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

from protocol import keys
from protocol.codec import decode
from protocol.errors import ProtocolError
from protocol.messages import PROTOCOL_VERSION, Join

MOST_NAMES = 8
"""Of robots in a sentence."""


class Awaited(NamedTuple):
    """Who is there before a run begins; as a text, a sentence on it."""

    ready: list[str]
    """Robots that are there."""
    preparing: list[str]
    """Those that were let in, and compile their kernels."""
    missing: list[str]
    """Those that have not asked to be let in."""
    more: int
    """How many must still become ready."""

    def __str__(self) -> str:
        is_, prepare = ("is" if len(self.ready) == 1 else "are"), ("s" if len(self.preparing) == 1 else "")
        parts = [f"{_some(self.ready)} {is_} here" if self.ready else "nobody is here yet"]
        parts += [f"{_some(self.preparing)} prepare{prepare}"] if self.preparing else []
        others = len(self.preparing) + len(self.missing)
        if self.more < 1:
            parts.append("the run begins")
        elif self.missing:
            number = "" if self.more == others else f"{self.more} more, of "
            parts.append(f"waiting for {number}{_some(self.missing)}")
        return ", ".join(parts)


def _some(robots: Sequence[str]) -> str:
    """Their names, as far as a line holds them."""
    *names, last = robots
    if len(names) >= MOST_NAMES:
        names, last = names[:MOST_NAMES], f"{len(robots) - MOST_NAMES} more"
    return f"{', '.join(names)} and {last}" if names else last


class Participants:
    """How far each robot of a run has come: awaited, let in, ready, away, or dead.

    A robot that was let in may still miss messages. Once its liveliness token is there, it reads and is read. A robot
    whose token goes is away: its process may live and come back, or another process may take its place.
    """

    def __init__(
        self,
        robots: Iterable[str],
        dead: Mapping[str, str],
        linked: Callable[[], Collection[str]] | None = None,
        known: Callable[[str], str | None] | None = None,
        *,
        goes_on: bool = False,
    ) -> None:
        """dead: the reason for each robot that was given up, which may grow.

        linked: the Zenoh IDs that have a link; None where all links end at a router between, and tokens tell. known:
        the Zenoh ID that a robot must have, None for one that has no place; None where nobody shows who it is. goes_on:
        another world has begun the run, and may have let in robots of which its log does not tell. Their tokens cannot
        be told from those of another run, so any token of such a robot counts: one of another run goes with its link,
        and until then the robot is waited for as one whose link was lost.
        """
        self._robots, self._dead, self._known, self._goes_on = list(robots), dead, known, goes_on
        self._by_token, self._linked = linked is None, linked or self._with_tokens
        self.sessions: dict[str, str] = {}
        """Zenoh ID of each robot that was let in."""
        self.processes: dict[str, str] = {}
        """The process of each robot that was let in."""
        self._tokens: set[str] = set()
        self._entering: set[str] = set()
        """Robots that were let in and whose token has not been there since."""

    def is_ready(self, robot: str) -> bool:
        """Whether this robot reads and is read now."""
        return robot in self.sessions and robot in self._tokens and robot not in self._dead

    @property
    def ready(self) -> list[str]:
        """Robots that read and are read now."""
        return [robot for robot in self._robots if self.is_ready(robot)]

    @property
    def missing(self) -> list[str]:
        """Robots that do not take part, not yet, or not now."""
        return [robot for robot in self._robots if not self.is_ready(robot)]

    @property
    def preparing(self) -> list[str]:
        """Robots that were let in, still have their link where that can be told, and do not read yet: they compile."""
        linked = self._linked()
        awaited = [robot for robot in self.missing if robot in self._entering and robot not in self._dead]
        return [robot for robot in awaited if self._by_token or self.sessions[robot] in linked]

    def admit(self, robot: str, service: str, payload: bytes) -> str | None:
        """Let in a robot that asks with these bytes; returns the reason where it is refused."""
        if service != keys.JOIN:
            return "the world offers no such service"
        try:
            join = decode(Join, payload)
        except ProtocolError as error:
            return str(error)
        if join.robot != robot:
            return f"it says that it is {join.robot}"
        unfit = self._unfit(join)
        if unfit is not None:
            return unfit
        if robot in self._dead:
            return f"it was given up: {self._dead[robot]}"
        # a process whose link was lost and is there again asks again; one that died has no link any more
        if robot in self.sessions and self._is_another(join) and self._is_there(robot):
            return f"another {robot} is there already"
        by_another = self._goes_on and robot not in self.sessions  # then it lives in this run, and its token stays
        if self.processes.get(robot) != join.process and not by_another:  # of another run or process, and will go
            self._tokens.discard(robot)
        self.sessions[robot], self.processes[robot] = join.session, join.process
        if robot not in self._tokens:
            self._entering.add(robot)
        return None

    def why_not(self, payload: bytes) -> str | None:
        """Why nobody who asks with these bytes can take part; None where they may. Nobody is let in by it."""
        try:
            return self._unfit(decode(Join, payload))
        except ProtocolError as error:
            return str(error)

    def _unfit(self, join: Join) -> str | None:
        """What is against a robot whatever the others do."""
        if join.version != PROTOCOL_VERSION:
            return f"it speaks version {join.version} of the protocol, the world version {PROTOCOL_VERSION}"
        if join.robot not in self._robots:
            return f"no {join.robot} takes part, only {_some(self._robots)}"
        if self._known is not None and join.session != self._known(join.robot):
            return "its certificate does not count: it was revoked, or made after the world began"
        return None

    def dismiss(self, robot: str, payload: bytes) -> str | None:
        """Let go a robot that says so with these bytes; returns the reason where it is refused."""
        try:
            leave = decode(Join, payload)
        except ProtocolError as error:
            return str(error)
        if robot not in self.processes or (leave.robot, leave.process) != (robot, self.processes[robot]):
            return "this process is not the one that was let in"
        self.token_went(robot)
        self.sessions.pop(robot, None)
        self._entering.discard(robot)
        return None

    def _is_another(self, join: Join) -> bool:
        """Whether a robot that was let in may be another one than this; without a session its process tells."""
        before = self.sessions[join.robot]
        if before or join.session:
            return before != join.session
        return not join.process or join.process != self.processes[join.robot]

    def _is_there(self, robot: str) -> bool:
        """Whether a robot that was let in has its link; where it told no session, its token tells."""
        session = self.sessions[robot]
        return session in self._linked() if session else robot in self._tokens

    def _with_tokens(self) -> list[str]:
        return [self.sessions[robot] for robot in self._tokens if robot in self.sessions]

    def token_came(self, robot: str) -> None:
        """A robot's token is there, maybe before the robot asked to be let in: its session declares it anew."""
        self._tokens.add(robot)
        self._entering.discard(robot)

    def token_went(self, robot: str) -> None:
        """A robot's token is gone."""
        self._tokens.discard(robot)
