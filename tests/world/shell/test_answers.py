"""What robots answer to a tick, message by message."""

import pytest

from protocol import keys
from protocol.codec import encode
from protocol.errors import ProtocolError
from protocol.messages import EVERYONE, MAX_EVENT_VALUES, Action, Event, Send
from protocol.talk import MAX_SENDS
from world.shell.answers import MAX_SENT_BYTES, LockstepAnswers, RealTimeAnswers


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


@pytest.mark.parametrize("size", [1, MAX_SENT_BYTES // MAX_SENDS])
def test_of_two_ticks_messages_that_come_in_one_the_newest_are_taken(size: int) -> None:
    """A robot that was late by a tick was given up for more messages than it may send in one."""
    answers = RealTimeAnswers(["r1"], {})
    said = [bytes([number]) * size for number in range(200)]
    for tick in (4, 5):
        for payload in said:
            answers.hear("r1", keys.RADIO, encode(Send(tick=tick, to=EVERYONE, kind="ack", payload=payload)), 5)
        answers.hear("r1", keys.ACT, encode(Action(tick=tick, speed_mps=0.0, turn_rps=0.0, sent=len(said))), 5)
    sends, action, _ = answers.take("r1", 5)
    assert [send.payload for send in sends] == [*said, *said][-MAX_SENDS:] and action.sent == len(sends)


def test_a_robot_that_sends_without_end_is_refused_also_after_an_action() -> None:
    answers = RealTimeAnswers(["r1"], {})
    answers.hear("r1", keys.ACT, encode(Action(tick=4, speed_mps=0.0, turn_rps=0.0)), 5)
    said = encode(Send(tick=5, to=EVERYONE, kind="ack", payload=b""))
    for _ in range(MAX_SENDS):
        answers.hear("r1", keys.RADIO, said, 5)
    with pytest.raises(ProtocolError, match="more than 256 messages in one tick"):
        answers.hear("r1", keys.RADIO, said, 5)


def test_in_lockstep_no_message_is_late() -> None:
    answers = LockstepAnswers(["r1"])
    said = encode(Send(tick=5, to=EVERYONE, kind="ack", payload=b""))
    for _ in range(MAX_SENDS):
        answers.hear("r1", keys.RADIO, said, 5)
    answers.hear("r1", keys.ACT, encode(Action(tick=5, speed_mps=0.0, turn_rps=0.0, sent=MAX_SENDS)), 5)
    with pytest.raises(ProtocolError, match="more than 256 messages in one tick"):
        answers.hear("r1", keys.RADIO, said, 5)
