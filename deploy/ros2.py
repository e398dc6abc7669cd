"""A robot of our world as a ROS 2 robot: its scans, odometry and tf go out, and a Twist drives it.

To the world it is a mind like any other. What drives it may be ours (`wireswarm agent --ros2`): what that says on the
radio passes the world's gate, and its map and events are recorded.
"""

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import zenoh

from agent.config import AgentConfig
from agent.robot import Step
from agent.shell.ros2 import showing, wire
from agent.shell.ros2.config import Ros2Config
from agent.shell.ros2.node import RosNode
from agent.shell.ros2.ticks import EPOCH_S
from protocol import keys
from protocol.codec import decode, encode
from protocol.errors import ProtocolError
from protocol.geometry import Pose, pose_of, relative
from protocol.messages import (
    MAX_EVENT_VALUES,
    Action,
    Event,
    Heard,
    MapReport,
    Message,
    Observation,
    PoseReport,
    RobotSpec,
    ScanReport,
    Send,
    values_in,
)
from protocol.session import at_once, open_ros2_client
from protocol.settings import MAX_NUMBER
from protocol.talk import MAX_SENDS
from protocol.wireframe import Wireframe, encode_wireframe

ANSWER_SHARE = 0.7  # of a tick, after which the command that came last holds: a mind takes some ms
COMMAND_S = 0.5  # a command that is older holds no longer, as on a TurtleBot3
JOIN_S = 5.0  # within which the router must answer
MAX_EVENTS = 500  # of a tick
ODOM, BASE, LIDAR = "odom", "base_footprint", "base_scan"  # frames, as on a TurtleBot3
KINDS: dict[str, type[Message]] = {
    keys.RADIO: Send,
    keys.MAP: MapReport,
    keys.SCAN: ScanReport,
    keys.POSE: PoseReport,
    keys.ACT: Action,
}


@dataclass(frozen=True)
class Ros2Robots:
    """Makes each robot of a run a robot of ROS 2; in place of minds."""

    config: Ros2Config

    def __call__(self, robot: str, spec: RobotSpec, config: AgentConfig, seed: int) -> "SimulatedRobot":
        """As agent.robot.Robot. Raises LinkError where no router of ROS 2 answers."""
        return SimulatedRobot(robot, spec, self.config, 1 / spec.lidar.rate_hz)


class DriverInbox:
    """What came from whoever drives a robot. Callbacks fill it, the robot's step empties it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._command = (0.0, 0.0, 0.0)  # m/s, rad/s, and until when it holds
        self._sends: list[Send] = []
        self._events: list[Event] = []
        self._last: dict[str, Message] = {}

    def command(self, twist: Any) -> None:
        """Take a Twist."""
        speed, turn = float(twist.linear.x), float(twist.angular.z)
        if all(abs(value) <= MAX_NUMBER for value in (speed, turn)):  # NaN is not
            with self._lock:
                self._command = speed, turn, time.monotonic() + COMMAND_S

    def hear(self, sample: zenoh.Sample) -> None:
        """Take what a mind of ours publishes; what is none is left out."""
        channel = keys.channel_of(str(sample.key_expr))
        if channel not in KINDS:
            return
        try:
            message = decode(KINDS[channel], sample.payload.to_bytes())
        except ProtocolError:
            return
        with self._lock:
            if isinstance(message, Send):
                self._sends = [*self._sends, message][-MAX_SENDS:]
                return
            if isinstance(message, Action):
                events = [*self._events, *message.events][-MAX_EVENTS:]
                self._events = events if values_in(events) <= MAX_EVENT_VALUES else message.events[-MAX_EVENTS:]
            self._last[channel] = message

    def take(self) -> tuple[tuple[float, float], list[Send], list[Event], dict[str, Message]]:
        """Command, messages for the radio, events and reports since the last time."""
        with self._lock:
            speed, turn, until = self._command
            sends, events, last = self._sends, self._events, self._last
            self._sends, self._events, self._last = [], [], {}
        return (speed, turn) if time.monotonic() < until else (0.0, 0.0), sends, events, last


class SimulatedRobot:
    """A body without a mind, in the graph of ROS 2."""

    def __init__(self, robot: str, spec: RobotSpec, config: Ros2Config, period_s: float) -> None:
        """period_s: of a tick, by the clock."""
        self._robot, self._spec, self._period_s = robot, spec, period_s
        self._first: int | None = None  # tick of the clock, as agents count them, at the world's tick 0
        self._before: tuple[Pose, float] | None = None
        """The pose that was told last, and its stamp."""
        self._complete, self._merged = False, dict[str, int]()
        self._driver = driver = DriverInbox()
        self._stack = ExitStack()
        session = self._stack.enter_context(open_ros2_client(config.router, JOIN_S))
        node = self._stack.enter_context(RosNode(session, config.domain, f"/{robot}", "body"))
        self._scan = node.publisher(config.scan_topic, wire.SCAN)
        self._odometry = node.publisher(config.odometry_topic, wire.ODOMETRY)
        self._tf = node.publisher(config.tf_topic, wire.TRANSFORMS)
        self._tf_static = node.publisher(f"{config.tf_topic}_static", wire.TRANSFORMS, latched=True)
        self._radio = session.declare_publisher(keys.to_robot(robot, keys.RADIO), express=True)
        kind = wire.TWIST_STAMPED if config.stamped else wire.TWIST
        node.subscribe(config.command_topic, kind, _reader(kind, driver.command))
        self._stack.enter_context(session.declare_subscriber(keys.from_robot(robot), at_once(driver.hear)))

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
        """Tell what is sensed and heard, and do what the driver says by the end of the tick."""
        end = time.monotonic() + ANSWER_SHARE * self._period_s
        self._tell(observation)
        for message in heard:
            self._radio.put(encode(message))
        time.sleep(max(0.0, end - time.monotonic()))
        return self._answer(observation)

    def _tell(self, observation: Observation) -> None:
        lidar, poses = self._spec.lidar, list(map(pose_of, observation.poses()))
        now = round((time.time() - EPOCH_S) * lidar.rate_hz)
        if self._first is None:
            self._first = now - observation.tick
            self._tf_static.put(showing.transforms_of([(BASE, LIDAR, lidar.mount)], time.time()))
        stamp_s, step_s = EPOCH_S + (self._first + observation.tick) / lidar.rate_hz, 1 / lidar.rate_hz / len(poses)
        if self._before is not None and stamp_s <= self._before[1]:
            return  # a world that was resumed says its last ticks again
        for number, pose in enumerate(poses):
            then_s = stamp_s - step_s * (len(poses) - 1 - number)
            # ticks that came late are left out, and how the robot came to its first pose is not known
            before, before_s = self._before or (pose, then_s - step_s)
            self._odometry.put(
                showing.odometry_of(pose, relative(before, pose), then_s - before_s, then_s, (ODOM, BASE))
            )
            self._before = pose, then_s
        self._tf.put(showing.transforms_of([(ODOM, BASE, poses[-1])], stamp_s))
        self._scan.put(showing.scan_of(lidar, observation.scan(), stamp_s, LIDAR))

    def _answer(self, observation: Observation) -> Step:
        tick, first = observation.tick, self._first or 0
        (speed, turn), sends, events, last = self._driver.take()
        now = {"tick": tick}
        told: dict[str, Any] = {}
        if isinstance(action := last.get(keys.ACT), Action):
            # ticks of the driver are those of the clock
            self._complete = action.complete
            self._merged = {peer: min(max(when - first, 0), tick) for peer, when in action.merged.items()}
            told = action.model_dump(include={"map_bytes", "filter_bytes", "step_ms"})
        did = Action(
            tick=tick,
            speed_mps=speed,
            turn_rps=turn,
            sent=len(sends),
            complete=self._complete,
            events=events,
            merged=self._merged,
            **told,
        )
        scan: Any = last.get(keys.SCAN) or ScanReport(tick=tick, wireframe=encode_wireframe(Wireframe()))
        pose: Any = last.get(keys.POSE) or PoseReport(tick=tick, pose=observation.odometry)
        map_ = last.get(keys.MAP)
        said = [send.model_copy(update=now) for send in sends]
        return Step(
            did,
            said,
            map_ and map_.model_copy(update=now),  # type: ignore[arg-type]
            lambda: (scan.model_copy(update=now), pose.model_copy(update=now)),
        )


def _reader(kind: str, take: Callable[[Any], None]) -> Callable[[bytes, bytes], None]:
    """A callback that takes commands of a type, and leaves out what is none."""

    def hear(payload: bytes, attached: bytes) -> None:
        try:
            message = wire.from_bytes(kind, payload)
        except ProtocolError:
            return
        take(message.twist if kind == wire.TWIST_STAMPED else message)

    return hear
