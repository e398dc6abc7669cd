"""The shell on a ROS 2 robot: commands by scans, stops, maps, radio, and bytes that make no sense."""

import math
import subprocess
import sys
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
import zenoh.ext

from agent.config import AgentConfig
from agent.robot import Step
from agent.shell.mind import OwnMind
from agent.shell.ros2 import wire
from agent.shell.ros2.showing import FREE, OCCUPIED, UNKNOWN
from protocol import keys
from protocol.codec import encode
from protocol.geometry import Pose, compose
from protocol.messages import Heard, Observation, PoseReport, RobotSpec, Send
from protocol.session import open_client, open_ros2_client, open_router
from protocol.wireframe import certain
from tests.agent.shell.ros2.bodies import PATIENCE_S, WHEELS, Agent, Body, heard, until
from tests.agent.shell.ros2.messages import said

pytestmark = pytest.mark.system

SQUARE = certain(np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]), np.array([(0, 1), (1, 2), (2, 3)]))
POSE: Pose = (0.3, 0.2, 0.1)


class Goer(OwnMind):
    """Drives, shows a map, and says its name; writes down whom it hears, and when it can only look."""

    ears: ClassVar[dict[str, set[str]]] = {}
    looked: ClassVar[list[int]] = []
    """Ticks in which it had to stand."""

    def __init__(self, robot: str, spec: RobotSpec, config: AgentConfig, seed: int) -> None:
        super().__init__(robot, spec, config, seed)
        self.ears[robot] = set()
        self.speed = 0.1

    def look(self, observation: Observation) -> Pose:
        self.looked.append(observation.tick)
        return POSE

    def drive(self, observation: Observation, heard: Sequence[Heard]) -> tuple[float, float]:
        self.ears[self.robot] |= {message.sender for message in heard if message.payload == message.sender.encode()}
        self.send("name", self.robot.encode())
        self.show(SQUARE)
        self.speed += 0.0001  # told from the command before
        return self.speed, 0.5

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
        step = super().step(observation, heard)
        return step._replace(telemetry=lambda: (step.scan, PoseReport(tick=observation.tick, pose=POSE)))


@pytest.fixture
def endpoint() -> Iterator[str]:
    Goer.ears.clear()
    Goer.looked.clear()
    with open_router() as (_, found):
        yield found


@pytest.mark.parametrize("kind", [wire.TWIST, wire.TWIST_STAMPED])
def test_it_drives_by_the_type_that_the_robot_declares_and_stops_at_its_end(endpoint: str, kind: str) -> None:
    with Body(endpoint, "/r1", kind) as body, Agent(endpoint, "r1", Goer) as agent:
        until(lambda: len(body.commands) > 5)
        assert body.drives() and body.commands[-1] == pytest.approx((0.1, 0.5), abs=0.1)
        agent.end()
        until(body.stands)
        assert agent.error == ""


def test_a_signal_leaves_the_robot_standing(endpoint: str) -> None:
    mind = f"mind={{'*': '{Goer.__module__}:Goer'}}"
    command = [sys.executable, "-m", "agent", "--ros2", "r1", "--connect", endpoint, "--set", mind]
    with Body(endpoint, "/r1") as body:
        process = subprocess.Popen(command, cwd=Path(__file__).parents[4], stdout=subprocess.PIPE, text=True)
        until(body.drives)
        process.terminate()
        until(body.stands)
        assert process.communicate(timeout=PATIENCE_S)[0] == "r1: interrupted\n" and process.returncode == 130


def test_it_stops_where_scans_or_odometry_cease_and_goes_on_with_them(endpoint: str) -> None:
    with Body(endpoint, "/r1") as body, Agent(endpoint, "r1", Goer):
        until(body.drives)
        body.talks = False
        until(body.stands)
        body.talks = True
        until(body.drives)
        body.rolls = False  # scans alone are none
        until(body.stands)
        body.rolls = True
        until(body.drives)


def test_it_drives_only_while_somebody_holds_the_dead_mans_switch(endpoint: str) -> None:
    with Body(endpoint, "/r1") as body, Agent(endpoint, "r1", Goer, dead_man_s=0.5) as _:
        switch = body.node.publisher("dead_man", wire.HELD)

        def held() -> bool:
            switch.put(said(wire.HELD, data=True))
            return body.drives()

        for _ in range(2):
            until(body.stands)
            until(lambda: len(Goer.looked) > 0)  # from the first scan on, as somebody else may drive it meanwhile
            until(held)
            Goer.looked.clear()
        switch.put(said(wire.HELD, data=False))
        until(body.stands)


def test_what_is_missing_is_said(
    endpoint: str, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("agent.shell.ros2.process.TELL_S", 0.02)
    sentences = []

    def said_so(what: str) -> bool:
        sentences.extend(capfd.readouterr().err.splitlines())
        return f"wireswarm: r1 stands: {what}" in sentences

    with Agent(endpoint, "r1", Goer):
        until(lambda: said_so("no scan has come on scan yet"))
        with Body(endpoint, "/r1") as body:
            body.rolls = False
            until(lambda: said_so("no odometry has come on odom yet"))
            body.rolls = True
            until(body.drives)
    with Body(endpoint, "/r1"), Agent(endpoint, "r1", Goer, command_topic="wheels/cmd_vel"):
        until(lambda: said_so("nobody takes commands on wheels/cmd_vel"))


def test_what_it_cannot_do_is_said_before_it_drives(endpoint: str, capfd: pytest.CaptureFixture[str]) -> None:
    with Body(endpoint, "/r1") as body, Agent(endpoint, "r1", Goer, **{"spec.radius_m": 4.0}):
        until(body.drives)
    doubt = "wireswarm: r1: a complete map is not to be expected: the lidar sees 3.50 m"
    assert capfd.readouterr().err.count(doubt) == 1


def test_a_mind_that_fails_leaves_the_robot_standing(endpoint: str) -> None:
    class Failing(Goer):
        def drive(self, observation: Observation, heard: Sequence[Heard]) -> tuple[float, float]:
            if self.speed > 0.101:
                raise ZeroDivisionError("a mistake")
            return super().drive(observation, heard)

    with Body(endpoint, "/r1") as body, Agent(endpoint, "r1", Failing) as agent:
        until(body.drives)
        until(lambda: agent.error == "a mistake")
        until(body.stands)


def test_the_map_is_there_for_who_comes_later_and_tf_places_it(endpoint: str) -> None:
    with Body(endpoint, "/r1") as body, Agent(endpoint, "r1", Goer), heard(endpoint, "/r1/tf", wire.TRANSFORMS) as tf:
        until(lambda: body.drives() and len(tf) > 0)
        grids: list[Any] = []
        with open_ros2_client(endpoint, PATIENCE_S) as session:
            history = zenoh.ext.HistoryConfig(detect_late_publishers=True)
            key = wire.Endpoint(0, "/r1/map", wire.GRID).key
            zenoh.ext.declare_advanced_subscriber(
                session, key, lambda sample: grids.append(sample.payload.to_bytes()), history=history
            )
            until(lambda: len(grids) > 0)
    grid = wire.from_bytes(wire.GRID, grids[0])
    cells, origin = grid.data.reshape(grid.info.height, grid.info.width), grid.info.origin.position

    def at(x: float, y: float) -> int:
        return int(cells[int((y - origin.y) / 0.05), int((x - origin.x) / 0.05)])

    assert (at(0.0, -1.001), at(1.001, 0.0), at(0.0, 0.0), at(0.0, -1.2)) == (OCCUPIED, OCCUPIED, FREE, UNKNOWN)
    assert (at(-1.6, 0.2), at(-1.8, 0.2)) == (FREE, UNKNOWN)  # the room ends there, and no wall is mapped
    (moved,) = tf[-1].transforms
    assert (moved.header.frame_id, moved.child_frame_id) == ("map", "odom")
    place, turn = moved.transform.translation, moved.transform.rotation
    odometry = place.x, place.y, 2 * math.atan2(turn.z, turn.w)
    assert compose(odometry, WHEELS) == pytest.approx(POSE)


def test_while_it_must_stand_its_frame_and_what_it_sees_are_shown(endpoint: str) -> None:
    """Driven by hand, it had no frame, and of the way nothing was ever free."""

    class Led(Goer):
        def look(self, observation: Observation) -> Pose:
            self.looked.append(observation.tick)
            return 0.1 * len(self.looked), 0.0, 0.0

    with (
        Body(endpoint, "/r1") as body,
        heard(endpoint, "/r1/tf", wire.TRANSFORMS) as tf,
        heard(endpoint, "/r1/map", wire.GRID) as grids,
        Agent(endpoint, "r1", Led, dead_man_s=0.5, grid_s=0.01),
    ):
        until(lambda: len(tf) > 5 and len(grids) > 1)
        assert (grids[-1].data == FREE).sum() > (grids[0].data == FREE).sum() > 0
        assert not body.drives() and len(Goer.looked) > 5


def test_robots_hear_each_other_as_far_as_the_places_that_they_are_told(endpoint: str) -> None:
    at = {"r1": 0.0, "r2": 3.0, "r3": 5.0}

    def told(bodies: list[Body]) -> None:
        for (body, place), y in product(zip(bodies, places, strict=True), (0.0, math.nan)):
            pose = said(
                "geometry_msgs/msg/Pose",
                position=said("geometry_msgs/msg/Point", x=at[body.namespace[1:]], y=y, z=0.0),
                orientation=said("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
            )
            stamp = said("builtin_interfaces/msg/Time", sec=1, nanosec=0)
            header = said("std_msgs/msg/Header", stamp=stamp, frame_id="world")
            place.put(said(wire.POSE, header=header, pose=pose))

    limits = {"range_m": 4.0, "position_topic": "place"}
    with (
        Body(endpoint, "/r1") as one,
        Body(endpoint, "/r2") as two,
        Body(endpoint, "/r3") as three,
        Agent(endpoint, "r1", Goer, **limits),
        Agent(endpoint, "r2", Goer, **limits),
        Agent(endpoint, "r3", Goer, **limits),
    ):
        places = [body.node.publisher("place", wire.POSE) for body in (one, two, three)]
        until(lambda: all(body.drives() for body in (one, two, three)))
        assert Goer.ears == {"r1": set(), "r2": set(), "r3": set()}  # nobody knows yet where anybody is

        def heard_all() -> bool:
            told([one, two, three])
            return Goer.ears["r2"] == {"r1", "r3"} and bool(Goer.ears["r1"] and Goer.ears["r3"])

        until(heard_all)
        assert Goer.ears == {"r1": {"r2"}, "r2": {"r1", "r3"}, "r3": {"r2"}}


def test_without_a_limit_all_hear_each_other_and_a_name_is_taken_once(endpoint: str) -> None:
    with Body(endpoint, "/r1") as one, Body(endpoint, "/r2"), Agent(endpoint, "r1", Goer), Agent(endpoint, "r2", Goer):
        until(lambda: Goer.ears == {"r1": {"r2"}, "r2": {"r1"}})
        with Agent(endpoint, "r1", Goer) as third:
            until(lambda: third.error != "")
            assert third.error == "another r1 is there already: give this one a name of its own by --id"
        assert one.drives()


def test_bytes_that_make_no_sense_are_counted_and_harm_nobody(endpoint: str, capfd: pytest.CaptureFixture[str]) -> None:
    with (
        Body(endpoint, "/r1") as body,
        Agent(endpoint, "r1", Goer),
        heard(endpoint, "/diagnostics", wire.DIAGNOSTICS) as words,
        open_client(endpoint, PATIENCE_S) as rogue,
    ):
        until(body.drives)
        before = len(words)
        scan_key = wire.Endpoint(0, "/r1/scan", wire.SCAN).key
        attached = wire.attachment(1, 2, b"0123456789abcdef")
        for payload in (b"", b"\0", b"\0\1\0\0" + b"\xff" * 100, bytes(2000)):
            rogue.put(scan_key, payload)
            rogue.put(scan_key, payload, attachment=attached)
            rogue.put(scan_key, payload, attachment=b"short")
            rogue.put(keys.from_robot("r7", keys.RADIO), payload)
            rogue.put(keys.from_robot("r7", keys.PLACE), payload)
            rogue.put(keys.from_robot("R 7", keys.RADIO), encode(Send(tick=1, to="*", kind="name", payload=b"")))
        rogue.liveliness().declare_token(
            wire.token(0, "ab", 1, wire.SUBSCRIBER, "/r1", "x", "%r1%cmd_vel/a::msg::dds_::B_/h/q")
        )
        until(lambda: len(words) > before + 2)
        assert body.drives()
        (status,) = words[-1].status
        counts = {value.key: value.value for value in status.values}
        assert (status.name, status.message, status.level) == ("wireswarm: r1", "explores", 0)
        assert counts["messages that cannot be read on /r1/scan"] == "8"
        assert counts["messages of a second publisher of /r1/scan"] == "4"
        assert counts["messages of other robots that cannot be read"] == "12"
        assert counts["subscribers of commands of another type than Twist and TwistStamped"] == "1"
    sentences = capfd.readouterr().err.splitlines()
    assert len([one for one in sentences if "cannot be read on /r1/scan; such cases are counted" in one]) == 1
