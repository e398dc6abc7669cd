"""A run as an MCAP file of Foxglove's own messages, for Foxglove and whatever else reads MCAP.

Log times are simulated seconds. Frames: world, ID of a robot (its body as it truly is), and ID/map (its own frame).
Topics: /tf (bodies), /frames (own frames), /walls and /maps/ID (scenes), /events (log), /coverage (JSON), and /scan/ID
where the run has kept its scans.
"""

from __future__ import annotations

import json
import math
from collections import defaultdict
from pathlib import Path

from foxglove import Channel, Context, open_mcap
from foxglove import messages as m
from foxglove.channels import FrameTransformsChannel, LaserScanChannel, LogChannel, SceneUpdateChannel

from deploy.recorded.bag_files import MCAP
from deploy.recorded.runs import kept_scans, ranges_of
from deploy.report import style
from deploy.report.rundir import Map, Run, read_drawable
from deploy.report.story import SEVERITY, sentence
from protocol.arrays import Floats
from protocol.files import check_own, make_folder, write_whole
from protocol.geometry import Pose, pose_of
from protocol.temporary import temporary_folder
from protocol.wireframe import Label
from world.recorder import TEAM
from world.worldfile import World, rings_of

WALL_M, VERTEX_M = 0.04, 0.08  # widths as drawn
LEVELS = {"warning": m.LogLevel.Warning, "error": m.LogLevel.Error}
"""By severity."""


def write_mcap(path: Path, out: Path) -> list[Path]:
    """Write run.mcap into a folder, and return it. Raises InputError where the run's world or paths are lacking.

    Also where a file of another kind has that name.
    """
    run, world = read_drawable(path)
    check_own(MCAP, out / "run.mcap")
    make_folder(out)
    with temporary_folder() as folder:
        made, context = folder / "run.mcap", Context()
        with open_mcap(made, context=context):
            _write(run, world, context)
        write_whole(out / "run.mcap", made.read_bytes())
    return [out / "run.mcap"]


def _write(run: Run, world: World, context: Context) -> None:
    frames = [_transform(0.0, f"{robot}/map", pose_of(run.frames[robot])) for robot in run.placed]
    FrameTransformsChannel("/frames", context=context).log(m.FrameTransforms(transforms=frames), log_time=0)
    _walls(world, context)
    _bodies(run, context)
    for k, robot in enumerate(run.robots):
        colour = _painted(style.colour(k))
        maps = SceneUpdateChannel(f"/maps/{robot}", context=context)
        for t, drawn in run.snapshots.get(robot, []):
            maps.log(m.SceneUpdate(entities=[_entity(t, robot, drawn, colour)]), log_time=_ns(t))
        _scans(run, robot, context)
    log = LogChannel("/events", context=context)
    for event in run.events:
        level = LEVELS.get(SEVERITY.get(event["event"], ""), m.LogLevel.Info)
        said = m.Log(timestamp=_stamp(event["t"]), level=level, message=sentence(event), name=event["robot"])
        log.log(said, log_time=_ns(event["t"]))
    _coverage(run, context)


def _painted(colour: str) -> m.Color:
    """A colour of the report's."""
    red, green, blue = (part / 255 for part in bytes.fromhex(colour[1:]))
    return m.Color(r=red, g=green, b=blue, a=1.0)


def _walls(world: World, context: Context) -> None:
    grey = m.Color(r=0.55, g=0.58, b=0.62, a=1.0)
    lines = [_line(m.LinePrimitiveLineType.LineStrip, ring, grey) for ring in rings_of(world.solid)]
    scene = m.SceneEntity(timestamp=_stamp(0.0), frame_id="world", id="walls", lines=lines)
    SceneUpdateChannel("/walls", context=context).log(m.SceneUpdate(entities=[scene]), log_time=0)


def _bodies(run: Run, context: Context) -> None:
    """Where all robots are, tick by tick in one message, as a viewer that jumps reads one message of a topic."""
    tf, at = FrameTransformsChannel("/tf", context=context), defaultdict(list)
    for robot, poses in run.poses.items():
        for t, x, y, theta in poses.tolist():
            at[t].append(_transform(t, robot, (x, y, theta)))
    for t in sorted(at):
        tf.log(m.FrameTransforms(transforms=at[t]), log_time=_ns(t))


def _entity(t: float, robot: str, drawn: Map, colour: m.Color) -> m.SceneEntity:
    """A robot's map in its own frame; it takes the place of the one before."""
    walls = _line(m.LinePrimitiveLineType.LineList, drawn.vertices[drawn.edges].reshape(-1, 2), colour)
    size = m.Vector3(x=VERTEX_M, y=VERTEX_M, z=VERTEX_M)
    open_end = _painted(style.OPEN)
    vertices = [
        m.SpherePrimitive(pose=_pose((x, y, 0.0)), size=size, color=open_end if label == Label.FRONTIER else colour)
        for (x, y), label in zip(drawn.vertices.tolist(), drawn.labels.tolist(), strict=True)
    ]
    return m.SceneEntity(
        timestamp=_stamp(t), frame_id=f"{robot}/map", id=robot, frame_locked=True, lines=[walls], spheres=vertices
    )


def _scans(run: Run, robot: str, context: Context) -> None:
    source, lidar = run.path / "scans" / f"{robot}.jsonl", run.lidar
    if not source.exists():
        return
    scans = LaserScanChannel(f"/scan/{robot}", context=context)
    bearings = lidar.bearings() - math.radians(lidar.mount_yaw_deg)
    for scan in kept_scans(source, lidar.beams):
        message = m.LaserScan(
            timestamp=_stamp(scan["t"]),
            frame_id=robot,
            pose=_pose(lidar.mount),
            start_angle=float(bearings[0]),
            end_angle=float(bearings[-1]),
            ranges=ranges_of(scan).tolist(),
        )
        scans.log(message, log_time=_ns(scan["t"]))


def _coverage(run: Run, context: Context) -> None:
    """A JSON object a second: the share of each robot and of the team."""
    names = [name for name in (*run.robots, TEAM) if name in run.metrics]
    channel = Channel("/coverage", message_encoding="json", context=context)
    for t in run.metrics[TEAM].t.tolist() if TEAM in run.metrics else []:
        shares = {name: run.metrics[name].at("coverage", t) for name in names}
        channel.log(json.dumps(shares).encode(), log_time=_ns(t))


def _line(kind: m.LinePrimitiveLineType, points: Floats, colour: m.Color) -> m.LinePrimitive:
    places = [m.Point3(x=x, y=y, z=0.0) for x, y in points.tolist()]
    return m.LinePrimitive(type=kind, pose=_pose((0.0, 0.0, 0.0)), thickness=WALL_M, points=places, color=colour)


def _transform(t: float, child: str, pose: Pose) -> m.FrameTransform:
    x, y, theta = pose
    return m.FrameTransform(
        timestamp=_stamp(t),
        parent_frame_id="world",
        child_frame_id=child,
        translation=m.Vector3(x=x, y=y, z=0.0),
        rotation=_turn(theta),
    )


def _pose(pose: Pose) -> m.Pose:
    x, y, theta = pose
    return m.Pose(position=m.Vector3(x=x, y=y, z=0.0), orientation=_turn(theta))


def _turn(theta: float) -> m.Quaternion:
    return m.Quaternion(x=0.0, y=0.0, z=math.sin(theta / 2), w=math.cos(theta / 2))


def _ns(t: float) -> int:
    return round(t * 1e9)


def _stamp(t: float) -> m.Timestamp:
    return m.Timestamp(sec=int(t), nsec=_ns(t) - int(t) * 10**9)
