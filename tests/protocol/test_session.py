"""Bytes on the wires: the sockets' counts, and that payload and overhead explain them."""

import json
import socket
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from deploy.launch.launcher import launch
from tests.tiny import tiny_config
from tests.wanderer import Wanderer
from world.shell.wire import Wire

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="tcp_info is Linux's")


def test_connections_are_known_by_their_far_ends_and_those_of_a_robot_add_up() -> None:
    wire, payloads = Wire(), (1000, 20)
    with socket.create_server(("127.0.0.1", 0)) as server:
        for size in payloads:
            with socket.create_connection(server.getsockname()) as far:
                near, _ = server.accept()
                with near:
                    near.sendall(b"before it is followed")
                    wire.follow({"r1": f"tcp/127.0.0.1:{far.getsockname()[1]}", "r2": "tcp/127.0.0.1:1"})
                    wire.told("r1", "obs", bytes(size))
                    near.sendall(bytes(size))
                    far.sendall(bytes(300))
                    far.recv(size, socket.MSG_WAITALL)
                    near.recv(300, socket.MSG_WAITALL)
        figures = wire.close()
    assert figures is not None and list(figures) == ["r1"]
    assert figures["r1"]["to_robot"]["wire_bytes"] == figures["r1"]["to_robot"]["payload_bytes"] == sum(payloads)
    assert figures["r1"]["from_robot"]["wire_bytes"] == 600


def test_robots_on_two_hosts_may_have_the_same_port() -> None:
    """The bytes of both were one robot's."""
    wire, hosts = Wire(), {"r1": "127.0.0.2", "r2": "127.0.0.3"}
    with socket.create_server(("127.0.0.1", 0)) as server, ExitStack() as stack:
        port, ends = 0, {}
        for robot, host in hosts.items():
            far = stack.enter_context(socket.create_connection(server.getsockname(), source_address=(host, port)))
            ends[robot], port = stack.enter_context(server.accept()[0]), far.getsockname()[1]
        wire.follow({robot: f"tls/{host}:{port}" for robot, host in hosts.items()})
        for size, end in enumerate(ends.values(), 1):
            end.sendall(bytes(size))
        figures = wire.close()
    assert figures is not None and [told["to_robot"]["wire_bytes"] for told in figures.values()] == [1, 2]


@pytest.mark.parametrize("faults", [[], ["r2@100"]])
def test_payload_and_overhead_explain_the_wire_to_a_hundredth(tmp_path: Path, faults: list[str]) -> None:
    """Also where a process comes back: bandwidth.json had no bytes of its links."""
    config = tiny_config(tmp_path, until=60.0, faults=faults)
    launch(config, tmp_path / "run", make_mind=Wanderer)
    wire = json.loads((tmp_path / "run" / "bandwidth.json").read_text())["wire"]
    assert list(wire) == ["r1", "r2", "r3"]
    for robot in wire.values():
        assert robot["to_robot"]["messages"] >= 300 and robot["from_robot"]["messages"] >= 300
        for flow in robot.values():
            assert flow["wire_bytes"] > flow["payload_bytes"] > 0
            assert abs(flow["wire_bytes"] - flow["payload_bytes"] - flow["overhead_bytes"]) <= 0.01 * flow["wire_bytes"]
