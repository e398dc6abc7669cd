"""Every decoder and file loader as a fuzz target: any bytes are taken, or refused by the one error that is due."""

import json
import ssl
import tempfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout, suppress
from functools import cache
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import msgpack
import numpy as np

from agent.communication.receiving import KEPT_MAPS, Known
from agent.config import AgentConfig
from agent.robot import Robot
from agent.shell.checkpoint import revived, save
from deploy.bandwidth.books import NoRunError, read_books
from deploy.bandwidth.representations import measure
from deploy.bandwidth.tables import document, print_tables
from deploy.config import load
from deploy.report import page, plan
from deploy.report.rundir import Run, read_run
from deploy.report.words import headline, subtitle
from deploy.terminal.pairs import fates
from protocol import messages
from protocol.certificates import ROSTER, Identity, fingerprint, read_roster
from protocol.codec import decode, encode
from protocol.configuration import ConfigError
from protocol.document import parse_document
from protocol.errors import InputError, ProtocolError
from protocol.frames import ToldFrames
from protocol.map_codec import encode_map
from protocol.messages import Message
from protocol.secrets import read_secrets
from protocol.talk import Ack, Beacon, Part, in_parts
from protocol.viewpoints import AskViews, Views, decode_views
from protocol.wireframe import decode_wireframe, encode_wireframe
from tests.fuzz import foreign, hearing, maps, ros2
from tests.tiny import ROOM, tiny_config
from world import checkpoint
from world.config import WorldConfig
from world.episode import Episode
from world.tick import Outputs
from world.worldfile import World, WorldFileError, from_document

PATIENCE = 150  # ticks


class Target(NamedTuple):
    """What takes bytes, and bytes to begin with."""

    fuzz: Callable[[bytes], object]
    seeds: Callable[[], list[bytes]]


KINDS = sorted(Message.__subclasses__(), key=lambda kind: kind.__name__)


def a_message(data: bytes) -> None:
    """The first byte names the kind."""
    kind = KINDS[data[0] % len(KINDS)] if data else KINDS[0]
    try:
        message = decode(kind, data[1:])
    except ProtocolError as error:
        assert "\n" not in str(error)
        return
    assert decode(kind, encode(message)) == message


def _messages() -> list[bytes]:
    event = messages.Event(event="accepted", data={"peer": "r2", "transform": [1.0, 2.0, 0.5], "list": [{"a": None}]})
    mate = messages.TeammatePose(robot="r2", tick=4, pose=(1.0, 2.0, 3.0), covariance=(0.1,) * 9, status="merged")
    place = messages.SharedPlace(x_m=1.0, y_m=-2.0)
    clock = messages.Clock(tick=5, t=1.0, status={"r1": "exploring"})
    link = messages.LinkReport(sender="r1", receiver="r2", loss=0.5, bytes=7)
    made: list[Message] = [
        messages.Join(version=1, robot="r1", session="0a"),
        messages.Welcome(version=1, robot="r1", run="0a" * 8, spec=messages.RobotSpec(), seed=7, lockstep=True),
        messages.Observation(tick=1, ranges=b"\0\0\x80\x3f" * 8, odometry=(0.0, 1.0, 2.0), heard=1),
        messages.Heard(tick=1, sender="r1", kind="map", payload=b"abc"),
        messages.Send(tick=1, to="*", kind="map", payload=b"abc"),
        messages.Action(tick=1, speed_mps=0.1, turn_rps=0.2, sent=1, events=[event], merged={"r2": 3}),
        messages.PoseReport(tick=1, pose=(0.0, 1.0, 2.0), teammates=[mate]),
        place,
        clock,
        messages.LinkTable(tick=1, links=[link]),
        messages.Progress(clock=clock, coverage={"r1": 0.5}, team=0.5),
    ]
    return [bytes([KINDS.index(type(message))]) + encode(message) for message in made]


def a_part(data: bytes) -> None:
    """Each of the small messages between robots, by the first byte."""
    kind = data[0] % 5 if data else 0
    try:
        match kind:
            case 0:
                Beacon.decode(data[1:])
            case 1:
                part = Part.decode(data[1:])
                assert part.encode() == data[1:]
            case 2:
                Ack.decode(data[1:])
            case 3:
                frames = ToldFrames.decode(data[1:])
                assert ToldFrames.decode(frames.encode()).of.keys() == frames.of.keys()
            case _:
                told = decode_views(data[1:])
                if isinstance(told, AskViews):
                    assert decode_views(told.encode()) == told
                else:
                    assert told.points.size or told.ends.size
    except ProtocolError as error:
        assert "\n" not in str(error)


def _parts() -> list[bytes]:
    views = Views(0, 9, maps.some_map(0).cells[:6].astype("int64"))
    return [
        b"\0" + Beacon(7, (1.0, 2.0, 3.0)).encode(),
        b"\1" + Part(9, 4, 1, 3, b"abc").encode(),
        b"\1" + Part(9, 0, 0, 1, b"abc").encode(),
        b"\2" + Ack(9).encode(),
        b"\2" + Ack(9, frozenset({1, 5})).encode(9),
        b"\2" + Ack(9, None).encode(),
        b"\3" + ToldFrames({"r3": (1.0, 2.0, 3.0), "r4": None}).encode(),
        b"\4" + AskViews(7).encode(),
        b"\4" + views.encode(),
        b"\4" + views._replace(in_vain=np.array([[3, -4, 5], [60, 7, 15]])).encode(),
    ]


@cache
def _honest(seed: int, since: int) -> bytes:
    """Body of a map, or of what changed since another."""
    base = _honest_map(since) if since else None
    return encode_map(_honest_map(seed), base).data


@cache
def _honest_map(seed: int) -> "maps.GridMap":
    fresh = maps.some_map(seed % 7, 2)
    return encode_map(
        maps.BASE.of_chains([seed % 6, (seed + 2) % 6]).joined(maps.replace(fresh, axis=maps.BASE.axis))
    ).map


def a_conversation(data: bytes) -> None:
    """What a peer says, message by message: honest maps and changes, in parts, again, cut, changed, late or made up."""
    known, said, tick, at = Known(), [Part(1, 0, 0, 1, b"").encode()], 1, 0
    while at + 3 <= len(data) and tick < 400:
        what, version, spice = data[at : at + 3]
        at += 3
        version = version % 31 + 1
        match what % 6:
            case 0:  # a whole map, in parts of so many bytes
                said = [part.encode() for part in in_parts(version, 0, _honest(version, 0), 40 + spice)]
            case 1:  # changes to a version that it may or may not have
                since = spice % version
                said = [part.encode() for part in in_parts(version, since, _honest(version, since), 40 + spice)]
            case 2:  # time goes by
                tick += spice
                continue
            case 3:  # one byte of what was said is another
                said[-1] = _with(said[-1], version, spice)
            case 4:  # bytes of its own
                said = [data[at : at + spice]]
                at += spice
            case _:  # once more, without a part
                del said[spice % len(said) :]
                said = said or [b""]
        for message in said:
            try:
                ack, whole = known.take_part(tick, Part.decode(message), PATIENCE, period_ticks=0)
                if ack is not None:
                    Ack.decode(ack.encode(64))
                if whole is not None:
                    whole.wireframe.check()
            except ProtocolError as error:
                assert "\n" not in str(error)
            assert len(known.maps) <= KEPT_MAPS + 1
            if message[:1] == b"\x10":
                _views(known, message)
        tick += 1


def _views(known: Known, message: bytes) -> None:
    try:
        told = decode_views(message)
    except ProtocolError:
        return
    if isinstance(told, Views):
        known.views_asked = True
        known.take_views(told)


def _with(message: bytes, where: int, what: int) -> bytes:
    changed = bytearray(message or b"\0")
    changed[where % len(changed)] ^= what or 1
    return bytes(changed)


def _conversations() -> list[bytes]:
    return [
        bytes([0, 5, 200, 1, 9, 5, 3, 7, 9, 5, 0, 0]),
        bytes([0, 5, 0, 2, 0, 99, 1, 8, 5, 1, 12, 8, 5, 1, 1]),
        bytes(range(90)),
    ]


def a_wireframe(data: bytes) -> None:
    """The wireframe of telemetry and files of the world."""
    try:
        found = decode_wireframe(data)
    except ProtocolError as error:
        assert "\n" not in str(error)
        return
    assert encode_wireframe(found) == encode_wireframe(decode_wireframe(encode_wireframe(found)))


def _wireframes() -> list[bytes]:
    return [encode_wireframe(maps.some_map(seed).wireframe()) for seed in range(3)]


def a_document(data: bytes) -> None:
    """YAML and JSON."""
    try:
        json.dumps(parse_document(data.decode("utf-8", "replace")))
    except InputError as error:
        assert "\n" not in str(error)


def a_world(data: bytes) -> None:
    """A world file, with all that a run takes of it."""
    try:
        document = parse_document(data.decode("utf-8", "replace"))
        world: World = from_document(document if isinstance(document, dict) else {}, "fuzz.yaml")
        assert len(world.segments) and world.hash
        world.regions(0.105)
    except InputError as error:
        assert isinstance(error, WorldFileError) or "fuzz.yaml" not in str(error)


def _worlds() -> list[bytes]:
    polygons = "polygons: [[[[0, 0], [4, 0], [4, 4], [0, 4]], [[1, 1], [2, 1], [2, 2]]]]\nwalls: [[0, 0, 1e-1, 2]]"
    return [
        ROOM.encode(),
        polygons.encode(),
        b'{"boxes": [[0, 0, 0, 1, 1]]}',
        b"a: &a [*a]",
        b"--- !!set {a}\n? [x]\n: |\n y",
    ]


def a_setting(data: bytes) -> None:
    """A setting of the command line."""
    with suppress(ConfigError):
        load(None, {}, [data.decode("utf-8", "replace")])


def _settings() -> list[bytes]:
    return [
        b"seed=3",
        b"radio.models=[{kind: bernoulli, loss: 0.3}, {kind: blackout, begin_s: 1, end_s: 2, robots: [r1]}]",
        b"spec.lidar.noise_m=1e-3",
        b"until=complete",
        b"radio={range_m: 3}",
    ]


def some_secrets(data: bytes) -> None:
    """The file of secrets."""
    file = _folder() / "secrets"
    file.write_bytes(data)
    with suppress(InputError):
        read_secrets(file, ["r1"])


def a_roster(data: bytes) -> None:
    """The roster of certificates, and a certificate."""
    (_folder() / ROSTER).write_bytes(data)
    with suppress(InputError):
        read_roster(_folder())
    with suppress(ValueError):
        fingerprint(data.decode(errors="replace"))


def _rosters() -> list[bytes]:
    identity = Identity("r1.0123456789abcdef", "0" * 64)._asdict()
    return [json.dumps({"r1": identity, "world": identity}).encode(), ssl.DER_cert_to_PEM_cert(bytes(99)).encode()]


@cache
def _folder() -> Path:
    kept = tempfile.TemporaryDirectory(prefix="wireswarm-fuzz-")
    _KEPT.append(kept)
    return Path(kept.name)


_KEPT: list[tempfile.TemporaryDirectory[str]] = []

_TALLY = '{"messages": 1, "bytes": 9}'
_MAP = '{"robot": "r1", "vertices": [[0, 0], [1, 0]], "labels": ["nominal", "frontier"], "edges": [[0, 1]], '
_MAP += '"edge_likelihood": [0.9]}'
_TALLIES = f'{{"map": {_TALLY}}}'
_KINDS = f'{{"map": {{"offered": {_TALLY}, "delivered": {_TALLY}, "dropped": {{}}}}}}'
_TEXTS = {
    "manifest.json": '{"seed": 1, "ended": "complete", "config": {"radio": {}}}',
    "summary.json": '{"robots": {"r1": {"coverage": 0.5, "t_90": null, "ended": "time"}}, "team": {"coverage": 0.5}}',
    "bandwidth.json": f'{{"links": [{{"sender": "r1", "receiver": "r2", "kinds": {_KINDS}}}], '
    f'"robots": {{"r1": {{"offered": {_TALLIES}, "addressed": {_TALLIES}, "delivered": {{}}, "dropped": {{}}}}}}}}',
    "world.yaml": ROOM,
    "truth.json": '{"frames": {"r1": [0, 1, 2]}, "robot_radius": 0.1, "lidar_range": 3.5}',
    "maps/r1.json": _MAP,
    "snapshots/r1.jsonl": f'{{"t": 10, "map": {_MAP}}}\n',
    "trajectories/r1.tum": "0 0 0 0 0 0 0 1\n0.2 0.1 0 0 0 0 0 1\n",
    "metrics.csv": "t,robot,coverage,bytes_sent\n1,r1,0.5,7\n1,team,0.5,7\n",
    "radio.csv": "tick,sender,receiver,kind,bytes,outcome\n3,r1,r2,map,9,delivered\n",
    "events.jsonl": '{"t": 1, "tick": 5, "robot": "r1", "event": "accepted", "peer": "r2", "reason": "x", '
    '"transform": [1, 2, 3]}\n',
    "updates.jsonl": f'{{"t": 0.2, "tick": 1, "robot": "r1", "told": ["r1"], "map": {_MAP}}}\n',
}
FILES = {name: text.encode() for name, text in _TEXTS.items()}
"""A small run directory."""
NAMES = list(FILES)


def a_run_directory(data: bytes) -> None:
    """The readers of a run directory one of whose files, by the first byte, is anything."""
    for run in _changed(data):
        _numbers(run)


def a_report(data: bytes) -> None:
    """The page of such a run directory, without its curves."""
    for run in _changed(data):
        texts = (headline(run), subtitle(run), plan.overview(run), *(plan.single(run, robot) for robot in run.robots))
        assert all(isinstance(text, str) for text in texts)
        json.dumps(plan.slider(run), allow_nan=False)
        for section in (page._robots, page._radio, page._events, page._configuration):
            section(run).encode()


def a_measurement(data: bytes) -> None:
    """The bandwidth of such a run directory."""
    for run in _changed(data):
        with suppress(NoRunError):
            figures = document(run.path, measure(run.path))
            json.dumps(figures, allow_nan=False)
            with redirect_stdout(StringIO()):
                print_tables(figures)


def _changed(data: bytes) -> Iterator[Run]:
    folder = _folder() / "run"
    if not folder.exists():
        for name, content in FILES.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
    name = NAMES[data[0] % len(NAMES)] if data else NAMES[0]
    (folder / name).write_bytes(data[1:])
    try:
        yield read_run(folder)
    finally:
        (folder / name).write_bytes(FILES[name])


def _numbers(run: Run) -> None:
    assert run.duration >= 0
    with suppress(NoRunError):
        read_books(run.path)
    with suppress(ValueError):
        fates(run.path)


def _files() -> list[bytes]:
    return [bytes([k]) + content for k, content in enumerate(FILES.values())]


def a_checkpoint(data: bytes) -> None:
    """What a killed world left, whose checkpoint is anything; by the first byte also one with right checksums."""
    config, files = _killed()
    for file, content in files.items():
        file.write_bytes(content)
    out = _folder() / "killed"
    (out / checkpoint.CHECKPOINT_FILE).write_bytes(
        b"".join(map(_sealed, _values(data[1:]))) if data[:1] == b"\1" else data[1:]
    )
    with suppress(checkpoint.CheckpointError):
        Episode.resume(config, out)


def _values(row: bytes) -> Iterator[bytes]:
    """A row of msgpack values one by one; the last is what is none."""
    unpacker, at = msgpack.Unpacker(max_buffer_size=0), 0
    unpacker.feed(row)
    with suppress(ValueError, msgpack.UnpackException):
        while True:
            unpacker.skip()
            yield row[at : unpacker.tell()]
            at = unpacker.tell()
    yield row[at:]


def _sealed(data: bytes) -> bytes:
    return bytes(msgpack.packb((zlib.crc32(data), data)))


@cache
def _killed() -> tuple[WorldConfig, dict[Path, bytes]]:
    config, out = tiny_config(_folder(), robots=2), _folder() / "killed"
    episode = Episode(config, out)
    for tick in range(3):
        told = messages.Send(tick=tick, to="*", kind="map", payload=b"abc")
        action = messages.Action(tick=tick, speed_mps=0.1, turn_rps=0.2, sent=1)
        episode.advance({robot: Outputs([told], action, None) for robot in episode.live})
    episode.kill("r2", "gone")
    return config, {file: file.read_bytes() for file in out.rglob("*") if file.is_file()}


def _checkpoints() -> list[bytes]:
    whole = next(content for file, content in _killed()[1].items() if file.name == checkpoint.CHECKPOINT_FILE)
    unpacker = msgpack.Unpacker()
    unpacker.feed(whole)
    return [b"\0" + whole, b"\1" + b"".join(data for _, data in unpacker)]


def a_mind(data: bytes) -> None:
    """A robot's checkpoint that is anything; by the first byte also one with a right checksum."""
    (_folder() / "r1.msgpack").write_bytes(_sealed(data[1:]) if data[:1] == b"\1" else data[1:])
    told = StringIO()
    with redirect_stderr(told):
        assert isinstance(revived(_robot, _folder(), "r1", "run", 99), Robot)
    assert told.getvalue().count("\n") <= 1


def _robot() -> Robot:
    return Robot("r1", messages.RobotSpec(), AgentConfig(), 7)


@cache
def _minds() -> list[bytes]:
    """A robot's checkpoint after some steps."""
    robot = _robot()
    for tick in range(6):
        ranges = np.full(360, 1.5, np.float32).tobytes()
        robot.step(messages.Observation(tick=tick, ranges=ranges, odometry=(0.0, 0.0, 0.0)), [])
    save(_folder(), "r1", "run", 5, robot.state())
    whole = (_folder() / "r1.msgpack").read_bytes()
    return [b"\0" + whole, b"\1" + msgpack.unpackb(whole)[1]]


TARGETS = {
    "messages": Target(a_message, _messages),
    "parts": Target(a_part, _parts),
    "maps": Target(maps.fuzz_one, maps.seeds),
    "conversations": Target(a_conversation, _conversations),
    "hearing": Target(hearing.fuzz_one, hearing.seeds),
    "wireframes": Target(a_wireframe, _wireframes),
    "documents": Target(a_document, _worlds),
    "worlds": Target(a_world, _worlds),
    "settings": Target(a_setting, _settings),
    "secrets": Target(some_secrets, lambda: [b"r1:0123456789abcdef\nviewer:0123456789abcdef\n"]),
    "rosters": Target(a_roster, _rosters),
    "logs": Target(foreign.a_log, foreign.logs),
    "bags": Target(foreign.a_bag, foreign.bags),
    "imports": Target(foreign.an_import, foreign.imports),
    "runs": Target(a_run_directory, _files),
    "reports": Target(a_report, _files),
    "measurements": Target(a_measurement, _files),
    "checkpoints": Target(a_checkpoint, _checkpoints),
    "minds": Target(a_mind, _minds),
    "ros2": Target(ros2.fuzz_one, ros2.seeds),
}
"""By name."""

BROKE = {
    "messages": [b"\x0c\x81\xa5a\nkey\x01"],  # the error quoted the line end
    "maps": [b"\x13\x1c\xaf\x1c\xafK\x15\x90#!wL\x90\x1c#!wL\x00"],  # beyond 10 km once turned
    "documents": [b"[" * 100_000, b"!!bool abc", b'!!int ""', b"? [a]\n: 1", b"\x00", b"&a [*a]"],
    "worlds": [b"boxes: [[0, 0, 0, 1, 1e-9]]", b"polygons: [[[[0, 0], [1e-9, 0], [0, 1e-9]]]]"],
    "settings": [b"seed=2026-13-45", b"seed=" + b"[" * 100_000, b"seed=0x" + b"f" * 5000],
    "logs": [b"FLASER 0 1 2\n", b"FLASER -5 1 2\n", foreign.logs()[0].replace(b"1 2 0.5", b"1e999 2 inf")],
    "runs": [
        *(bytes([k]) + b"[" * 100_000 for k in range(len(FILES))),
        b"\x09tick,sender,receiver,kind,bytes,,outcome\n3,r1,r2,map,9,delivered\n",  # a line without an outcome
    ],
    "measurements": [
        *(bytes([k]) + b"[" * 100_000 for k in range(len(FILES))),
        b"\x02" + FILES["bandwidth.json"].replace(b'"bytes": 9', b'"bytes": null'),
        b"\x02" + FILES["bandwidth.json"].replace(b'"links"', b'"x": 1e999, "links"'),
        b"\x07-1e5 0 0 0 0 0 0 1\n0.2 -1e5 0 0 0 0 0 1\n0.4 1 0 0 0 0 0 1\n",  # a grid of 5.67 TiB
        b"\x0b" + FILES["updates.jsonl"].replace(b"[1, 0]", b"[1, 1e300]"),
        b"\x0b" + FILES["updates.jsonl"].replace(b'["r1"]', b"7"),
        b"\x0a" + FILES["events.jsonl"].replace(b"accepted", b"dead").replace(b"5", b"null"),
    ],
    "reports": [
        b"> ",  # a path without poses
        b"\x08t,robot,coverage,bytes_sent\n1e999,r1,0.5,7\n1,team,0.5,7\n",
        b"\x06" + FILES["snapshots/r1.jsonl"].replace(b"10", b"1e999"),
    ],
}
"""What once was a traceback, a hang or a crash, by target."""
