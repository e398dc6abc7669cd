"""Fuzz target: a robot that hears hostile peers for some steps, from their first beacon to merged maps and after."""

from collections.abc import Iterator
from copy import deepcopy
from functools import cache

import numpy as np

from agent.config import AgentConfig
from agent.cooperation.peer import Unaligned
from agent.robot import Robot
from deploy.bench.alignment.pairs import moved
from protocol.errors import ProtocolError
from protocol.frames import FRAMES, ToldFrames
from protocol.geometry import inverted
from protocol.grid_map import GridMap, quantise
from protocol.map_codec import encode_map
from protocol.messages import Heard, Observation, RobotSpec
from protocol.talk import ACK, BEACON, DELTA, MAP, MAX_SENDS, Ack, Beacon, in_parts
from protocol.viewpoints import VIEWS, AskViews, Views
from protocol.walls import lengths
from protocol.wireframe import MAX_VERTICES, Wireframe, encode_wireframe

PEERS = ("r2", "r3")
FRAME = (2.0, -1.0, 0.7)
"""The frame of both peers in the robot's own."""
BEGUN, STEPS = 24, 6
"""Steps before the first word, and at most after it."""
KINDS = (BEACON, MAP, DELTA, ACK, VIEWS, FRAMES, "unknown")
MOST = 400  # messages of a conversation


def fuzz_one(data: bytes) -> None:
    """Do and hear what the bytes say: the robot's walls stay, its map and its words keep within their bounds."""
    robot, deaf, tick, steps = deepcopy(_begun()), deepcopy(_begun()), BEGUN, 0
    said: list[tuple[str, str, bytes]] = []
    words = iter(data)
    for word in words:
        peer, what = PEERS[word >> 7], word & 127
        if what % 8 == 7 or len(said) >= MOST:
            tick, steps = tick + 1 + next(words, 0), steps + 1
            _step(robot, deaf, tick, said)
            said = []
            if steps == STEPS:
                return
        else:
            said += [(peer, *message) for message in _message(robot, peer, what, words, tick, said)]
    _step(robot, deaf, tick + 1, said)


def seeds() -> list[bytes]:
    """Honest talk; a merge that turns into lies; noise."""
    honest = bytes([0, 128, 128, 1, 0, 200, 7, 0, 6, 1, 0, 7, 4, 3, 0, 0, 4, 0, 9, 12, 0, 128, 7, 0])
    turned = honest + bytes([121, 1, 200, 0, 255, 0, 7, 60, 90, 2, 3, 12, 255, 0, 7, 60])
    return [honest, turned, bytes([byte | 128 for byte in honest]) + turned, bytes(range(0, 256, 3))]


def _message(
    robot: Robot, peer: str, what: int, words: Iterator[int], tick: int, said: list[tuple[str, str, bytes]]
) -> list[tuple[str, bytes]]:
    """What a peer says: by the lowest digit of `what` the kind, by the next words the lies in it."""
    one, two = next(words, 0), next(words, 0)
    known, told = robot.exchange._known[peer], robot.exchange._told[peer]
    match what % 8:
        case 0:  # where it is, as of when
            pose = ((one - 128) / 16, (two - 128) / 16, (one ^ two) / 40)
            return [(BEACON, Beacon(max(0, tick + (what >> 3) * (two - 200)), pose).encode())]
        case 1:  # its map, honest or strewn with walls
            return [(MAP, part) for part in _parts(tick, 0, _map(what >> 3, one % 8), None, 60 + 4 * two)]
        case 2 if known.maps:  # changes to what the robot has of it
            base = max(known.maps)
            chains = [(one + k) % 7 for k in range(two % 4)]
            kept = known.maps[base].of_chains([chain for chain in chains if chain < len(known.maps[base].rings)])
            return [(DELTA, part) for part in _parts(base + 1 + what // 8, base, kept, known.maps[base], 60 + 4 * two)]
        case 3:  # what it has of the robot's map, or lacks
            missing = (frozenset(), frozenset({one % 64}), None)[two % 3]
            return [(ACK, Ack(max(told.maps, default=one), missing).encode(64))]
        case 4 if what & 16:
            other = PEERS[peer == PEERS[0]]
            return [(FRAMES, ToldFrames({other: ((two - 128) / 16, one / 16, two / 40), "r9": None}).encode())]
        case 4 if what & 8:
            return [(VIEWS, AskViews(one, ((two - 128) / 16, one / 16, two / 40)).encode())]
        case 4:
            views = Views(0, tick + one, np.array([[one, two]] * (1 + what), np.int64))
            return [(VIEWS, views._replace(in_vain=np.array([[two, one, what % 16]] * two, np.int64)).encode())]
        case 5:  # something that was said, with another byte, twice or of another kind
            if said:
                _, kind, payload = said[one % len(said)]
                changed = bytearray(payload or b"\0")
                changed[two % len(changed)] ^= what >> 3
                return [(kind if what & 8 else KINDS[two % len(KINDS)], bytes(changed))] * (1 + (what >> 4))
            return []
        case 6:  # its map is merged as it was told
            found = robot.team.peers.get(peer)
            if isinstance(found, Unaligned) and found.log.map is not None and found.log.first_encounter is not None:
                transform = FRAME if one % 2 else (one / 16, two / 16, one / 40)
                robot.team.merge(robot.team.propose(found, transform, robot.own, {}), tick, robot.own)
            return []
    return [(KINDS[one % len(KINDS)], bytes(next(words, 0) for _ in range(two % 40)))]


def _step(robot: Robot, deaf: Robot, tick: int, said: list[tuple[str, str, bytes]]) -> None:
    heard = [Heard(tick=tick, sender=peer, kind=kind, payload=payload) for peer, kind, payload in said]
    step = robot.step(_seen(tick), heard)
    assert len(step.sends) <= MAX_SENDS and len(step.action.events) < 100
    robot.wireframe.check()
    assert len(robot.wireframe.points) < MAX_VERTICES
    deaf.step(_seen(tick), [])
    assert encode_wireframe(robot.own) == encode_wireframe(deaf.own)
    assert _own_m(robot.wireframe) > 0.95 * _own_m(robot.own)


def _own_m(drawn: Wireframe) -> float:
    """Metres of wall that the robot saw itself."""
    return float(lengths(drawn.points[drawn.edges[drawn.own]].reshape(-1, 4)).sum())


def _parts(version: int, base: int, told: GridMap, since: GridMap | None, size: int) -> list[bytes]:
    try:
        return [part.encode() for part in in_parts(version, base, encode_map(told, since).data, size)]
    except ProtocolError:  # more than a peer can say
        return []


@cache
def _map(strewn: int, seed: int) -> GridMap:
    """The robot's own map in a peer's frame, with so many short walls more, own or not."""
    honest = moved(_begun().own, inverted(FRAME))
    grid, rng = quantise(honest, 10, 0), np.random.default_rng(seed)
    starts = rng.uniform(-12.0, 12.0, (strewn, 1, 2))
    ends = Wireframe(
        (starts + np.array([(0.0, 0.0), (0.3, 0.1)])).reshape(-1, 2),
        np.full(2 * strewn, seed % 3, np.uint8),
        np.arange(2 * strewn, dtype=np.int32).reshape(-1, 2),
        np.ones(strewn, np.float32),
        np.full(strewn, seed % 2 == 1),
    )
    return grid.joined(quantise(ends, 10, 0)) if strewn else grid


def _seen(tick: int) -> Observation:
    """What a robot sees that stands in the middle of a room of 4 m x 3 m."""
    angle = np.radians(np.arange(360.0))
    with np.errstate(divide="ignore"):
        ranges = np.minimum(2.0 / np.abs(np.cos(angle)), 1.5 / np.abs(np.sin(angle))).astype("<f4")
    return Observation(tick=tick, ranges=ranges.tobytes(), odometry=(0.0, 0.0, 0.0))


@cache
def _begun() -> Robot:
    """A robot that has looked around and has heard nobody."""
    robot = Robot("r1", RobotSpec(), AgentConfig(), 7)
    for tick in range(BEGUN):
        robot.step(_seen(tick), [])
    assert len(robot.own.edges) >= 4
    return robot
