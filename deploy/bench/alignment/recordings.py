"""Partial maps of single robots that explore from different starts, each with what it holds of the truth.

Two recordings in one world make pairs of maps that share no frame, and their starts say how the frames lie.
"""

import zlib
from base64 import b64decode, b64encode
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from agent.robot import Robot, Step
from deploy.bench.cases import Case, Figures
from deploy.bench.explored import explore
from deploy.bench.layouts import path_of, present, written
from deploy.metrics import Truth, distance_to, truth_of
from protocol.arrays import Bools, Floats
from protocol.geometry import Pose, apply
from protocol.messages import Observation, RobotSpec
from protocol.wireframe import Label, Wireframe, decode_wireframe, encode_wireframe
from world.maze import generate
from world.worldfile import load

LOOK_S = 2.0  # simulated time between two looks at the growing map
GROWTH = 4  # corners by which a map must have grown before it is kept again
NEAR_M = 0.05  # a true wall within this of a mapped one is in the map (contracts.md)
CORNER_M = 0.10  # a mapped vertex within this of a true corner is that corner (the scorer's)
LIMIT_S = 480.0  # simulated seconds: maps are partial for most of them, and later ones differ little

BUNDLED = {"maze-15": 5, "office": 4, "apartment": 3, "hall": 3, "symmetric": 8}
"""Recordings of each; symmetric must give 300 pairs."""
SHARED = {
    "gbeltramo_building": 3,
    "uday_building": 3,
    "drlnav_stage7": 2,
    "pal_passage_110cm_w": 2,
    "tb3_dqn_stage4": 2,
    "hurtado_apartment": 3,
    "pal_home_w": 2,
    "drlnav_house_tomas": 2,
}
MAZES = {"generated-10x10-1": 3, "generated-14x12-2": 4, "generated-12x12-3": 3, "generated-15x15-4": 4}
"""generated-WIDTHxHEIGHT-SEED, by world/maze.py."""


class Snapshot(NamedTuple):
    """One moment of a robot: what it would say to a peer, and what of the truth is in it."""

    pose: Pose  # robot in its own frame
    wireframe: Wireframe  # its map, in its own frame
    mapped: Bools  # (p,) which pieces of the visible true wall are in the map
    corners: int  # true corners that are in the map


class Recording(NamedTuple):
    """One robot's snapshots in one world, in order of time."""

    world: str
    frame: Pose  # the robot's own frame in the world
    lengths: Floats  # (p,) metres of each piece of the visible true wall; alike for all recordings of a world
    snapshots: list[Snapshot]


def cases(quick: bool) -> list[Case]:
    """One case a recording. It does not depend on the alignment: a robot alone hears no map to align."""
    if quick:
        wanted, limit_s = {"symmetric": 2, "apartment": 2}, 120.0
    else:
        shared = {name: SHARED[name] for name in present(list(SHARED))}
        wanted, limit_s = BUNDLED | MAZES | shared, LIMIT_S
    return [
        Case(f"{world}/{seed}", record, {"world": world, "seed": seed, "limit_s": limit_s}, ignores="agent/alignment/")
        for seed in range(max(wanted.values()))
        for world in wanted
        if seed < wanted[world]
    ]


def record(world: str, seed: int, limit_s: float) -> Figures:
    """Let one robot explore from a start drawn from the seed; its snapshots as JSON values."""
    kept: list[tuple[Pose, Wireframe]] = []

    def watch(robot: Robot, observation: Observation, step: Step) -> None:
        if observation.tick % round(LOOK_S * robot.spec.lidar.rate_hz):
            return
        if corners_of(robot.wireframe) >= GROWTH + (corners_of(kept[-1][1]) if kept else 0):
            kept.append((step.pose.pose, robot.wireframe))

    settings = {"world": file_of(world), "robots": 1, "seed": seed, "starts": "random", "max_time_s": limit_s}
    run = explore(settings, {}, watch)
    truth, frame = run.truth(), run.frame()
    snapshots = [
        {
            "pose": list(pose),
            "wireframe": _packed(encode_wireframe(wireframe)),
            "mapped": _packed(np.packbits(mapped(wireframe, frame, truth)).tobytes()),
            "corners": _true_corners(wireframe, frame, truth),
        }
        for pose, wireframe in kept
    ]
    lengths = _packed(truth.seen_lengths.astype("<f4").tobytes())
    return {"world": world, "frame": list(frame), "lengths": lengths, "snapshots": snapshots}


def _packed(data: bytes) -> str:
    return b64encode(zlib.compress(data)).decode()


def _unpacked(text: str) -> bytes:
    return zlib.decompress(b64decode(text))


def recording_of(figures: Mapping[str, Any]) -> Recording:
    """What `record` has measured."""
    lengths = np.frombuffer(_unpacked(figures["lengths"]), "<f4").astype(np.float64)

    def snapshot(kept: Mapping[str, Any]) -> Snapshot:
        bits = np.frombuffer(_unpacked(kept["mapped"]), np.uint8)
        wireframe = decode_wireframe(_unpacked(kept["wireframe"]))
        mapped = np.unpackbits(bits, count=len(lengths)).astype(np.bool_)
        x, y, theta = kept["pose"]
        return Snapshot((x, y, theta), wireframe, mapped, kept["corners"])

    x, y, theta = figures["frame"]
    return Recording(figures["world"], (x, y, theta), lengths, [snapshot(kept) for kept in figures["snapshots"]])


def corners_of(wireframe: Wireframe) -> int:
    """Vertices that the robot takes for true corners."""
    return int((wireframe.labels != Label.FRONTIER).sum())


def file_of(world: str) -> str:
    """File of a layout's name, which may be that of a generated maze."""
    if not world.startswith("generated-"):
        return path_of(world)
    size, seed = world.split("-")[1:]
    width, height = map(float, size.split("x"))
    return written(generate(width, height, np.random.default_rng(int(seed))))


def whole_map(world: str) -> Wireframe:
    """The true outline that a robot could reach, as a map without a flaw, in the world's frame."""
    place, spec = load(file_of(world)), RobotSpec()
    start = place.starts(1, spec.radius_m, np.random.default_rng(0))[0]
    truth = truth_of(place, (start[0], start[1]), spec.radius_m, spec.lidar.range_max_m)
    points, corner = np.unique(np.round(truth.outline.reshape(-1, 2), 6), axis=0, return_inverse=True)
    edges = corner.reshape(-1, 2).astype(np.int32)
    n, m = len(points), len(edges)
    return Wireframe(points, np.zeros(n, np.uint8), edges, np.ones(m, np.float32), np.ones(m, np.bool_))


def mapped(wireframe: Wireframe, frame: Pose, truth: Truth) -> Bools:
    """(p,) which pieces of the visible true wall are in the map."""
    segments = apply(frame, wireframe.points)[wireframe.edges].reshape(-1, 4)
    near: Bools = distance_to(truth.seen_points, truth.seen_directions, segments) < NEAR_M
    return near


def _true_corners(wireframe: Wireframe, frame: Pose, truth: Truth) -> int:
    """True corners near a vertex that is taken for one."""
    points = apply(frame, wireframe.points[wireframe.labels != Label.FRONTIER])
    away = np.linalg.norm(truth.corners[:, None] - points[None], axis=2).min(1, initial=np.inf)
    return int((away < CORNER_M).sum())
