"""Messages as msgpack: small, and the same bytes on every machine."""

from typing import Any, TypeVar

import msgpack
from pydantic import ValidationError

from protocol.errors import ProtocolError
from protocol.messages import MOST_LINKS, Join, Message

MAX_FRAME_BYTES = 1 << 20  # the transport refuses larger frames (protocol.session). A map of 20,000 vertices has 360 kB
MAX_MESSAGE_BYTES = MAX_FRAME_BYTES - 4096  # room in a frame beside key and framing, which take less than 100 B (ours)
MOST_BYTES: dict[type[Message], int] = {Join: 512}  # anybody may ask; with the longest words a Join has 120 (ours)
_LONGEST = dict.fromkeys(("max_array_len", "max_map_len"), MOST_LINKS)  # no list is longer, in no message

M = TypeVar("M", bound=Message)


def encode(message: Message) -> bytes:
    """Bytes of a message; raises ProtocolError for a message that is too large for any receiver."""
    data: bytes = msgpack.packb(message.model_dump(), use_bin_type=True)
    _check_size(type(message), data)
    return data


def decode(kind: type[M], data: bytes) -> M:
    """Message of the given kind from its bytes; raises ProtocolError on anything else."""
    _check_size(kind, data)
    try:
        fields = msgpack.unpackb(data, raw=False, use_list=True, object_pairs_hook=_of_single_keys, **_LONGEST)
    except Exception as error:  # msgpack raises some ten unrelated types
        raise ProtocolError(f"no msgpack where a {kind.__name__} was due: {error}") from None
    if not isinstance(fields, dict):
        raise ProtocolError(f"a {kind.__name__} must be a map, not {type(fields).__name__}")
    try:
        return kind.model_validate(fields)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ascii(".".join(str(part) for part in first["loc"]))[1:100].rstrip("'") or "message"  # or hostile keys
        raise ProtocolError(f"a bad {kind.__name__}: {where}: {first['msg']}") from None


def _of_single_keys(pairs: list[tuple[Any, Any]]) -> dict[Any, Any]:
    fields = dict(pairs)
    if len(fields) < len(pairs):
        raise ValueError("a key twice")
    return fields


def _check_size(kind: type[Message], data: bytes) -> None:
    most = MOST_BYTES.get(kind, MAX_MESSAGE_BYTES)
    if len(data) > most:
        raise ProtocolError(f"a {kind.__name__} of {len(data)} bytes; at most {most} are taken")
