"""Partial maps of single robots that explore from different starts, each with what it holds of the truth.

Two recordings in one world make pairs of maps that share no frame, and their starts say how the frames lie.
"""

from base64 import b64decode, b64encode
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from agent.robot import Robot, Step
from deploy.bench.cases import Case, Figures
from deploy.bench.explored import explore
from deploy.bench.layouts import path_of, present
from deploy.metrics import CORNER_NEAR_M, NEAR_M, Truth, distance_to, nearest_point, truth_of
from protocol.arrays import Bools, Floats
from protocol.geometry import Pose, apply, pose_of
from protocol.messages import Observation, RobotSpec
from protocol.wireframe import Label, Wireframe, certain, decode_wireframe, encode_wireframe
from world.worldfile import load

LOOK_S = 2.0  # simulated time between two looks at the growing map
GROWTH = 4  # corners by which a map must have grown before it is kept again
LIMIT_S = 480.0  # simulated seconds: maps are partial for most of them, and later ones differ little

BUNDLED = {"maze-15": 5, "office": 4, "apartment": 3, "hall": 3, "symmetric": 8}
"""Recordings of each; symmetric must give 300 pairs."""
SHARED = {
    "gbeltramo_building": 3, "uday_building": 3, "drlnav_stage7": 2, "pal_passage_110cm_w": 2, "tb3_dqn_stage4": 2,
    "hurtado_apartment": 3, "pal_home_w": 2, "drlnav_house_tomas": 2,
}  # fmt: skip
MAZES = {"generated-10x10-1": 3, "generated-14x12-2": 4, "generated-12x12-3": 3, "generated-15x15-4": 4}


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
        wanted, limit_s = BUNDLED | MAZES | {name: SHARED[name] for name in present(SHARED)}, LIMIT_S
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

    settings = {"world": world, "robots": 1, "seed": seed, "starts": "random", "max_time_s": limit_s}
    run = explore(settings, {}, watch)
    truth, frame = run.truth(), run.frame()
    snapshots = [
        {
            "pose": pose,
            "wireframe": b64encode(encode_wireframe(wireframe)).decode(),
            "mapped": mapped(wireframe, frame, truth).astype(int).tolist(),
            "corners": _true_corners(wireframe, frame, truth),
        }
        for pose, wireframe in kept
    ]
    return {"world": world, "frame": frame, "lengths": truth.seen_lengths.tolist(), "snapshots": snapshots}


def recording_of(figures: Mapping[str, Any]) -> Recording:
    """What `record` has measured."""
    snapshots = [
        Snapshot(
            pose_of(np.array(kept["pose"])),
            decode_wireframe(b64decode(kept["wireframe"])),
            np.array(kept["mapped"], np.bool_),
            kept["corners"],
        )
        for kept in figures["snapshots"]
    ]
    return Recording(figures["world"], pose_of(np.array(figures["frame"])), np.array(figures["lengths"]), snapshots)


def corners_of(wireframe: Wireframe) -> int:
    """Vertices that the robot takes for true corners."""
    return int((wireframe.labels != Label.FRONTIER).sum())


def whole_map(world: str) -> Wireframe:
    """The true outline that a robot could reach, as a map without a flaw, in the world's frame."""
    place, spec = load(path_of(world)), RobotSpec()
    start = place.starts(1, spec.radius_m, np.random.default_rng(0))[0]
    truth = truth_of(place, (start[0], start[1]), spec.radius_m, spec.lidar.range_max_m)
    points, corner = np.unique(np.round(truth.outline.reshape(-1, 2), 6), axis=0, return_inverse=True)
    return certain(points, corner.reshape(-1, 2))


def mapped(wireframe: Wireframe, frame: Pose, truth: Truth) -> Bools:
    """(p,) which pieces of the visible true wall are in the map."""
    segments = apply(frame, wireframe.points)[wireframe.edges].reshape(-1, 4)
    near: Bools = distance_to(truth.seen_points, truth.seen_directions, segments) < NEAR_M
    return near


def _true_corners(wireframe: Wireframe, frame: Pose, truth: Truth) -> int:
    """True corners near a vertex that is taken for one."""
    points = apply(frame, wireframe.points[wireframe.labels != Label.FRONTIER])
    return int((nearest_point(truth.corners, points) < CORNER_NEAR_M).sum())
