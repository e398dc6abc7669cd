"""Which robots take part in a run, and who is let in."""

from collections.abc import Iterable, Mapping

from protocol import keys
from protocol.codec import decode
from protocol.errors import ProtocolError
from protocol.messages import PROTOCOL_VERSION, Join


class Participants:
    """How far each robot of a run has come: awaited, let in, ready, or dead.

    A robot that was let in may still miss messages. Once its liveliness token is there, it reads and is read.
    """

    def __init__(self, robots: Iterable[str], dead: Mapping[str, str]) -> None:
        """`dead` gives the reason for each robot that was given up, and may grow."""
        self._robots, self._dead = list(robots), dead
        self.sessions: dict[str, str] = {}
        """Zenoh ID of each robot that was let in and has not left."""
        self._tokens: set[str] = set()

    def is_ready(self, robot: str) -> bool:
        """Whether this robot takes part now."""
        return robot in self._tokens and robot not in self._dead

    @property
    def ready(self) -> list[str]:
        """Robots that take part now."""
        return [robot for robot in self._robots if self.is_ready(robot)]

    @property
    def missing(self) -> list[str]:
        """Robots that do not take part, or not yet."""
        return [robot for robot in self._robots if not self.is_ready(robot)]

    def admit(self, robot: str, service: str, payload: bytes) -> str | None:
        """Let in a robot that asks with these bytes; returns the reason where it is refused."""
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
        if robot not in self._robots:
            return f"no {robot} takes part, only {', '.join(self._robots)}"
        if robot in self._dead:
            return f"it was given up: {self._dead[robot]}"
        # one that was let in asks again where the world's token changed while it asked
        if robot in self._tokens or self.sessions.get(robot, join.session) != join.session:
            return f"another {robot} is there already"
        self.sessions[robot] = join.session
        return None

    def token_came(self, robot: str) -> None:
        """A robot that was let in is ready."""
        if robot in self.sessions:
            self._tokens.add(robot)

    def token_went(self, robot: str) -> bool:
        """Whether a robot left that was here; it may join again unless it is given up."""
        self._tokens.discard(robot)
        return self.sessions.pop(robot, None) is not None and robot not in self._dead
