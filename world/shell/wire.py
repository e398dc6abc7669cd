"""Bytes on the links to the robots: as the sockets count them, and as the messages explain them.

Linux counts the bytes of each TCP connection (tcp_info); elsewhere there is no count. Zenoh's overhead per message
was measured with eclipse-zenoh 1.10, and a test checks it: 12 bytes of frame, sequence number and key, and the length
of the payload. A message to a robot also carries the last part of its key, because one subscriber takes all inputs.
"""

import os
import socket
import struct
import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FRAME_BYTES = 12  # that Zenoh adds to a message on a declared key, without the field for the length of the payload

_RECEIVED_AT, _SENT_AT = 128, 200
"""Offsets of bytes_received and bytes_sent in tcp_info (linux/tcp.h, since Linux 4.19)."""


@dataclass
class Flow:
    """Messages in one direction."""

    messages: int = 0
    payload: int = 0
    overhead: int = 0  # bytes that Zenoh adds, as computed

    def add(self, size: int, suffix: int) -> None:
        """Count a message: bytes of its payload, and bytes of its key."""
        self.messages += 1
        self.payload += size
        self.overhead += FRAME_BYTES + suffix + max(1, (size.bit_length() + 6) // 7)

    def as_dict(self, wire: int) -> dict[str, Any]:
        """For JSON; `wire` is the socket's count of bytes."""
        unexplained = wire - self.payload - self.overhead
        return {
            "messages": self.messages,
            "payload_bytes": self.payload,
            "overhead_bytes": self.overhead,
            "wire_bytes": wire,
            "unexplained_share": round(unexplained / wire, 6) if wire else 0.0,
        }


class Wire:
    """The links to all robots, from the moment that `begin` is called."""

    def __init__(self) -> None:
        self.begin({})

    def begin(self, ports: Mapping[str, int]) -> None:
        """Begin to count; `ports` are those of the robots' ends of the links."""
        self._ports, self._before = ports, tcp_bytes(ports.values())
        self.to_robot: defaultdict[str, Flow] = defaultdict(Flow)
        self.from_robot: defaultdict[str, Flow] = defaultdict(Flow)

    def told(self, robot: str, channel: str, payload: bytes) -> None:
        """Count a message to a robot."""
        self.to_robot[robot].add(len(payload), len(channel) + 2)

    def heard(self, robot: str, payload: bytes) -> None:
        """Count a message from a robot."""
        self.from_robot[robot].add(len(payload), 0)

    def as_dict(self) -> dict[str, Any] | None:
        """Per robot and direction, for bandwidth.json; None where the system does not count."""
        now = tcp_bytes(self._ports.values())
        robots = {}
        for robot, port in self._ports.items():
            if port in now and port in self._before:
                sent, received = (after - before for after, before in zip(now[port], self._before[port], strict=True))
                to_robot, from_robot = self.to_robot[robot].as_dict(sent), self.from_robot[robot].as_dict(received)
                robots[robot] = {"to_robot": to_robot, "from_robot": from_robot}
        return robots or None


def tcp_bytes(ports: Iterable[int]) -> dict[int, tuple[int, int]]:
    """Bytes sent and received on this process's TCP connections to these ports of others."""
    wanted, found = set(ports), {}
    if not sys.platform.startswith("linux"):
        return {}
    for entry in Path("/proc/self/fd").iterdir():
        try:
            if not str(entry.readlink()).startswith("socket:"):
                continue
            with socket.socket(fileno=os.dup(int(entry.name))) as link:
                port = link.getpeername()[1] if link.family in (socket.AF_INET, socket.AF_INET6) else None
                if port in wanted:
                    info = link.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 256)
                    found[port] = tuple(struct.unpack_from("<Q", info, at)[0] for at in (_SENT_AT, _RECEIVED_AT))
        except (OSError, struct.error):
            continue  # closed meanwhile, not connected, or an older kernel
    return found
