"""Bytes on the wires: the sockets' counts, and that payload and overhead explain them."""

import json
import socket
import sys
from pathlib import Path

import pytest

from deploy.launch.launcher import launch
from tests.tiny import tiny_config
from tests.wanderer import Wanderer
from world.shell.wire import tcp_bytes

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="tcp_info is Linux's")


def test_a_connection_is_known_by_its_far_end() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()) as far:
        near, _ = server.accept()
        with near:
            near.sendall(bytes(1000))
            far.sendall(bytes(300))
            far.recv(1000, socket.MSG_WAITALL)
            near.recv(300, socket.MSG_WAITALL)
            port = far.getsockname()[1]
            assert tcp_bytes([port, 1]) == {port: (1000, 300)}


def test_payload_and_overhead_explain_the_wire_to_a_hundredth(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, until=60.0)
    launch(config, tmp_path / "run", make_mind=Wanderer)
    wire = json.loads((tmp_path / "run" / "bandwidth.json").read_text())["wire"]
    assert list(wire) == ["r1", "r2", "r3"]
    for robot in wire.values():
        assert robot["to_robot"]["messages"] >= 300 and robot["from_robot"]["messages"] >= 300
        for flow in robot.values():
            assert flow["wire_bytes"] > flow["payload_bytes"] > 0
            assert abs(flow["wire_bytes"] - flow["payload_bytes"] - flow["overhead_bytes"]) <= 0.01 * flow["wire_bytes"]
