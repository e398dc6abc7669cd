"""What robots answer to a tick, message by message."""

import pytest

from protocol import keys
from protocol.codec import encode
from protocol.errors import ProtocolError
from protocol.messages import MAX_EVENT_VALUES, Action, Event
from world.shell.answers import RealTimeAnswers


def test_several_actions_of_a_tick_say_no_more_events_than_one_may() -> None:
    answers = RealTimeAnswers(["r1"], {})
    many = [Event(event="e", data={"v": [None] * (MAX_EVENT_VALUES - 1)})]
    said = encode(Action(tick=0, speed_mps=0.0, turn_rps=0.0, events=many))
    for tick in range(3):
        answers.hear("r1", keys.ACT, said, tick)
        answers.take("r1", tick)
    answers.hear("r1", keys.ACT, said, 3)
    with pytest.raises(ProtocolError, match="10000 values in one tick"):
        answers.hear("r1", keys.ACT, said, 3)
