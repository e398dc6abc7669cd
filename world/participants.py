"""Which robots take part in a run, and who is let in."""

from collections.abc import Callable, Collection, Iterable, Mapping

from protocol import keys
from protocol.codec import decode
from protocol.errors import ProtocolError
from protocol.messages import PROTOCOL_VERSION, Join


class Participants:
    """How far each robot of a run has come: awaited, let in, ready, away, or dead.

    A robot that was let in may still miss messages. Once its liveliness token is there, it reads and is read. A robot
    whose token goes is away: its process may live and come back, or another process may take its place.
    """

    def __init__(
        self, robots: Iterable[str], dead: Mapping[str, str], linked: Callable[[], Collection[str]] = tuple
    ) -> None:
        """dead: the reason for each robot that was given up, which may grow. linked: the Zenoh IDs that have a link."""
        self._robots, self._dead, self._linked = list(robots), dead, linked
        self.sessions: dict[str, str] = {}
        """Zenoh ID of each robot that was let in."""
        self.processes: dict[str, str] = {}
        """The process of each robot that was let in."""
        self._tokens: set[str] = set()

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
        # a process whose link was lost and is there again asks again; one that died has no link any more
        before = self.sessions.get(robot, join.session)
        if before != join.session and before in self._linked():
            return f"another {robot} is there already"
        self.sessions[robot], self.processes[robot] = join.session, join.process
        return None

    def token_came(self, robot: str) -> None:
        """A robot's token is there, maybe before the robot asked to be let in: its session declares it anew."""
        self._tokens.add(robot)

    def token_went(self, robot: str) -> None:
        """A robot's token is gone."""
        self._tokens.discard(robot)
