"""What travels: round trips, and any other bytes raise ProtocolError and nothing else."""

import contextlib
import math
import struct
import time
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from protocol import keys
from protocol.codec import MAX_MESSAGE_BYTES, decode, encode
from protocol.errors import ProtocolError
from protocol.messages import (
    MAX_BEAMS,
    MAX_EVENT_DEPTH,
    MAX_EVENT_VALUES,
    MAX_ROBOTS,
    MAX_TICK,
    MAX_WAY,
    WORLD_EVENTS,
    Action,
    Clock,
    End,
    Event,
    Heard,
    Join,
    LidarSpec,
    MapReport,
    Message,
    Observation,
    OdometrySpec,
    PoseReport,
    Progress,
    Refused,
    RobotSpec,
    ScanReport,
    Send,
    Welcome,
)
from protocol.settings import MAX_NUMBER
from protocol.wireframe import MAX_VERTICES, Label, Wireframe, decode_wireframe, encode_wireframe

KINDS: list[type[Message]] = [
    Action, Clock, End, Heard, Join, MapReport, Observation,
    PoseReport, Progress, Refused, ScanReport, Send, Welcome,
]  # fmt: skip

ids = st.from_regex(r"[a-z][a-z0-9_-]{0,15}", fullmatch=True)
finite = st.floats(-MAX_NUMBER, MAX_NUMBER)
ticks = st.integers(0, MAX_TICK)
poses = st.tuples(finite, finite, finite)
near_poses = st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), finite)
texts = st.text(max_size=50)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-int(MAX_NUMBER), int(MAX_NUMBER)) | finite | texts,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(texts, inner, max_size=4),
    max_leaves=20,
)
scans = st.lists(st.floats(0, width=32) | st.just(math.nan), max_size=400).map(lambda r: np.asarray(r, "<f4").tobytes())
words = ids.filter(lambda word: word not in WORLD_EVENTS)
events = st.builds(Event, event=words, data=st.dictionaries(texts, json_values, max_size=4).filter(
    lambda data: depth(data) <= MAX_EVENT_DEPTH
))  # fmt: skip
clocks = st.builds(
    Clock, tick=ticks, t=st.floats(0, 1e9), status=st.dictionaries(ids, texts, max_size=5), ended=st.none() | texts
)
messages = st.one_of(
    st.builds(Join, version=st.integers(0, 100), robot=ids),
    st.builds(
        Welcome,
        version=st.just(1),
        robot=ids,
        spec=st.just(RobotSpec()),
        seed=st.integers(0, 2**63 - 1),
        lockstep=st.booleans(),
        run=st.just("0123456789abcdef"),
        tick=ticks,
    ),
    st.builds(Refused, reason=texts),
    st.builds(End, reason=texts),
    st.builds(Observation, tick=ticks, ranges=scans, odometry=near_poses, heard=ticks),
    st.builds(Heard, tick=ticks, sender=ids, kind=ids, payload=st.binary(max_size=500)),
    st.builds(Send, tick=ticks, to=ids | st.just("*"), kind=ids, payload=st.binary(max_size=500)),
    st.builds(
        Action,
        tick=ticks,
        speed_mps=finite,
        turn_rps=finite,
        sent=ticks,
        complete=st.booleans(),
        events=st.lists(events, max_size=3),
        map_bytes=ticks,
        filter_bytes=ticks,
        step_ms=st.floats(0, 1e6),
    ),
    st.builds(ScanReport, tick=ticks, wireframe=st.binary(max_size=500)),
    st.builds(MapReport, tick=ticks, wireframe=st.binary(max_size=500)),
    st.builds(PoseReport, tick=ticks, pose=poses),
    clocks,
    st.builds(Progress, clock=clocks, coverage=st.dictionaries(ids, finite, max_size=5), team=finite),
)


def depth(value: Any) -> int:
    if isinstance(value, dict):
        value = list(value.values())
    return 1 + max(map(depth, value), default=0) if isinstance(value, list) else 0


def refused(kind: type[Message], data: bytes) -> str:
    with pytest.raises(ProtocolError) as caught:
        decode(kind, data)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@given(messages)
def test_every_message_comes_back_as_it_was(message: Message) -> None:
    data = encode(message)
    assert decode(type(message), data) == message
    assert encode(decode(type(message), data)) == data


@given(st.sampled_from(KINDS), st.binary(max_size=300))
def test_any_bytes_are_a_message_or_one_error(kind: type[Message], data: bytes) -> None:
    try:
        message = decode(kind, data)
    except ProtocolError as error:
        assert "\n" not in str(error)
    else:
        assert decode(kind, encode(message)) == message


@given(messages, st.data())
def test_a_flipped_byte_is_a_message_or_one_error(message: Message, draw: st.DataObject) -> None:
    data = bytearray(encode(message))
    data[draw.draw(st.integers(0, len(data) - 1))] ^= draw.draw(st.integers(1, 255))
    with contextlib.suppress(ProtocolError):
        decode(type(message), bytes(data))


@given(st.sampled_from(KINDS), json_values)
def test_any_msgpack_is_a_message_or_one_error(kind: type[Message], value: Any) -> None:
    fields = dict.fromkeys(kind.model_fields, value)
    for data in (msgpack.packb(value), msgpack.packb(fields)):
        with contextlib.suppress(ProtocolError):
            decode(kind, data)


def test_too_large_is_refused_at_both_ends() -> None:
    assert "at most" in refused(Send, b"\xc0" * (MAX_MESSAGE_BYTES + 1))
    with pytest.raises(ProtocolError, match="at most"):
        encode(Send(tick=0, to="r2", kind="map", payload=b"x" * MAX_MESSAGE_BYTES))
    with pytest.raises(ProtocolError, match="no msgpack"):  # an array that claims four thousand million items
        decode(Send, b"\xdd\xff\xff\xff\xff")


def test_deep_nesting_is_refused() -> None:
    refused(Action, b"\x91" * 100_000 + b"\xc0")
    deep: Any = None
    for _ in range(MAX_EVENT_DEPTH):
        deep = [deep]
    data = {"tick": 0, "speed_mps": 0.0, "turn_rps": 0.0, "events": [{"event": "e", "data": {"a": deep}}]}
    assert "deeper" in refused(Action, msgpack.packb(data))


@pytest.mark.parametrize(
    "value",
    [
        math.nan,
        math.inf,
        1.7e308,
        [{"a": -math.inf}],
        b"bytes",
        "x" * 1001,
        {"x" * 1001: 1},
        2**64 - 1,
        -int(MAX_NUMBER) - 1,
        msgpack.Timestamp(0),
    ],
    ids=lambda value: type(value).__name__,
)
def test_event_data_is_bounded_json(value: Any) -> None:
    action = {"tick": 0, "speed_mps": 0.0, "turn_rps": 0.0, "events": [{"event": "e", "data": {"v": value}}]}
    assert refused(Action, msgpack.packb(action)).startswith("a bad Action: events.0.data")


@pytest.mark.parametrize("values", [[MAX_EVENT_VALUES], [1, MAX_EVENT_VALUES - 1], [100] * 100])
def test_events_have_so_many_values_together(values: list[int]) -> None:
    """Also those of a mind in this process, which are no bytes."""
    still = {"tick": 0, "speed_mps": 0.0, "turn_rps": 0.0}
    some = [{"event": "e", "data": {"v": [None] * (number - 1)}} for number in values]
    many = [*some, {"event": "e", "data": {"v": 0}}]
    whole = Action(**still, events=[Event.model_validate(event) for event in some])
    assert decode(Action, msgpack.packb(still | {"events": some})) == whole
    assert "more than 10000 values" in refused(Action, msgpack.packb(still | {"events": many}))
    with pytest.raises(ValidationError, match="more than 10000 values"):
        Action(**still, events=[Event.model_validate(event) for event in many])


@pytest.mark.parametrize(
    ("kind", "fields"),
    [
        (Join, dict.fromkeys(map(str, range(100_000)))),
        (Action, {"events": [{"event": "e", "data": {"v": [None] * 9_990}}] * 100}),
        (Action, {"events": [dict.fromkeys(map(str, range(1_000)))] * 100}),
        (Action, {"merged": dict.fromkeys(map(str, range(100_000)), -1)}),
        (PoseReport, {"teammates": [{}] * 10_000}),
        (PoseReport, {"teammates": [{}] * 100_000}),
    ],
)
def test_a_long_message_is_refused_at_once(kind: type[Message], fields: dict[str, Any]) -> None:
    """Such ones took 0.4 s and more, and some of them ended no robot's part."""
    data = msgpack.packb(fields)
    began = time.process_time()
    refused(kind, data)
    assert time.process_time() - began < 0.2


def test_a_join_is_short_whatever_it_says() -> None:
    longest = Join(version=2**63, robot="r" * 16, session="0" * 32, process="0" * 16)
    assert decode(Join, encode(longest)) == longest
    assert "at most 512" in refused(Join, encode(longest) + bytes(512))


@pytest.mark.parametrize("event", sorted(WORLD_EVENTS))
def test_what_becomes_of_a_robot_only_the_world_says(event: str) -> None:
    said = {"tick": 0, "speed_mps": 0.0, "turn_rps": 0.0, "events": [{"event": event}]}
    assert f"events.0.event: Value error, only the world says {event}" in refused(Action, msgpack.packb(said))


def test_no_more_robots_are_told_of_than_a_run_may_have() -> None:
    robots = [f"r{number}" for number in range(MAX_ROBOTS + 1)]
    mate = {"tick": 0, "pose": [0, 0, 0], "covariance": [0] * 9, "status": "merged"}
    mates = [mate | {"robot": robot} for robot in robots]
    assert "at most 500" in refused(PoseReport, msgpack.packb({"tick": 0, "pose": [0, 0, 0], "teammates": mates}))
    merged = {"tick": 0, "speed_mps": 0.0, "turn_rps": 0.0, "merged": dict.fromkeys(robots, 0)}
    assert "at most 500" in refused(Action, msgpack.packb(merged))


def test_a_key_comes_once() -> None:
    twice = b"\x82" + 2 * (msgpack.packb("reason") + msgpack.packb("time"))
    assert "a key twice" in refused(End, twice)
    within = {"tick": 0, "speed_mps": 0.0, "turn_rps": 0.0, "events": [{"event": "e", "data": {"a": 1, "b": 2}}]}
    assert "a key twice" in refused(Action, msgpack.packb(within).replace(b"\xa1b", b"\xa1a"))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1.7e308, -1.1 * MAX_NUMBER, "1.0", True, None])
def test_numbers_are_numbers_of_which_no_sum_overflows(bad: object) -> None:
    assert "speed_mps" in refused(Action, msgpack.packb({"tick": 0, "speed_mps": bad, "turn_rps": 0.0}))
    assert "step_ms" in refused(Action, msgpack.packb({"tick": 0, "speed_mps": 0.0, "turn_rps": 0.0, "step_ms": bad}))
    assert "pose" in refused(PoseReport, msgpack.packb({"tick": 0, "pose": [0.0, bad, 0.0]}))


@pytest.mark.parametrize("ranges", [[1.0, -0.5], [-math.inf]])
def test_a_range_is_a_length(ranges: list[float]) -> None:
    data = msgpack.packb({"tick": 0, "ranges": np.asarray(ranges, "<f4").tobytes(), "odometry": [0, 0, 0]})
    assert "range" in refused(Observation, data)
    assert "float32" in refused(Observation, msgpack.packb({"tick": 0, "ranges": b"abc", "odometry": [0, 0, 0]}))


def test_a_way_is_of_finite_poses_and_ends_at_the_stamp() -> None:
    def seen(way: bytes) -> bytes:
        return encode(Observation.model_construct(tick=0, ranges=b"", odometry=(1.0, 0.0, 0.0), way=way))

    way = np.array([[0.5, 0, 0], [1, 0, 0]], "<f8")
    assert np.array_equal(decode(Observation, seen(way.tobytes())).poses(), way)
    assert np.array_equal(decode(Observation, seen(b"")).poses(), [[1, 0, 0]])
    assert "does not end" in refused(Observation, seen(way[:1].tobytes()))
    assert "three float64" in refused(Observation, seen(way.tobytes()[:-1]))
    assert "not within 1e+09" in refused(Observation, seen(np.full((1, 3), math.nan).tobytes()))
    assert "at most" in refused(Observation, seen(bytes(24 * (MAX_WAY + 1))))


def test_an_observation_that_no_robot_can_make_is_refused() -> None:
    """A beacon has no room for such a tick or place, and perception none for another lidar's scan."""
    assert "tick" in refused(Observation, msgpack.packb({"tick": 2**32, "ranges": b"", "odometry": [0, 0, 0]}))
    assert "10000 m" in refused(Observation, msgpack.packb({"tick": 0, "ranges": b"", "odometry": [3e6, 0, 0]}))
    with pytest.raises(ProtocolError, match="a scan of 2 ranges from a lidar of 360 beams"):
        Observation(tick=0, ranges=bytes(8), odometry=(0.0, 0.0, 0.0)).check(360)


def test_beams_of_a_spec_have_bearings_and_moments() -> None:
    still, turning = LidarSpec(turning=False), LidarSpec(turning=True)
    assert np.degrees(still.bearings()) == pytest.approx(np.arange(360)) and (still.moments() == 1).all()
    assert turning.moments() == pytest.approx(np.arange(1, 361) / 360) and turning.moments()[-1] == 1
    narrow = LidarSpec(
        beams=8, turning=True, field_of_view_deg=180, first_beam_deg=90, clockwise=True, mount_yaw_deg=10
    )
    assert np.degrees(narrow.bearings()) == pytest.approx([100, 77.5, 55, 32.5, 10, -12.5, -35, -57.5])
    assert np.degrees(narrow.view()) == pytest.approx([21.25, 90])
    assert narrow.moments() == pytest.approx([*np.arange(9, 17) / 16])


def test_a_lidar_is_no_finer_than_a_ring_of_beams_may_be() -> None:
    """What its scans leave out is filled with beams as close."""
    LidarSpec(beams=MAX_BEAMS, field_of_view_deg=90)
    with pytest.raises(ValidationError, match="4096 beams over 1 degrees are 1474560 a revolution; at most 16384 are"):
        LidarSpec(beams=MAX_BEAMS, field_of_view_deg=1)


@pytest.mark.parametrize("range_min_m", [0.0, 0.1])
def test_a_reading_of_0_is_none_whatever_the_least_range(range_min_m: float) -> None:
    """Many drivers say 0 for what was not measured, and 0 for the least range, too."""
    lidar = LidarSpec(range_min_m=range_min_m)
    seen = lidar.cleaned(np.array([0.0, -1.0, math.nan, 0.2, 3.5, math.inf]))
    assert np.array_equal(seen, [math.nan, math.nan, math.nan, 0.2, math.inf, math.inf], equal_nan=True)


def test_wheels_are_read_at_least_once_a_scan() -> None:
    for rate_hz, poses in ((25, 5), (5, 1), (1, 1), (12, 2)):
        assert RobotSpec(odometry=OdometrySpec(rate_hz=rate_hz)).poses_per_scan == poses
    assert RobotSpec(lidar=LidarSpec(rate_hz=0.01)).poses_per_scan == MAX_WAY


@pytest.mark.parametrize("name", ["", "R1", "r/1", "r*", "../r1", "r1/in/obs", "x" * 17, "r1\n"])
def test_a_robot_id_is_no_key_expression(name: str) -> None:
    assert "robot" in refused(Join, msgpack.packb({"version": 1, "robot": name}))


def test_unknown_and_missing_fields_are_named() -> None:
    assert "extra" in refused(End, msgpack.packb({"reason": "time", "extra": 1}))
    assert "reason" in refused(End, msgpack.packb({}))
    assert "must be a map" in refused(End, msgpack.packb([1, 2]))


@st.composite
def wireframes(draw: st.DrawFn) -> Wireframe:
    """Chains and rings: each vertex has at most one edge out and one in."""
    n = draw(st.integers(0, 30))
    order = draw(st.permutations(range(n)))
    kept = draw(st.lists(st.booleans(), min_size=n, max_size=n))
    edges = [(order[i], order[(i + 1) % n]) for i in range(n) if kept[i] and n > 1]
    m = len(edges)
    coordinate = st.floats(-1e4, 1e4, width=32)
    unit = st.floats(0, 1, width=32)
    return Wireframe(
        np.array(draw(st.lists(st.tuples(coordinate, coordinate), min_size=n, max_size=n))).reshape(n, 2),
        np.array(draw(st.lists(st.sampled_from(list(Label)), min_size=n, max_size=n)), np.uint8),
        np.array(edges, np.int32).reshape(m, 2),
        np.array(draw(st.lists(unit, min_size=m, max_size=m)), np.float32),
        np.array(draw(st.lists(st.booleans(), min_size=m, max_size=m)), np.bool_),
    )


@given(wireframes())
def test_a_wireframe_comes_back_as_it_was(wireframe: Wireframe) -> None:
    data = encode_wireframe(wireframe)
    back = decode_wireframe(data)
    for name in ("points", "labels", "edges", "likelihood", "own"):
        old, new = getattr(wireframe, name), getattr(back, name)
        assert np.array_equal(old, new) and old.dtype == new.dtype
    assert encode_wireframe(back) == data


@given(wireframes(), st.data())
@settings(max_examples=200)
def test_a_broken_wireframe_is_one_error_or_whole(wireframe: Wireframe, draw: st.DataObject) -> None:
    data = bytearray(encode_wireframe(wireframe))
    for _ in range(draw.draw(st.integers(1, 4))):
        data[draw.draw(st.integers(0, len(data) - 1))] = draw.draw(st.integers(0, 255))
    cut = draw.draw(st.integers(0, len(data)))
    for hostile in (bytes(data), bytes(data[:cut]), bytes(data) + b"\0"):
        try:
            decode_wireframe(hostile).check()
        except ProtocolError as error:
            assert "\n" not in str(error)


@given(st.binary(max_size=100))
def test_any_bytes_behind_a_wireframe_header_are_one_error_or_whole(data: bytes) -> None:
    for hostile in (data, b"WSWF\x01" + data):
        with contextlib.suppress(ProtocolError):
            decode_wireframe(hostile).check()


def test_hostile_wireframes_name_what_is_wrong() -> None:
    def header(version: int, n: int, m: int) -> bytes:
        return struct.pack("<4sBII", b"WSWF", version, n, m)

    square = Wireframe(
        np.array([[0, 0], [1, 0], [1, 1]], float),
        np.zeros(3, np.uint8),
        np.array([[0, 1], [1, 2]], np.int32),
        np.ones(2, np.float32),
        np.ones(2, np.bool_),
    )
    good = encode_wireframe(square)
    points, labels, edges, likelihood = 13, 13 + 24, 13 + 27, 13 + 35
    cases = [
        (header(2, 0, 0), "version 2"),
        (header(1, MAX_VERTICES + 1, 0), "at most"),
        (header(1, 2**32 - 1, 2**32 - 1), "at most"),
        (header(1, 3, 2), "bytes long"),
        (good[:points] + struct.pack("<f", math.nan) + good[points + 4 :], "not finite"),
        (good[:points] + struct.pack("<f", 1e6) + good[points + 4 :], "out of bounds"),
        (good[:labels] + b"\x07" + good[labels + 1 :], "unknown label"),
        (good[:edges] + struct.pack("<H", 9) + good[edges + 2 :], "not there"),
        (good[:edges] + struct.pack("<H", 1) + good[edges + 2 :], "itself"),
        (good[:edges] + struct.pack("<HHHH", 0, 1, 0, 2) + good[edges + 8 :], "out of one vertex"),
        (good[:edges] + struct.pack("<HHHH", 0, 2, 1, 2) + good[edges + 8 :], "into one vertex"),
        (good[:likelihood] + struct.pack("<f", 1.5) + good[likelihood + 4 :], "likelihood"),
        (good[:-1] + b"\x02", "origin"),
    ]
    for data, word in cases:
        with pytest.raises(ProtocolError, match=word):
            decode_wireframe(data)


def test_keys_are_those_of_the_contract() -> None:
    assert {keys.to_robot("r1", channel) for channel in keys.INPUTS} == {
        "robots/r1/in/obs", "robots/r1/in/radio", "robots/r1/in/end",
    }  # fmt: skip
    assert {keys.from_robot("r1", channel) for channel in keys.OUTPUTS} == {
        f"robots/r1/out/{name}" for name in ("act", "radio", "scan", "map", "pose")
    }
    assert keys.alive("r1") == "robots/r1/alive"
    assert keys.service("r1", keys.JOIN) == "robots/r1/srv/join"
    for key in (keys.alive("r1"), keys.service("r1", keys.JOIN), keys.from_robot("r1", keys.ACT)):
        assert keys.robot_of(key) == "r1"
    for key in ("robots", "robots/r1", "world/pub/clock", ""):
        assert keys.robot_of(key) == ""
    assert keys.channel_of(keys.from_robot("r1", keys.ACT)) == keys.ACT
