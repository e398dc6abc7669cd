"""Values with a checksum, as checkpoints are kept: nothing is built of a file that was damaged."""

import zlib
from typing import Any

import msgpack

UNREADABLE = (ValueError, LookupError, TypeError, ArithmeticError, AttributeError, MemoryError, msgpack.UnpackException)
"""What bytes of any kind may raise where a record is opened and a state is made of its value."""


def sealed(value: Any) -> bytes:
    """A record: a value of msgpack, and the checksum (CRC-32) of its bytes."""
    data = msgpack.packb(value)
    return bytes(msgpack.packb((zlib.crc32(data), data)))


def opened(record: Any) -> Any:
    """The value of a record that msgpack has read. Raises one of UNREADABLE."""
    checksum, data = record
    if zlib.crc32(data) != checksum:
        raise ValueError("its checksum is wrong")
    return msgpack.unpackb(data, strict_map_key=False)
