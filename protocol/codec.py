"""Messages as msgpack: small, and the same bytes on every machine."""

from __future__ import annotations

from typing import TypeVar

import msgpack
from pydantic import ValidationError

from protocol.errors import ProtocolError
from protocol.messages import Message

MAX_MESSAGE_BYTES = 1 << 20
"""The transport refuses more (protocol.session); a map of 20,000 vertices has 360 kB."""

M = TypeVar("M", bound=Message)


def encode(message: Message) -> bytes:
    """Bytes of a message."""
    data: bytes = msgpack.packb(message.model_dump(), use_bin_type=True)
    return data


def decode(kind: type[M], data: bytes) -> M:
    """Message of the given kind from its bytes; raises ProtocolError on anything else."""
    if len(data) > MAX_MESSAGE_BYTES:
        raise ProtocolError(f"a {kind.__name__} of {len(data)} bytes; at most {MAX_MESSAGE_BYTES} are taken")
    try:
        fields = msgpack.unpackb(data, raw=False, use_list=True)
    except Exception as error:  # msgpack raises some ten unrelated types
        raise ProtocolError(f"no msgpack where a {kind.__name__} was due: {error}") from None
    if not isinstance(fields, dict):
        raise ProtocolError(f"a {kind.__name__} must be a map, not {type(fields).__name__}")
    try:
        return kind.model_validate(fields)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "message"
        raise ProtocolError(f"a bad {kind.__name__}: {where}: {first['msg']}") from None
    except RecursionError:
        raise ProtocolError(f"a bad {kind.__name__}: nested too deep") from None
