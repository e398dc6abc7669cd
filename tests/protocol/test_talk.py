"""Beacons, parts and acknowledgements come back as they were; of beacons and parts no other encoding is taken."""

import pytest

from protocol.errors import ProtocolError
from protocol.messages import MAX_TICK
from protocol.talk import MAX_PARTS, Ack, Beacon, Part, take_varint, varint

BEACON = Beacon(7, (1.0, -2.0, 0.5)).encode()


@pytest.mark.parametrize("value", [0, 1, 127, 128, 16_383, 16_384, MAX_TICK])
def test_a_number_takes_no_more_bytes_than_it_needs(value: int) -> None:
    data = varint(value)
    assert take_varint(data, 0) == (value, len(data))
    with pytest.raises(ProtocolError, match="more bytes than it needs"):
        take_varint(data[:-1] + bytes([data[-1] | 0x80, 0]), 0)


@pytest.mark.parametrize(
    ("part", "more"),
    [
        (Part(1, 0, 0, 1, b"ab"), 3),
        (Part(9, 4, 1, 3, b"ab"), 5),
        (Part(MAX_TICK, 1, MAX_PARTS - 1, MAX_PARTS, b""), 13),
    ],
)
def test_a_part_comes_back_as_it_was_and_with_other_flags_never(part: Part, more: int) -> None:
    data = part.encode()
    assert Part.decode(data) == part and len(data) == len(part.body) + more
    for flags in range(2, 16):
        with pytest.raises(ProtocolError):
            Part.decode(bytes([data[0] | flags]) + data[1:])


def test_a_part_that_is_all_is_told_by_its_flag() -> None:
    with pytest.raises(ProtocolError, match="part 1 of 1"):
        Part.decode(b"\x10\x09\x00\x00\x01ab")


@pytest.mark.parametrize("missing", [frozenset[int](), frozenset({0}), frozenset({3, MAX_PARTS - 1}), None])
def test_an_acknowledgement_comes_back_as_it_was(missing: frozenset[int] | None) -> None:
    data = Ack(MAX_TICK, missing).encode(MAX_PARTS)
    assert Ack.decode(data) == Ack(MAX_TICK, missing) and len(data) in (6, 14)


@pytest.mark.parametrize("data", [b"\x11\x09", b"\x11\x09\x00", b"\x10\x09\x00", b"\x12\x09\x01", b"\x13\x09\x01"])
def test_an_acknowledgement_of_parts_that_are_none_is_refused(data: bytes) -> None:
    with pytest.raises(ProtocolError, match="parts that are none"):
        Ack.decode(data)


@pytest.mark.parametrize("data", [bytes([BEACON[0] | 1]) + BEACON[1:], BEACON[:-1], BEACON + b"\0"])
def test_a_beacon_has_no_flags_and_one_length(data: bytes) -> None:
    assert Beacon.decode(BEACON).tick == 7
    with pytest.raises(ProtocolError, match="beacon"):
        Beacon.decode(data)
