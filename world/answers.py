"""What robots answer to a tick, gathered message by message."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from protocol import keys
from protocol.codec import decode
from protocol.errors import ProtocolError
from protocol.messages import Action, Event, MapReport, Send
from world.tick import Outputs


@dataclass
class Answer:
    """What one robot said since its last action was taken."""

    sends: list[Send] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    map: MapReport | None = None
    action: Action | None = None
    """The last message of a tick; None until it comes."""


class Answers:
    """The answers of all robots."""

    late_ticks = 0
    """Ticks in which a robot's action of that tick did not come."""

    def __init__(self, robots: Iterable[str]) -> None:
        self._answers = {robot: Answer() for robot in robots}

    def hear(self, robot: str, channel: str, payload: bytes, tick: int) -> None:
        """Take a message at a tick. Raises ProtocolError for bytes that are none."""
        answer = self._answers[robot]
        match channel:
            case keys.RADIO:
                answer.sends.append(decode(Send, payload))
            case keys.MAP:
                answer.map = decode(MapReport, payload)
            case keys.ACT:
                answer.action = decode(Action, payload)
                answer.events.extend(answer.action.events)

    def due(self, robots: Iterable[str]) -> list[str]:
        """Those of the robots whose action has not come."""
        return [robot for robot in robots if self._answers[robot].action is None]

    def take(self, robot: str, tick: int) -> Outputs:
        """A robot's answer to a tick."""
        answer, self._answers[robot] = self._answers[robot], Answer()
        return self._outputs(robot, answer, tick)

    def _outputs(self, robot: str, answer: Answer, tick: int) -> Outputs:
        raise NotImplementedError


class LockstepAnswers(Answers):
    """Answers where the world waits for every robot's action; only those that are not `due` may be taken."""

    def hear(self, robot: str, channel: str, payload: bytes, tick: int) -> None:
        """Take a message of this tick; ProtocolError also for another tick or lost messages."""
        super().hear(robot, channel, payload, tick)
        answer = self._answers[robot]
        action = answer.action
        if channel == keys.ACT and action and (action.tick, action.sent) != (tick, len(answer.sends)):
            raise ProtocolError(
                f"an action of tick {action.tick} after {action.sent} messages, "
                f"where tick {tick} and {len(answer.sends)} were due"
            )

    def _outputs(self, robot: str, answer: Answer, tick: int) -> Outputs:
        assert answer.action is not None
        return Outputs(answer.sends, answer.action, answer.map)


class RealTimeAnswers(Answers):
    """Answers where the clock ends a tick: each counts for the tick in which it arrives.

    A robot without an action goes on with its last one for one tick, then stands still until it answers.
    """

    def __init__(self, robots: Iterable[str]) -> None:
        super().__init__(robots)
        self._last: dict[str, Action] = {}
        self._missed = dict.fromkeys(self._answers, 0)

    def _outputs(self, robot: str, answer: Answer, tick: int) -> Outputs:
        action = answer.action
        if action is None or action.tick < tick:
            self.late_ticks += 1
        self._missed[robot] = 0 if action is not None else self._missed[robot] + 1
        action = action or self._last.get(robot) or Action(tick=tick, speed_mps=0.0, turn_rps=0.0)
        self._last[robot] = action
        now = {"tick": tick}
        said = {"sent": len(answer.sends), "events": answer.events}
        stop = dict.fromkeys(("speed_mps", "turn_rps"), 0.0) if self._missed[robot] > 1 else {}
        return Outputs(
            [send.model_copy(update=now) for send in answer.sends],
            action.model_copy(update=now | said | stop),
            answer.map and answer.map.model_copy(update=now),
        )
