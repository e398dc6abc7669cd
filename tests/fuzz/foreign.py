"""Fuzz targets: files of other programs, that is recorded logs, bags of ROS, and plans for `wireswarm import`."""

import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np

from deploy.exchange.maps import NamedMap
from deploy.exchange.vector import dxf, geojson, svg
from deploy.exchange.worlds import Options, read_shapes
from deploy.recorded.bags import read_bag
from deploy.recorded.carmen import read_carmen
from deploy.recorded.lidar_log import Given
from deploy.report.rundir import parse_map
from protocol.errors import InputError
from tests.deploy.recorded.bag_files import KINDS, Speaker, write_bag, yawed
from world.worldfile import WorldFileError, from_document

SUFFIXES = (".bag", ".db3", ".mcap")
SQUARE = """{"robot": "r1", "vertices": [[0, 0], [3, 0], [3, 2], [0, 2]], "labels": ["nominal", "nominal", "nominal",
"nominal"], "edges": [[0, 1], [1, 2], [2, 3], [3, 0]], "edge_likelihood": [1, 1, 1, 1]}"""
SDF = """<?xml version='1.0'?><sdf version='1.6'><world name='w'><model name='m'><pose>1 2 0 0 0 0.5</pose>
<link name='l'><pose>0 0 1 0 0 0</pose><collision name='b'><geometry><box><size>2 0.15 2.5</size></box></geometry>
</collision><collision name='c'><pose>3 0 0 0 0 0</pose><geometry><cylinder><radius>0.2</radius><length>3</length>
</cylinder></geometry></collision></link></model></world></sdf>"""
HOUSE = '{"verts": [[0, 0], [4, 0], [4, 3], [0, 3]], "bbox": {"min": [0, 0], "max": [4, 3]}, "room_num": 1}'
MAP_SERVER = "image: plan.pgm\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"
PLAN = b"P5 12 10 255\n" + b"\0" * 12 + (b"\0" + b"\xfe" * 10 + b"\0") * 8 + b"\0" * 12


def a_log(data: bytes) -> None:
    """A recorded lidar log."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "some.log"
        file.write_bytes(data)
        with suppress(InputError):
            read_carmen(file, Given())


def logs() -> list[bytes]:
    """One of FLASER, one of ROBOTLASER."""
    pose, robotlaser = b" 1 2 0.5 1 2 0.5 ", b"ROBOTLASER1 0 -1.57 3.14 0.0174 30.0 0.01 0 10"
    return [
        b"FLASER 10" + b" 2.5" * 10 + pose + b"0 host 0\n" + b"FLASER 10" + b" 2.5" * 10 + pose + b"1 host 1\n",
        robotlaser + b" 3" * 10 + b" 0" + pose + b"0.1 0 0.3 0.2 9 12.5 host 12.5\n",
    ]


def a_bag(data: bytes) -> None:
    """A bag of the kind that the first byte says."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"some{SUFFIXES[data[0] % len(SUFFIXES) if data else 0]}"
        file.write_bytes(data[1:])
        with suppress(InputError):
            read_bag(file, Given())


@cache
def bags() -> list[bytes]:
    """One of each kind, with scans, odometry and a transform."""
    made = []
    for kind, suffix in zip(KINDS, SUFFIXES, strict=True):
        speaker = Speaker(kind)
        said = [speaker.transform(99.0, "base_link", "laser", (0.2, 0.0, 0.5), yawed(0.0), "/tf_static")]
        for k in range(3):
            said += [speaker.odometry(100.0 + 0.2 * k, (0.1 * k, 0.0, 0.0)), speaker.scan(100.0 + 0.2 * k, np.ones(9))]
        with tempfile.TemporaryDirectory() as folder:
            path = write_bag(Path(folder), kind, said)
            file = path if path.is_file() else next(path.glob(f"*{suffix}"))
            made.append(bytes([SUFFIXES.index(suffix)]) + file.read_bytes())
    return made


def an_import(data: bytes) -> None:
    """A plan of the form that the first byte says, beside the picture that a map of map_server names."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "plan.pgm").write_bytes(PLAN)
        file = Path(folder) / f"some{tuple(plans())[data[0] % len(plans()) if data else 0]}"
        file.write_bytes(data[1:])
        with suppress(InputError, WorldFileError):
            from_document(read_shapes(file, Options(width_m=2.0)).document("some", file.name), "some.yaml")


@cache
def plans() -> dict[str, bytes]:
    """A file of each form by its suffix."""
    named = NamedMap("r1", "r1", "its own", parse_map(SQUARE), np.zeros((0, 2)), 3.5)
    return {
        ".yaml": MAP_SERVER.encode(),
        ".pgm": PLAN,
        ".world": SDF.encode(),
        ".house": HOUSE.encode(),
        ".json": SQUARE.encode(),
        ".geojson": geojson(named).encode(),
        ".svg": svg(named).encode(),
        ".dxf": dxf(named).encode(),
    }


def imports() -> list[bytes]:
    """One of each form."""
    return [bytes([k]) + content for k, content in enumerate(plans().values())]
