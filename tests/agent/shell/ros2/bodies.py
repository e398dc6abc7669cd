"""A ROS 2 robot for tests: a node that says scans and odometry, and writes down what it is told."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from agent.shell.ros2 import wire
from agent.shell.ros2.config import Ros2ProcessConfig
from agent.shell.ros2.node import RosNode
from agent.shell.ros2.process import RosInbox, run_ros2
from protocol.configuration import load
from protocol.geometry import Pose
from protocol.session import open_ros2_client
from tests.agent.shell.ros2.messages import odometry, scan

PATIENCE_S = 20.0
PERIOD_S = 0.05
WHEELS: Pose = (1.0, 2.0, 0.5)
"""Where odometry says that it stands."""


class Body:
    """Stands in a round room of 2 m, and says so at 20 Hz while `talks`."""

    def __init__(self, endpoint: str, namespace: str, kind: str = wire.TWIST) -> None:
        self.endpoint, self.namespace, self.kind = endpoint, namespace, kind
        self.talks = self.rolls = True
        self.commands: list[tuple[float, float]] = []
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._talk)

    def __enter__(self) -> "Body":
        self._session = open_ros2_client(self.endpoint, PATIENCE_S)
        session = self._session.__enter__()
        self.node = RosNode(session, 0, self.namespace, "body")
        self.scans, self.wheels = self.node.publisher("scan", wire.SCAN), self.node.publisher("odom", wire.ODOMETRY)
        self.node.subscribe("cmd_vel", self.kind, self._obey)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self.node.__exit__()
        self._session.__exit__(None, None, None)

    def _obey(self, payload: bytes, attached: bytes) -> None:
        message = wire.from_bytes(self.kind, payload)
        twist = message.twist if self.kind == wire.TWIST_STAMPED else message
        wire.sender(attached)
        self.commands.append((twist.linear.x, twist.angular.z))

    def _talk(self) -> None:
        while not self._ended.wait(PERIOD_S):
            if self.talks:
                now = time.time()
                if self.rolls:
                    self.wheels.put(odometry(now, WHEELS))
                self.scans.put(scan(now))

    def drives(self) -> bool:
        return bool(self.commands) and self.commands[-1] != (0.0, 0.0)

    def stands(self) -> bool:
        return bool(self.commands) and self.commands[-1] == (0.0, 0.0)


def until(holds: Callable[[], bool]) -> None:
    """Wait until something holds."""
    deadline = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.02)


class Agent:
    """`wireswarm agent --ros2` in a thread."""

    def __init__(self, endpoint: str, robot: str, make_mind: Any, **settings: Any) -> None:
        flags = {key if "." in key else f"ros2.{key}": value for key, value in settings.items()}
        self.inbox, self.error = RosInbox(), ""
        config = load(Ros2ProcessConfig, None, flags)
        self._thread = threading.Thread(target=self._live, args=(robot, config, endpoint, make_mind))
        self._thread.start()

    def _live(self, robot: str, config: Ros2ProcessConfig, endpoint: str, make_mind: Any) -> None:
        try:
            run_ros2(robot, f"/{robot}", config, connect=endpoint, make_mind=make_mind, inbox=self.inbox)
        except Exception as error:
            self.error = str(error)

    def __enter__(self) -> "Agent":
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def end(self) -> None:
        self.inbox.stop()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()


@contextmanager
def heard(endpoint: str, topic: str, kind: str) -> Iterator[list[Any]]:
    """Messages of a topic, as they come."""
    messages: list[Any] = []
    with open_ros2_client(endpoint, PATIENCE_S) as session, RosNode(session, 0, "/", "ear") as node:
        node.subscribe(topic, kind, lambda payload, attached: messages.append(wire.from_bytes(kind, payload)))
        yield messages
