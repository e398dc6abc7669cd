"""What robots answer to a tick, gathered message by message."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from protocol import keys
from protocol.codec import decode
from protocol.errors import ProtocolError
from protocol.messages import MAX_EVENT_VALUES, MAX_EVENTS, Action, Event, MapReport, Send, values_in
from protocol.talk import MAX_SENDS
from world.tick import Outputs

MAX_SENT_BYTES = 1 << 20
"""Of a robot's messages for others in one tick (ours). Those that are too long for the air are kept as well."""
TRIES = 3
"""How often a tick whose answer does not add up is said again before the robot is given up."""


@dataclass
class Answer:
    """What one robot has said since its last answer was taken."""

    sends: list[Send] = field(default_factory=list)
    sent_bytes: int = 0
    """Of their payloads."""
    late: int = 0
    """How many of them came before an action: in real time those of an earlier tick may come in this one."""
    events: list[Event] = field(default_factory=list)
    event_values: int = 0
    """In the events."""
    map: MapReport | None = None
    action: Action | None = None
    """The last message of a tick; None until it comes."""
    tries: int = 0
    """How often its messages did not add up."""


class Answers:
    """The answers of all robots."""

    _may_be_late = False
    """Whether those of an earlier tick may come in this one."""

    def __init__(self, robots: Iterable[str]) -> None:
        self._answers = {robot: Answer() for robot in robots}

    def hear(self, robot: str, channel: str, payload: bytes, tick: int) -> bool:
        """Take a message at a tick; whether it must be said again. Raises ProtocolError for bytes that are none."""
        answer, message = self._answers[robot], decode(_MESSAGES[channel], payload)
        if self._came_before(robot, message, tick):
            return False
        match message:
            case Send():
                answer.sends.append(message)
                answer.sent_bytes += len(message.payload)
                while answer.late and (len(answer.sends) > MAX_SENDS or answer.sent_bytes > MAX_SENT_BYTES):
                    answer.late -= 1  # a radio has no room for both, and no robot knows that it is late
                    answer.sent_bytes -= len(answer.sends.pop(0).payload)
                if len(answer.sends) > MAX_SENDS:  # said here, as a robot may go on for ever before its action
                    raise ProtocolError(f"more than {MAX_SENDS} messages in one tick")
                if answer.sent_bytes > MAX_SENT_BYTES:
                    raise ProtocolError(f"messages of more than {MAX_SENT_BYTES} bytes in one tick")
            case MapReport():
                answer.map = message
            case Action():
                answer.action, answer.late = message, len(answer.sends) if self._may_be_late else 0
                # in real time several actions may come in one tick
                answer.events.extend(message.events)
                answer.event_values += values_in(message.events)
                if len(answer.events) > MAX_EVENTS or answer.event_values > MAX_EVENT_VALUES:
                    raise ProtocolError(f"more than {MAX_EVENTS} events or {MAX_EVENT_VALUES} values in one tick")
        return False

    def _came_before(self, robot: str, message: Send | MapReport | Action, tick: int) -> bool:
        """Whether a message repeats one that was taken."""
        return False

    def due(self, robots: Iterable[str], tick: int) -> list[str]:
        """Those of the robots whose action of this tick has not come."""
        actions = ((robot, self._answers[robot].action) for robot in robots)
        return [robot for robot, action in actions if action is None or action.tick < tick]

    def again(self, robot: str) -> None:
        """Forget what a robot answered to this tick: it is told the tick again, and answers all of it again."""
        self._answers[robot] = Answer(tries=self._answers[robot].tries)

    def take(self, robot: str, tick: int) -> Outputs:
        """A robot's answer to a tick."""
        answer, self._answers[robot] = self._answers[robot], Answer()
        return self._outputs(robot, answer, tick)

    def _outputs(self, robot: str, answer: Answer, tick: int) -> Outputs:
        raise NotImplementedError


_MESSAGES: dict[str, type[Send] | type[MapReport] | type[Action]] = {
    keys.RADIO: Send,
    keys.MAP: MapReport,
    keys.ACT: Action,
}


class LockstepAnswers(Answers):
    """Answers where the world waits for every robot that has joined. One that has not joined yet stands still.

    A tick is said again where a link was lost, and its answer may then come twice: for each time that a tick is said
    again, one answer too many is excused.
    """

    def __init__(self, robots: Iterable[str]) -> None:
        super().__init__(robots)
        self._excused = dict.fromkeys(self._answers, 0)

    def hear(self, robot: str, channel: str, payload: bytes, tick: int) -> bool:
        """Take a message of this tick; ProtocolError also for another tick, or messages that never add up."""
        super().hear(robot, channel, payload, tick)
        answer = self._answers[robot]
        action = answer.action
        if channel != keys.ACT or action is None or (action.tick, action.sent) == (tick, len(answer.sends)):
            return False
        answer.tries += 1
        if action.tick == tick and answer.tries <= TRIES:  # the others were lost with a link
            return True
        raise ProtocolError(
            f"an action of tick {action.tick} after {action.sent} messages, "
            f"where tick {tick} and {len(answer.sends)} were due"
        )

    def again(self, robot: str) -> None:
        """As above, and excuse the answer that may be on its way."""
        super().again(robot)
        self._excused[robot] += 1

    def _came_before(self, robot: str, message: Send | MapReport | Action, tick: int) -> bool:
        if not self._excused[robot] or (message.tick == tick and self._answers[robot].action is None):
            return False
        self._excused[robot] -= isinstance(message, Action)
        return True

    def _outputs(self, robot: str, answer: Answer, tick: int) -> Outputs:
        return Outputs(answer.sends, answer.action or _standing(tick), answer.map)


class RealTimeAnswers(Answers):
    """Answers where the clock ends a tick: each counts for the tick in which it arrives.

    A robot without an action goes on with its last one for one tick, then stands still until it answers.
    """

    _may_be_late = True

    def __init__(self, robots: Iterable[str], last: Mapping[str, Action]) -> None:
        """last: the last action of each robot that has answered, as the episode keeps them on."""
        super().__init__(robots)
        self._last = last
        self._missed = dict.fromkeys(self._answers, 0)

    def _outputs(self, robot: str, answer: Answer, tick: int) -> Outputs:
        action = answer.action
        self._missed[robot] = 0 if action is not None else self._missed[robot] + 1
        action = action or self._last.get(robot) or _standing(tick)
        now = {"tick": tick}
        said = {"sent": len(answer.sends), "events": answer.events}
        missed = {"step_ms": 0.0} if answer.action is None else {}
        stop = dict.fromkeys(("speed_mps", "turn_rps"), 0.0) if self._missed[robot] > 1 else {}
        return Outputs(
            [send.model_copy(update=now) for send in answer.sends],
            action.model_copy(update=now | said | missed | stop),
            answer.map and answer.map.model_copy(update=now),
        )


def _standing(tick: int) -> Action:
    return Action(tick=tick, speed_mps=0.0, turn_rps=0.0)
