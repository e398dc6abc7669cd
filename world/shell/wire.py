"""Bytes on the links to the robots: as the sockets count them, and as the messages explain them.

Linux counts the bytes of each TCP connection (tcp_info); elsewhere there is no count. Zenoh's overhead per message
was measured with eclipse-zenoh 1.10, and a test checks it: 12 bytes of frame, sequence number and key, and the length
of the payload. A message to a robot also carries the last part of its key, because one subscriber takes all inputs.
"""

import ipaddress
import os
import re
import socket
import struct
import sys
from collections import defaultdict
from collections.abc import Collection, Mapping
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


FarEnd = tuple[ipaddress.IPv4Address | ipaddress.IPv6Address, int]
"""Address and port of the other end of a TCP connection; on two hosts ports may be the same."""


@dataclass
class _Connection:
    """The connection to a robot's process."""

    far_end: FarEnd
    end: socket.socket  # a duplicate of the world's end, which tells its bytes even after Zenoh has closed its own
    before: tuple[int, int]  # bytes sent and received before it was followed

    def close(self) -> tuple[int, int]:
        """Bytes sent and received since it was followed, whatever comes later."""
        with self.end:
            sent, received = _bytes_of(self.end)
        return sent - self.before[0], received - self.before[1]


class Wire:
    """The links to all robots, each from the moment that it is followed."""

    def __init__(self) -> None:
        self._links: dict[str, _Connection] = {}
        self._ended: dict[str, tuple[int, int]] = {}
        """Bytes sent and received on links to earlier processes of robots."""
        self.to_robot: defaultdict[str, Flow] = defaultdict(Flow)
        self.from_robot: defaultdict[str, Flow] = defaultdict(Flow)

    def follow(self, locators: Mapping[str, str]) -> None:
        """Count from now on what these links carry beside earlier ones.

        locators: the robots' ends as Zenoh writes them, such as tcp/127.0.0.1:7447; others than of TCP are left out.
        """
        known = {robot: link.far_end for robot, link in self._links.items()}
        far_ends = {robot: far_end for robot, locator in locators.items() if (far_end := _far_end(locator))}
        new = {far_end: robot for robot, far_end in far_ends.items() if known.get(robot) != far_end}
        ends = _connections(new)
        for far_end, robot in new.items():
            if far_end in ends:
                self._part(robot)
                self._links[robot] = _Connection(far_end, ends[far_end], _bytes_of(ends[far_end]))

    def _part(self, robot: str) -> None:
        so_far = self._ended.setdefault(robot, (0, 0))
        if robot in self._links:
            sent, received = self._links.pop(robot).close()
            self._ended[robot] = so_far[0] + sent, so_far[1] + received

    def told(self, robot: str, channel: str, payload: bytes) -> None:
        """Count a message to a robot."""
        self.to_robot[robot].add(len(payload), len(channel) + 2)

    def heard(self, robot: str, payload: bytes) -> None:
        """Count a message from a robot."""
        self.from_robot[robot].add(len(payload), 0)

    def close(self) -> dict[str, Any] | None:
        """End the count: per robot and direction, for bandwidth.json; None where the system does not count."""
        for robot in list(self._links):
            self._part(robot)
        robots = {}
        for robot, (sent, received) in self._ended.items():
            to_robot, from_robot = self.to_robot[robot].as_dict(sent), self.from_robot[robot].as_dict(received)
            robots[robot] = {"to_robot": to_robot, "from_robot": from_robot}
        return robots or None


def _far_end(locator: str) -> FarEnd | None:
    match = re.fullmatch(r"[a-z]+/\[?([0-9a-f.:]+)(?:%\w+)?]?:(\d+)", locator)
    return None if match is None else (ipaddress.ip_address(match[1]), int(match[2]))


def _connections(far_ends: Collection[FarEnd]) -> dict[FarEnd, socket.socket]:
    """Duplicates of this process's TCP connections to these ends; none where the system does not count."""
    found: dict[FarEnd, socket.socket] = {}
    if not far_ends or not sys.platform.startswith("linux"):
        return found
    for entry in Path("/proc/self/fd").iterdir():
        try:
            if not str(entry.readlink()).startswith("socket:"):
                continue
            link = socket.socket(fileno=os.dup(int(entry.name)))
        except OSError:
            continue  # closed meanwhile
        try:
            if link.family in (socket.AF_INET, socket.AF_INET6):
                host, port = link.getpeername()[:2]
                far_end = ipaddress.ip_address(host.partition("%")[0]), port
                if far_end in far_ends and far_end not in found:
                    _bytes_of(link)
                    found[far_end] = link
                    continue
        except (OSError, struct.error):
            pass  # not connected, or an older kernel
        link.close()
    return found


def _bytes_of(link: socket.socket) -> tuple[int, int]:
    """Bytes sent and received on a TCP connection. Raises OSError, struct.error where the kernel does not count."""
    info = link.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 256)
    sent, received = (struct.unpack_from("<Q", info, at)[0] for at in (_SENT_AT, _RECEIVED_AT))
    return sent, received
