"""The shell around a robot of ROS 2: its sensors in, commands out, and what it knows for people to look at.

A step is taken for each scan. The robot is told to stop where no scan comes, where nobody holds the dead man's switch,
where something fails, and when this process ends.
"""

import math
import time
import zlib
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import zenoh

from agent.limits import INCOMPLETE, doubts
from agent.shell.mind import MakeMind, Mind
from agent.shell.process import AgentInbox, answer, own_mind, publishers_of
from agent.shell.ros2 import showing, wire
from agent.shell.ros2.air import Air
from agent.shell.ros2.config import Ros2ProcessConfig
from agent.shell.ros2.node import RosNode, RosPublisher
from agent.shell.ros2.sensing import SensedScan, Sensing
from agent.shell.ros2.timing import Timing
from protocol import keys
from protocol.codec import encode
from protocol.command import say, tell
from protocol.errors import InputError, ProtocolError
from protocol.geometry import Pose, compose, inverted
from protocol.inbox import Arrival
from protocol.messages import Observation
from protocol.session import open_ros2_client
from protocol.settings import MAX_NUMBER
from protocol.wireframe import Wireframe, decode_wireframe

POLL_S = 0.05
"""The shell looks this often whether scans have ceased."""
TELL_S = 1.0
"""Between two diagnostics; a robot that stands is told to stop as often."""
MOST_TAKERS = 1000
"""Subscribers of commands that are counted, at most."""
PATIENCE = 5
"""Diagnostics after which a reason to stand is said on stderr, too: at the start, topics come one after the other."""
MOST_WAITING = 4000
"""Messages that wait at most, all of which are taken between two steps: odometry of 1 kHz in four seconds."""
THERE_S = 1.0
"""How long the router may take to say whether a robot of this name is there; it takes some ms."""
DEAD_MAN = "dead_man"
"""Topic of the dead man's switch."""
COMMANDS = (wire.TWIST, wire.TWIST_STAMPED)


class RosInbox(AgentInbox):
    """What comes to a robot of ROS 2: samples of its topics, and what it hears of other robots."""

    GRAPH = "graph"
    """A subscriber of the command's topic came or went."""

    def __init__(self) -> None:
        super().__init__()
        self.lost = 0
        """Messages for which there was no room."""
        self.farewell: Callable[[], None] = lambda: None
        """Stops the robot."""

    def last_words(self) -> None:
        """Stop the robot."""
        self.farewell()

    def put(self, item: Arrival, block: bool = True, timeout: float | None = None) -> None:
        """Take an arrival, if there is room."""
        if self.qsize() >= MOST_WAITING and item.what != self.STOP:
            self.lost += 1
        else:
            super().put(item)

    def listener(self, topic: str) -> Callable[[bytes, bytes], None]:
        """A callback that queues the samples of a topic such as /r1/scan, with who sent them in hexadecimal."""

        def hear(payload: bytes, attached: bytes) -> None:
            try:
                self.put(Arrival(topic, wire.sender(attached).hex(), payload))
            except ProtocolError:
                self.put(Arrival(topic))

        return hear

    def watch_graph(self, told: str, kind: str, came: bool) -> None:
        """Take a token of a subscriber of the command's topic: its type in place of a robot, the token as bytes."""
        self.put(Arrival(self.GRAPH, kind, (b"+" if came else b"-") + told.encode()))


def run_ros2(
    robot: str,
    namespace: str,
    settings: Ros2ProcessConfig,
    *,
    connect: str | None = None,
    make_mind: MakeMind | None = None,
    inbox: RosInbox | None = None,
) -> str:
    """Live as `robot` on the ROS 2 robot in this namespace (such as /r1, or /) until somebody stops it.

    connect: endpoint of the router of ROS 2; None: that of the settings. Returns `interrupted`. Raises LinkError where
    no router answers, InputError where a robot of this name is there already.
    """
    inbox = inbox or RosInbox()
    with open_ros2_client(connect or settings.ros2.router, settings.join_timeout_s) as session:
        inbox.robot = robot
        if any(reply.ok for reply in session.liveliness().get(keys.alive(robot), timeout=THERE_S)):
            raise InputError(f"another {robot} is there already: give this one a name of its own by --id")
        make_mind = make_mind or own_mind(inbox)
        with RosNode(session, settings.ros2.domain, namespace, "wireswarm") as node, ExitStack() as stack:
            shell = Ros2Shell(robot, settings, session, node, inbox, make_mind, stack)
            inbox.farewell = shell.stop
            try:
                return shell.run()
            finally:
                shell.stop()


class Ros2Shell:
    """One robot of ROS 2, from its first scan on."""

    def __init__(
        self,
        robot: str,
        settings: Ros2ProcessConfig,
        session: zenoh.Session,
        node: RosNode,
        inbox: RosInbox,
        make_mind: MakeMind,
        stack: ExitStack,
    ) -> None:
        """stack: where what is declared is taken back."""
        self._robot, self._settings, self._ros2, self._inbox = robot, settings, settings.ros2, inbox
        self._node, self._make_mind = node, make_mind
        ros2 = settings.ros2
        spec = settings.spec.model_copy(update={"radio_range_m": ros2.range_m})
        self._sensing = Sensing(spec, ros2.upside_down, timing=Timing(ros2.revolution_s, ros2.stamp == "end"))
        self._air = Air(robot, ros2, spec.radio_mtu_bytes)
        self._mind: Mind | None = None
        self._map, self._grid_is_old = Wireframe(), True
        self._seen_area: showing.SeenArea | None = None
        self._last: SensedScan | None = None
        self._complete = False
        self._held_at = -math.inf
        self._spoke_at = self._drew_at = -math.inf
        self._hindered = Counter[str]()
        """Diagnostics in which the robot stood, by reason."""
        self._stopped = True
        """Whether the last command was to stop."""
        self._takers: dict[str, set[str]] = {kind: set() for kind in COMMANDS}
        """Tokens of subscribers of the command's topic by type."""
        self._commands: dict[str, RosPublisher] = {}
        self._take: dict[str, tuple[str, Callable[[Any], None]]] = {  # by topic, which begins with a slash
            node.name_of(ros2.scan_topic): (wire.SCAN, self._sensing.take_scan),
            node.name_of(ros2.odometry_topic): (wire.ODOMETRY, self._sensing.wheels.take),
        }
        if ros2.dead_man_s is not None:
            self._take[node.name_of(DEAD_MAN)] = wire.HELD, self._hold
        if ros2.position_topic is not None:
            self._take[node.name_of(ros2.position_topic)] = wire.POSE, self._take_place
        self._out = {channel: stack.enter_context(one) for channel, one in publishers_of(session, robot, False).items()}
        self._place = stack.enter_context(session.declare_publisher(keys.from_robot(robot, keys.PLACE)))
        self._grid = node.publisher("map", wire.GRID, latched=True)
        self._markers = node.publisher("wireframe", wire.MARKERS, latched=True)
        self._tf = node.publisher(ros2.tf_topic, wire.TRANSFORMS)
        self._diagnostics = node.publisher("/diagnostics", wire.DIAGNOSTICS)
        for subscriber in self._air.declare(session, inbox):
            stack.enter_context(subscriber)
        for topic, (kind, _) in self._take.items():
            node.subscribe(topic, kind, inbox.listener(topic), reliable=kind != wire.SCAN)
        node.watch_subscribers(ros2.command_topic, inbox.watch_graph)
        stack.enter_context(session.liveliness().declare_token(keys.alive(robot)))

    def run(self) -> str:
        """Take what comes until somebody stops it."""
        while not self._inbox.stopped:
            deadline = time.monotonic() + POLL_S
            for _ in range(MOST_WAITING):  # else whoever floods a topic would keep the robot from being stopped
                if (arrival := self._inbox.take(deadline)) is None:
                    break
                self._hear(arrival)
                deadline = 0.0
            self._watch(time.monotonic())
            if (seen := self._sensing.due()) is not None:
                self._step(seen)
        return "interrupted"

    def stop(self) -> None:
        """Tell the robot to stand still."""
        self._drive(0.0, 0.0)

    def _hear(self, arrival: Arrival) -> None:
        """Act on what came: a message of a topic, a change among those who take commands, or one from another robot."""
        what, robot, payload, _ = arrival
        if what in self._take:
            kind, take = self._take[what]
            try:
                if not robot:
                    raise ProtocolError("a message without rmw_zenoh's attachment")
                if self._sensing.is_known(what, robot, self._ros2.silence_s):
                    take(wire.from_bytes(kind, payload))
            except ProtocolError:
                self._sensing.skip(f"messages that cannot be read on {what}")
        elif what == RosInbox.GRAPH:
            self._count_takers(robot, payload)
        elif what in (keys.RADIO, keys.PLACE):
            try:
                self._air.hear(robot, what, payload, time.monotonic())
            except ProtocolError:
                self._sensing.skip("messages of other robots that cannot be read")

    def _count_takers(self, kind: str, told: bytes) -> None:
        """Have a publisher of commands of each type that the robot subscribes to."""
        came = told[:1] == b"+"
        if kind not in self._takers:
            if came:
                self._sensing.skip("subscribers of commands of another type than Twist and TwistStamped")
            return
        if came and len(self._takers[kind]) < MOST_TAKERS:
            self._takers[kind].add(told[1:].decode())
        else:
            self._takers[kind].discard(told[1:].decode())
        if self._takers[kind] and kind not in self._commands:
            self._commands[kind] = self._node.publisher(self._ros2.command_topic, kind)

    def _hold(self, told: Any) -> None:
        """Take a word of the dead man's switch."""
        self._held_at = time.monotonic() if told.data else -math.inf

    def _take_place(self, told: Any) -> None:
        """Take where the robot is in the frame that all robots share, and tell the others."""
        x, y = float(told.pose.position.x), float(told.pose.position.y)
        if not all(abs(value) <= MAX_NUMBER for value in (x, y)):  # NaN is not
            return self._sensing.skip("positions that are no numbers")
        self._place.put(encode(self._air.take_own_place(x, y, time.monotonic())))
        return None

    def _hindrance(self, now: float) -> str:
        """Why the robot must stand; empty where it may drive."""
        dead_man_s = self._ros2.dead_man_s
        if self._sensing.is_unsure:
            return f"scans on {self._ros2.scan_topic} do not agree on a lidar yet"
        if not self._sensing.knows_lidar:
            return f"no scan has come on {self._ros2.scan_topic} yet"
        if math.isinf(self._sensing.wheels.until_s):
            return f"no odometry has come on {self._ros2.odometry_topic} yet"
        if now - self._sensing.last_seen > self._ros2.silence_s:
            return f"no scan with its odometry comes for {self._ros2.silence_s:g} s"
        if dead_man_s is not None and now - self._held_at > dead_man_s:
            return f"nobody says true on {DEAD_MAN}"
        if not any(self._takers.values()):
            return f"nobody takes commands on {self._ros2.command_topic}"
        return ""

    def _watch(self, now: float) -> None:
        """Stop the robot where it must stand, and tell how it does."""
        hindrance = self._hindrance(now)
        if hindrance and not self._stopped:
            self._sensing.skip(f"times at which the robot was stopped: {hindrance}")
            self.stop()
        if hindrance:
            self._air.forget()
        for reason in self._sensing.news:
            say(f"{self._robot}: {reason}; such cases are counted from here on")
        self._sensing.news.clear()
        if now - self._spoke_at >= TELL_S:
            self._spoke_at = now
            if hindrance:
                self.stop()
                self._hindered[hindrance] += 1
                if self._hindered[hindrance] == PATIENCE:
                    say(f"{self._robot} stands: {hindrance}")
            self._tell(hindrance)

    def _tell(self, hindrance: str) -> None:
        """Publish how the robot does (diagnostics)."""
        sentence = hindrance or ("complete" if self._complete else "explores")
        figures: dict[str, object] = {"walls": len(self._map.edges), "messages lost": self._inbox.lost}
        figures |= self._sensing.skipped
        level = showing.WARN if hindrance else showing.OK
        told = showing.diagnostics_of(self._robot, level, sentence, figures, self._now_s())
        self._diagnostics.put(told)

    def _now_s(self) -> float:
        """Now by the clock of the robot's stamps."""
        if self._last is None:
            return time.time()
        return self._last.stamp_s + max(0.0, time.monotonic() - self._sensing.last_seen)

    def _drive(self, speed_mps: float, turn_rps: float) -> None:
        """Command a speed and a turn rate, in each type that the robot subscribes to."""
        self._stopped = speed_mps == turn_rps == 0.0
        for kind, publisher in list(self._commands.items()):
            if kind == wire.TWIST:
                publisher.put(showing.twist_of(speed_mps, turn_rps))
            else:
                frame = self._sensing.wheels.robot_frame
                publisher.put(showing.twist_stamped_of(speed_mps, turn_rps, self._now_s(), frame))

    def _step(self, seen: SensedScan) -> None:
        """Take a step on a scan. Where the robot must stand, its mind only looks, if it can.

        One that cannot drive would think that it is stuck. One that sees nothing would take it that the robot, which
        somebody else may drive, went straight to where it is then.
        """
        self._last = seen
        if self._mind is None or self._seen_area is None:
            spec, seed = self._sensing.spec, zlib.crc32(self._robot.encode())
            for doubt in doubts(spec):
                say(f"{self._robot}: {INCOMPLETE}: {doubt}")
            self._mind = self._make_mind(self._robot, spec, self._settings.agent, seed)
            self._seen_area = showing.SeenArea(spec.lidar)
        if self._hindrance(time.monotonic()):
            look: Callable[[Observation], Pose | None] | None = getattr(self._mind, "look", None)
            pose = look(seen.observation) if look else None
        else:
            pose = self._go(self._mind, seen.observation)
        if pose is not None:
            self._show(seen, pose, self._seen_area)

    def _go(self, mind: Mind, observation: Observation) -> Pose:
        """Do as the mind says. Returns where the robot is in its map."""
        step = mind.step(observation, self._air.take(observation.tick))
        self._drive(step.action.speed_mps, step.action.turn_rps)
        answer(self._out, step)
        if step.action.complete != self._complete:
            self._complete = step.action.complete
            tell(f"{self._robot}: {'complete' if self._complete else 'goes on'}")
        if step.map is not None:
            self._map, self._grid_is_old = decode_wireframe(step.map.wireframe), True
        return step.pose.pose

    def _show(self, seen: SensedScan, pose: Pose, area: showing.SeenArea) -> None:
        """Publish where the odometry's frame lies in the map, and the map where it, or what is free in it, is new."""
        places = [(self._ros2.map_frame, self._sensing.wheels.frame, compose(pose, inverted(seen.odometry)))]
        self._tf.put(showing.transforms_of(places, seen.stamp_s))
        self._grid_is_old |= area.look(pose, seen.observation, self._map)
        if self._grid_is_old and time.monotonic() - self._drew_at >= self._ros2.grid_s:
            self._draw(seen.stamp_s, area)

    def _draw(self, stamp_s: float, seen: showing.SeenArea) -> None:
        """Publish the map."""
        self._drew_at, self._grid_is_old = time.monotonic(), False
        frame = self._ros2.map_frame
        self._markers.put(showing.markers_of(self._map, stamp_s, frame))
        grid = showing.grid_of(self._map, seen, stamp_s, frame)
        if grid is None:
            self._sensing.skip("maps too large for an OccupancyGrid")
        else:
            self._grid.put(grid)
