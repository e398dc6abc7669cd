"""Bytes on the wires to the robots: read from the sockets, and as the messages explain them.

Linux tells each TCP connection's bytes (tcp_info); where there are none, nothing is told. What Zenoh puts around a
message was measured (facts of eclipse-zenoh 1.10, checked by a test): 12 bytes of frame, sequence number and key, the
length of the payload, and from the world, which serves one subscriber for all inputs of a robot, the key's last part.
"""

from __future__ import annotations

import os
import socket
import struct
import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

FRAME_BYTES = 12
"""Of every message on a declared key, beside the length of the payload."""

_RECEIVED_AT, _SENT_AT = 128, 200
"""Where tcp_info has bytes_received and bytes_sent (linux/tcp.h, since 4.19)."""


@dataclass
class Flow:
    """Messages in one direction."""

    messages: int = 0
    payload: int = 0
    overhead: int = 0
    """As explained."""

    def add(self, size: int, suffix: int) -> None:
        """Count a message of a payload's size, with so many bytes of key."""
        self.messages += 1
        self.payload += size
        self.overhead += FRAME_BYTES + suffix + max(1, (size.bit_length() + 6) // 7)

    def as_dict(self, wire: int) -> dict[str, Any]:
        """For JSON, beside the bytes of the socket."""
        explained = self.payload + self.overhead
        return {
            "messages": self.messages,
            "payload_bytes": self.payload,
            "overhead_bytes": self.overhead,
            "wire_bytes": wire,
            "unexplained_share": round((wire - explained) / wire, 6) if wire else 0.0,
        }


@dataclass
class Wire:
    """The links to all robots, from the moment that `begin` is called."""

    to_robot: defaultdict[str, Flow] = field(default_factory=lambda: defaultdict(Flow))
    from_robot: defaultdict[str, Flow] = field(default_factory=lambda: defaultdict(Flow))
    _ports: dict[str, int] = field(default_factory=dict)
    """Each robot's end of its link."""
    _before: dict[int, tuple[int, int]] = field(default_factory=dict)

    def begin(self, ports: Mapping[str, int]) -> None:
        """Count from here; ports: the robots' ends of their links."""
        self._ports = dict(ports)
        self._before = tcp_bytes(self._ports.values())
        self.to_robot.clear()
        self.from_robot.clear()

    def told(self, robot: str, channel: str, payload: bytes) -> None:
        """Count a message to a robot."""
        self.to_robot[robot].add(len(payload), len(channel) + 2)

    def heard(self, robot: str, payload: bytes) -> None:
        """Count a message from a robot."""
        self.from_robot[robot].add(len(payload), 0)

    def as_dict(self) -> dict[str, Any] | None:
        """Per robot and direction, for bandwidth.json; None where sockets tell nothing."""
        now = tcp_bytes(self._ports.values())
        robots = {}
        for robot, port in self._ports.items():
            if port in now and port in self._before:
                sent, received = (after - before for after, before in zip(now[port], self._before[port], strict=True))
                robots[robot] = {
                    "to_robot": self.to_robot[robot].as_dict(sent),
                    "from_robot": self.from_robot[robot].as_dict(received),
                }
        return robots or None


def tcp_bytes(ports: Iterable[int]) -> dict[int, tuple[int, int]]:
    """Bytes sent and received on this process's TCP connections to these ports of others."""
    wanted = set(ports)
    found: dict[int, tuple[int, int]] = {}
    if not sys.platform.startswith("linux"):
        return found
    for entry in Path("/proc/self/fd").iterdir():
        try:
            if not str(entry.readlink()).startswith("socket:"):
                continue
            with socket.socket(fileno=os.dup(int(entry.name))) as link:  # family and kind are found out by themselves
                port = link.getpeername()[1] if link.family in (socket.AF_INET, socket.AF_INET6) else None
                if port in wanted:
                    info = link.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 256)
                    sent, received = (
                        struct.unpack_from("<Q", info, _SENT_AT),
                        struct.unpack_from("<Q", info, _RECEIVED_AT),
                    )
                    found[port] = sent[0], received[0]
        except (OSError, struct.error):
            continue  # closed meanwhile, not connected, or an older kernel
    return found


def _long(info: bytes, at: int) -> int:
    value: int = struct.unpack_from("<Q", info, at)[0]
    return value
