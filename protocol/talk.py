"""Messages between robots, in few bytes: beacons, parts of maps, acknowledgements (docs/protocol.md).

The two other kinds are in `protocol.viewpoints` and `protocol.frames`. Who sends and takes all of them is
`agent.communication.exchange`.
"""

import math
import struct
from typing import NamedTuple

from protocol.errors import ProtocolError
from protocol.geometry import Pose
from protocol.wireframe import MAX_COORDINATE_M

BEACON = "beacon"
MAP = "map"  # a whole map
DELTA = "delta"  # the changes since a map that the receiver has acknowledged
RESEND = "resend"  # parts of a map or of changes that are sent again because they were not acknowledged in time
ACK = "ack"

VERSION = 1
MAX_SENDS = 256  # messages of one robot in one tick (ours). A map has 64 parts at most, that of a building two
MAX_PARTS = 64  # parts of one map (ours): room for 75 kB, and for 3 kB where a message has 64 bytes
MAX_BODY = 65_536  # bytes of one map in all its parts (ours)

_HEAD = struct.Struct("<BI")  # of a beacon
_POSE = struct.Struct("<iiH")
POSE_BYTES = _POSE.size
_TURN = 65_536
_SINGLE, _PARTIAL, _UNKNOWN = 1, 1, 2
"""Flags in the lowest bits of the first byte: _SINGLE of a part that is all; the others of an acknowledgement, for
parts that are missing and for a base that is not known."""


class Beacon(NamedTuple):
    """The sender's pose."""

    tick: int
    pose: Pose  # of the sender in its own frame: to 1 mm and 0.006 degrees

    def encode(self) -> bytes:
        """15 bytes."""
        return _HEAD.pack(VERSION << 4, self.tick) + pose_bytes(self.pose)

    @classmethod
    def decode(cls, data: bytes) -> "Beacon":
        """Raises ProtocolError on anything else than a beacon."""
        if check_version(data) or len(data) != _HEAD.size + POSE_BYTES:
            raise ProtocolError(f"a beacon with flags, or of {len(data)} bytes instead of {_HEAD.size + POSE_BYTES}")
        _, tick = _HEAD.unpack_from(data)
        return cls(tick, take_pose(data, _HEAD.size)[0])


class Part(NamedTuple):
    """One part of a map, or of changes to one, that fits into a message."""

    version: int  # tick of the sender's map. A newer map has a higher version, but where its clock was put back
    base: int  # version to which the changes apply, which the receiver has acknowledged; 0 for a whole map
    number: int  # of this part, from 0
    parts: int  # number of parts
    body: bytes

    def encode(self) -> bytes:
        """The part's message: 3 to 13 bytes more than the body."""
        numbers = [self.version, self.version - self.base if self.base else 0]
        numbers += [self.number, self.parts] if self.parts > 1 else []
        return first_byte(_SINGLE if self.parts == 1 else 0) + b"".join(map(varint, numbers)) + self.body

    @classmethod
    def decode(cls, data: bytes) -> "Part":
        """Raises ProtocolError on anything else than a part, and on too many parts."""
        flags = check_version(data)
        version, at = take_varint(data, 1)
        back, at = take_varint(data, at)
        index, count = 0, 1
        if flags != _SINGLE:
            index, at = take_varint(data, at)
            count, at = take_varint(data, at)
            if flags or not 1 < count <= MAX_PARTS or index >= count:
                raise ProtocolError(f"part {index + 1} of {count} of a map; at most {MAX_PARTS} are taken")
        if back >= version:
            raise ProtocolError("changes to a map of the future")
        return cls(version, version - back if back else 0, index, count, data[at:])


class Ack(NamedTuple):
    """The receiver's answer to a map: which parts of it have arrived."""

    version: int  # 0 in HAS_NO_MAP
    missing: frozenset[int] | None = frozenset()
    """Parts that have not arrived; empty when the map is whole; None when the base of the changes is not there."""

    def encode(self, count: int = 1) -> bytes:
        """2 to 14 bytes; `count` is the number of parts."""
        flags = _UNKNOWN if self.missing is None else _PARTIAL if self.missing else 0
        bits = sum(1 << index for index in self.missing or ())
        return first_byte(flags) + varint(self.version) + bits.to_bytes((count + 7) // 8 if bits else 0)

    @classmethod
    def decode(cls, data: bytes) -> "Ack":
        """Raises ProtocolError on anything else than an acknowledgement."""
        flags = check_version(data)
        version, at = take_varint(data, 1)
        rest = data[at:]
        if len(rest) > MAX_PARTS // 8 or {bool(rest), any(rest)} != {flags == _PARTIAL} or flags > _UNKNOWN:
            raise ProtocolError("an acknowledgement of parts that are none")
        if flags == _UNKNOWN:
            return cls(version, None)
        bits = int.from_bytes(rest)
        return cls(version, frozenset(index for index in range(8 * len(rest)) if bits >> index & 1))


HAS_NO_MAP = Ack(0, None)
"""The receiver has no map of the sender at all: it has just met it, or has begun anew."""


def in_parts(version: int, base: int, body: bytes, mtu: int) -> list[Part]:
    """The parts of a body, each message of at most `mtu` bytes; raises ProtocolError for too long a body."""
    if len(body) > MAX_BODY:
        raise ProtocolError(f"a map of {len(body)} bytes; at most {MAX_BODY} travel")
    whole = Part(version, base, 0, 1, body)
    if len(whole.encode()) <= mtu:
        return [whole]
    room = mtu - len(Part(version, base, MAX_PARTS - 1, MAX_PARTS, b"").encode())
    pieces = [body[at : at + room] for at in range(0, len(body), room)]
    if len(pieces) > MAX_PARTS:
        raise ProtocolError(f"a map of {len(pieces)} parts; at most {MAX_PARTS} travel")
    return [Part(version, base, index, len(pieces), piece) for index, piece in enumerate(pieces)]


def pose_bytes(pose: Pose) -> bytes:
    """A pose to 1 mm and 0.006 degrees."""
    x, y, theta = pose
    return _POSE.pack(round(1000 * x), round(1000 * y), turn_of(theta))


def take_pose(data: bytes, at: int) -> tuple[Pose, int]:
    """A pose at a place in a message, and the place after it; raises ProtocolError where there is none."""
    if at + POSE_BYTES > len(data):
        raise ProtocolError("a message ends in the middle of a pose")
    x, y, turn = _POSE.unpack_from(data, at)
    if max(abs(x), abs(y)) > 1000 * MAX_COORDINATE_M:
        raise ProtocolError("a pose from out of bounds")
    return (x / 1000, y / 1000, angle_of(turn)), at + POSE_BYTES


def turn_of(theta: float) -> int:
    """An angle in radians as a part of a turn, in two bytes."""
    return round(theta / (2 * math.pi) * _TURN) % _TURN


def angle_of(turn: int) -> float:
    """The angle in radians, (-pi, pi], that `turn_of` gave as a part of a turn."""
    theta = turn / _TURN * 2 * math.pi
    return theta - 2 * math.pi * (theta > math.pi)


def first_byte(flags: int) -> bytes:
    """First byte of a message: the version, and flags below 16."""
    return bytes([VERSION << 4 | flags])


def check_version(data: bytes) -> int:
    """Flags of the first byte; raises ProtocolError for another version."""
    if not data:
        raise ProtocolError("an empty message")
    if data[0] >> 4 != VERSION:
        raise ProtocolError(f"a message of version {data[0] >> 4}; this program reads version {VERSION}")
    return data[0] & 0xF


def varint(value: int) -> bytes:
    """Seven bits a byte, the lowest first, the highest bit set where more follow (LEB128)."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def take_varint(data: bytes, at: int) -> tuple[int, int]:
    """A number at a place, and the place after it."""
    value = 0
    for shift in range(0, 42, 7):
        if at >= len(data):
            raise ProtocolError("a message ends in the middle of a number")
        value |= (data[at] & 0x7F) << shift
        at += 1
        if data[at - 1] < 0x80:
            if shift and not data[at - 1]:
                raise ProtocolError("a number in a message has more bytes than it needs")
            return value, at
    raise ProtocolError("a number in a message is too large")
