"""Where the frames of others lie, for peers that may know those others, too (ours; docs/protocol.md).

A robot that has merged a peer's map tells it the transforms of all other peers that it has merged. Each is told again
after twice as long as the last time, so that a lossy radio brings it in the end, and a good one costs little.
"""

import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from protocol.errors import ProtocolError
from protocol.geometry import Pose
from protocol.messages import ID
from protocol.talk import POSE_BYTES, check_version, first_byte, pose_bytes, take_pose

FRAMES = "frames"  # kind of message, as in radio.csv
_GONE = 0x80
"""Flag in the byte of a name's length: the frame told before no longer holds."""
_MOST_BYTES = 17 + POSE_BYTES  # of one frame with its name


class ToldFrames(NamedTuple):
    """Frames of others in the sender's."""

    of: Mapping[str, Pose | None]
    """By name: to 1 mm and 0.006 degrees; None where the sender has taken back what it told."""

    def encode(self) -> bytes:
        """Eleven bytes and a name for each."""
        parts = [first_byte(0)]
        for name, frame in self.of.items():
            parts += [bytes([len(name) | (_GONE if frame is None else 0)]), name.encode()]
            parts += [] if frame is None else [pose_bytes(frame)]
        return b"".join(parts)

    @classmethod
    def decode(cls, data: bytes) -> "ToldFrames":
        """Raises ProtocolError on anything else than frames of one robot each."""
        if check_version(data) or len(data) < 2:
            raise ProtocolError("a message about frames that is none")
        found: dict[str, Pose | None] = {}
        at = 1
        while at < len(data):
            first, end = at + 1, at + 1 + (data[at] & ~_GONE)
            name = data[first:end].decode("ascii", "replace")
            if end > len(data) or not re.fullmatch(ID, name) or name in found:
                raise ProtocolError("a frame of nobody, or a second one of a robot")
            found[name], at = (None, end) if data[at] & _GONE else take_pose(data, end)
        return cls(found)


def in_messages(frames: Mapping[str, Pose | None], mtu: int) -> Iterator[ToldFrames]:
    """Frames in as many messages as they need, each of at most `mtu` bytes."""
    names, most = list(frames), (mtu - 1) // _MOST_BYTES
    for at in range(0, len(names), most):
        yield ToldFrames({name: frames[name] for name in names[at : at + most]})
