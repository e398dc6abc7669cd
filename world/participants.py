"""Which robots take part in a run, and who is let in."""

from collections.abc import Iterable, Mapping
from enum import Enum

from protocol import keys
from protocol.codec import decode
from protocol.errors import ProtocolError
from protocol.messages import PROTOCOL_VERSION, Join


class Phase(Enum):
    """How far a robot has come."""

    AWAITED = "awaited"
    WELCOMED = "welcomed"
    """The robot was let in, but may still miss messages."""
    READY = "ready"
    """The robot's liveliness token is there: it reads and is read, so no message is lost."""
    DEAD = "dead"


class Participants:
    """The phase of each robot of a run."""

    def __init__(self, robots: Iterable[str], dead: Mapping[str, str]) -> None:
        """`dead` gives the reason for each robot that was given up, and may grow."""
        self._phase = dict.fromkeys(robots, Phase.AWAITED)
        self._dead = dead
        self.sessions: dict[str, str] = {}
        """Zenoh ID of each robot that was let in."""

    @property
    def ready(self) -> list[str]:
        """Robots that take part now."""
        return [robot for robot, phase in self._phase.items() if phase == Phase.READY]

    def is_ready(self, robot: str) -> bool:
        """Whether this robot takes part now."""
        return self._phase.get(robot) == Phase.READY

    @property
    def missing(self) -> list[str]:
        """Robots that do not take part, or not yet."""
        return [robot for robot, phase in self._phase.items() if phase != Phase.READY]

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
        match self._phase.get(robot):
            case None:
                return f"no {robot} takes part, only {', '.join(self._phase)}"
            case Phase.WELCOMED if self.sessions[robot] == join.session:
                pass  # it asks again because the world's token changed while it asked
            case Phase.WELCOMED | Phase.READY:
                return f"another {robot} is there already"
            case Phase.DEAD:
                return f"it was given up: {self._dead[robot]}"
        self.sessions[robot] = join.session
        self._phase[robot] = Phase.WELCOMED
        return None

    def token_came(self, robot: str) -> None:
        """A robot that was let in is ready."""
        if self._phase.get(robot) == Phase.WELCOMED:
            self._phase[robot] = Phase.READY

    def token_went(self, robot: str) -> bool:
        """Whether a robot left that was here; it may join again unless it is given up."""
        here = self._phase.get(robot) in (Phase.READY, Phase.WELCOMED)
        if here:
            self._phase[robot] = Phase.AWAITED
        return here

    def give_up(self, robot: str) -> None:
        """Let a robot take no further part."""
        self._phase[robot] = Phase.DEAD
