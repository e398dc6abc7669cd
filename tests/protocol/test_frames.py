"""The frames of others: they come as they were told, in the end over any radio, and what is bad is refused."""

import numpy as np
import pytest

from agent.communication.config import TalkConfig
from agent.communication.exchange import Exchange
from protocol.errors import ProtocolError
from protocol.frames import FRAMES, ToldFrames, in_messages
from protocol.geometry import Pose
from protocol.messages import MTU_BYTES, Heard
from protocol.talk import BEACON, Beacon
from protocol.wireframe import Wireframe

MANY: dict[str, Pose | None] = {f"r{k}": None if k % 5 == 0 else (k / 7, -k / 3, k / 40 - 1) for k in range(100)}


@pytest.mark.parametrize("mtu", [64, MTU_BYTES])
def test_they_come_as_they_were_told(mtu: int) -> None:
    messages = [some.encode() for some in in_messages(MANY, mtu)]
    assert max(map(len, messages)) <= mtu
    found = {name: frame for message in messages for name, frame in ToldFrames.decode(message).of.items()}
    assert found.keys() == MANY.keys()
    for name, frame in MANY.items():
        assert found[name] == (None if frame is None else pytest.approx(frame, abs=0.001))


@pytest.mark.parametrize(
    "data", [b"", b"\x10", b"\x11\x02r1", b"\x10\x02r1", b"\x10\x82R1", b"\x10\x80", b"\x10\x82r1\x82r1", b"\x10\x90r1"]
)
def test_what_is_bad_is_refused(data: bytes) -> None:
    with pytest.raises(ProtocolError):
        ToldFrames.decode(data)


def told(contact: int, ticks: int, frames: dict[str, Pose], talker: Exchange | None = None) -> list[ToldFrames]:
    """What robot a, whose contact with b begins at a tick, tells it of others in so many ticks."""
    talker, found = talker or Exchange(TalkConfig(), 5.0, MTU_BYTES), []
    for tick in range(contact, contact + ticks):
        beacon = Beacon(tick, (0.0, 0.0, 0.0)).encode()
        talker.hear(tick, [Heard(tick=tick, sender="b", kind=BEACON, payload=beacon)])
        sends = talker.talk(tick, (0.0, 0.0, 0.0), lambda _: Wireframe(), 0, frames=frames)
        found += [ToldFrames.decode(send.payload) for send in sends if send.kind == FRAMES and send.to == "b"]
    return found


def test_they_are_told_at_once_and_ever_less_often() -> None:
    frames: dict[str, Pose] = {"b": (0.0, 0.0, 0.0), "c": (1.0, 2.0, 0.5)}
    found = told(0, 2000, frames)
    assert len(found) == 7  # after 1, 2, 4 ... 64 of the 80 periods
    assert all(one.of.keys() == {"c"} for one in found)


def test_what_is_taken_back_is_told_too() -> None:
    talker = Exchange(TalkConfig(), 5.0, MTU_BYTES)
    both: dict[str, Pose] = {"b": (0.0, 0.0, 0.0), "c": (1.0, 2.0, 0.5)}
    assert [one.of["c"] is None for one in told(0, 100, both, talker)] == [False] * 3
    del both["c"]
    assert [one.of["c"] is None for one in told(100, 100, both, talker)] == [True] * 3


B, C = (0.0, 0.0, 0.0), (1.0, 2.0, 0.5)
OTHER = (1.0, 2.6, 0.5)


@pytest.mark.parametrize("silence", [0, 100])
@pytest.mark.parametrize("left", [{"b": B}, {}])
def test_what_is_taken_back_is_told_in_a_later_contact_too_and_to_who_is_merged_no_more(silence, left) -> None:
    talker = Exchange(TalkConfig(), 5.0, MTU_BYTES)
    told(0, 100, {"b": B, "c": C}, talker)
    for tick in range(100, 100 + silence):
        talker.hear(tick, [])
        talker.talk(tick, B, lambda _: Wireframe(), 0, frames=left)
    assert [one.of for one in told(100 + silence, 100, left, talker)] == [{"c": None}] * 3


def test_a_frame_that_contradicts_the_one_told_is_told_at_once() -> None:
    talker = Exchange(TalkConfig(), 5.0, MTU_BYTES)
    assert len(told(0, 450, {"b": B, "c": C}, talker)) == 5
    near = (1.0, 2.3, 0.5)
    assert not told(450, 100, {"b": B, "c": near}, talker)
    found = told(550, 50, {"b": B, "c": OTHER}, talker)
    assert [one.of["c"] for one in found] == [pytest.approx(OTHER, abs=0.001)] * 2


def test_nobody_is_told_of_itself_nor_alone() -> None:
    assert not told(0, 200, {"b": (0.0, 0.0, 0.0)})
    assert not told(0, 200, {"c": (0.0, 0.0, 0.0)})  # it has not merged b


def test_a_lossy_radio_brings_them() -> None:
    rng = np.random.default_rng(0)
    assert all(any(rng.random() > 0.3 for _ in told(0, 500, {"b": (0, 0, 0), "c": (1, 2, 0)})) for _ in range(20))
