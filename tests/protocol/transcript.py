"""`python -m tests.protocol.transcript`: the run in docs/protocol.md, byte for byte as it travels, captured anew.

A world with two robots, played by one session that says the same in each run, so that no change of a mind or of a map
changes a byte of it.
"""

import json
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from threading import Thread
from typing import Any

import msgpack
import numpy as np
import zenoh

from deploy.revision import ROOT
from protocol import keys
from protocol.codec import decode, encode
from protocol.frames import FRAMES, ToldFrames
from protocol.grid_map import GridMap, quantise
from protocol.map_codec import encode_map
from protocol.messages import (
    PROTOCOL_VERSION,
    Action,
    Event,
    Join,
    MapReport,
    Message,
    PoseReport,
    ScanReport,
    Send,
    TeammatePose,
    Welcome,
)
from protocol.session import at_once, open_client
from protocol.talk import ACK, BEACON, DELTA, MAP, Ack, Beacon, Part
from protocol.viewpoints import VIEWS, AskViews, Views
from protocol.wireframe import Wireframe, encode_wireframe
from tests.tiny import tiny_config
from world.config import ServerConfig
from world.shell.server import serve

PAGE = ROOT / "docs" / "protocol.md"
BEGIN, END = "<!-- captured -->\n```\n", "```\n"
LIMIT_S = 20.0
ROBOTS = ("r1", "r2")
TICKS = 5
RUN = "06e7ed488e05ac24"
"""Stands for what each world draws."""


def captured() -> str:
    """The run as lines: key, bytes, and what they say."""
    return "\n".join(line for entry in _run() for line in _told(*entry)) + "\n"


def page() -> tuple[str, str, str]:
    """The page before, in and after the captured run."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    lines, _, after = rest.partition(END)
    return before + BEGIN, lines, END + after


def _told(arrow: str, key: str, data: bytes) -> Iterator[str]:
    yield f"{arrow} {key}"
    yield from textwrap.wrap(data.hex(), 110)
    yield from textwrap.wrap(_words(msgpack.unpackb(data)), 110, break_long_words=False, break_on_hyphens=False)
    yield ""


def _words(value: Any) -> str:
    """A value as JSON, but bytes as 'hexadecimal'."""
    match value:
        case dict():
            return "{" + ", ".join(f"{name}: {_words(one)}" for name, one in value.items()) + "}"
        case list():
            return "[" + ", ".join(map(_words, value)) + "]"
        case bytes():
            return f"'{value.hex()}'"
        case float():
            return f"{value:g}"
        case _:
            return json.dumps(value)


def _run() -> list[tuple[str, str, bytes]]:
    """What travels, in order; < to the world, > from the world."""
    endpoints: SimpleQueue[str] = SimpleQueue()
    with TemporaryDirectory() as folder:
        spec = {"lidar": {"beams": 8}, "odometry": {"rate_hz": 10.0}}
        config = tiny_config(Path(folder), robots=2, until=TICKS * 0.2, spec=spec)
        world = Thread(target=serve, args=(config, ServerConfig(), None), kwargs={"listening": endpoints.put})
        world.start()
        try:
            with open_client(endpoints.get(timeout=LIMIT_S), LIMIT_S) as session:
                return _play(session)
        finally:
            world.join(LIMIT_S)


def _play(session: zenoh.Session) -> list[tuple[str, str, bytes]]:
    log: list[tuple[str, str, bytes]] = []
    heard: SimpleQueue[tuple[str, bytes]] = SimpleQueue()
    last: dict[str, bytes] = {}

    def say(key: str, message: Message) -> None:
        log.append(("<", key, encode(message)))
        session.put(key, log[-1][2], congestion_control=zenoh.CongestionControl.BLOCK, express=True)

    def hear_of_world(sample: zenoh.Sample) -> None:
        last[str(sample.key_expr)] = sample.payload.to_bytes()

    for key in (keys.ALL_PUBLIC, keys.ALL_TRUTH):
        session.declare_subscriber(key, at_once(hear_of_world))
    for robot in ROBOTS:
        session.declare_subscriber(
            keys.to_robot(robot), at_once(lambda sample: heard.put((str(sample.key_expr), sample.payload.to_bytes())))
        )
        key = keys.service(robot, keys.JOIN)
        question = encode(Join(version=PROTOCOL_VERSION, robot=robot, session="5e55", process="0c0ffee"))
        reply = next(iter(session.get(key, payload=question, timeout=LIMIT_S)))
        assert reply.ok is not None
        if robot == ROBOTS[0]:  # the other one's is of the same form
            welcome = decode(Welcome, reply.ok.payload.to_bytes()).model_copy(update={"run": RUN})
            log += [("<", key, question), (">", key, encode(welcome))]
    tokens = [session.liveliness().declare_token(keys.alive(robot)) for robot in ROBOTS]
    for tick in range(TICKS):
        log.extend(_until(heard, keys.OBS))
        for robot in ROBOTS:
            for channel, message in _said(robot, tick):
                say(keys.from_robot(robot, channel), message)
    log.extend(_until(heard, keys.END))
    for token in tokens:
        token.undeclare()
    log.extend((">", key, last[key]) for key in (keys.CLOCK, keys.LINKS, keys.PROGRESS))
    return log


def _until(heard: SimpleQueue[tuple[str, bytes]], last: str) -> Iterator[tuple[str, str, bytes]]:
    """What comes to all robots until each has heard `last`, robot by robot."""
    came: dict[str, list[tuple[str, bytes]]] = {robot: [] for robot in ROBOTS}
    while any(not said or keys.channel_of(said[-1][0]) != last for said in came.values()):
        key, data = heard.get(timeout=LIMIT_S)
        came[keys.robot_of(key)].append((key, data))
    return ((">", key, data) for said in came.values() for key, data in said)


def _said(robot: str, tick: int) -> Iterator[tuple[str, Message]]:
    """What a robot says in a tick: to the radio, telemetry, its action."""
    sends = [Send(tick=tick, to=to, kind=kind, payload=data) for to, kind, data in _talk(robot, tick)]
    for send in sends:
        yield keys.RADIO, send
    first, peer = robot == ROBOTS[0], "r2" if robot == "r1" else "r1"
    if first and tick == 1:
        seen = encode_wireframe(_room(1.0))
        yield keys.SCAN, ScanReport(tick=tick, wireframe=seen)
        known = TeammatePose(
            robot=peer, tick=1, pose=(1.0, 0.0, 1.0), covariance=(0.01, 0, 0, 0, 0.01, 0, 0, 0, 0.001), status="merged"
        )
        yield keys.POSE, PoseReport(tick=tick, pose=(0.04, 0.0, 0.0), teammates=[known])
        yield keys.MAP, MapReport(tick=tick, wireframe=seen)
    events = [Event(event="contact", data={"peer": peer})] if tick == 1 else []
    merged = {peer: 1} if tick == 3 and not first else {}
    drive = {"speed_mps": 0.2 if first else 0.0, "turn_rps": 0.0 if first else 0.5}
    yield keys.ACT, Action(tick=tick, sent=len(sends), events=events, merged=merged, **drive)


def _talk(robot: str, tick: int) -> Iterator[tuple[str, str, bytes]]:
    """Receiver, kind and bytes of what goes on the air: each kind of message once."""
    whole = quantise(_room(1.0), 10, 0)
    match robot, tick:
        case _, 0:
            yield "*", BEACON, Beacon(tick, (0.0, 0.0, 0.0)).encode()
        case "r1", 1:
            yield "r2", MAP, Part(1, 0, 0, 1, encode_map(whole, likelihoods=False).data).encode()
        case "r2", 2:
            yield "r1", ACK, Ack(1).encode()
            yield "r1", VIEWS, AskViews(0).encode()
        case "r1", 3:
            moved = _changed(whole)
            for number, body in enumerate((moved[:3], moved[3:])):
                yield "r2", DELTA, Part(3, 1, number, 2, body).encode()
            yield "r2", VIEWS, Views(0, 3, np.array([[0, 0], [1, 0], [2, 0]])).encode()
        case "r2", 4:
            yield "r1", ACK, Ack(3, frozenset({1})).encode(2)
            yield "r1", FRAMES, ToldFrames({"r3": (1.5, -2.0, 0.5), "r4": None}).encode()


def _changed(whole: GridMap) -> bytes:
    return encode_map(quantise(_room(1.5), 10, 0), whole, likelihoods=False).data


def _room(to_x: float) -> Wireframe:
    """Two walls with a corner; the second one goes on beyond what was seen."""
    points = np.array([[-1.0, 1.0], [-1.0, -1.0], [to_x, -1.0]])
    edges = np.array([[0, 1], [1, 2]], np.int32)
    return Wireframe(points, np.array([2, 0, 2], np.uint8), edges, np.ones(2, np.float32), np.ones(2, np.bool_))


def write(say: Callable[[str], object] = print) -> None:
    """Put the run as it is now into the page."""
    before, _, after = page()
    PAGE.write_text(before + captured() + after, encoding="utf-8")
    say(f"{PAGE} is written")


if __name__ == "__main__":
    write()
