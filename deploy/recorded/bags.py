"""Bags of ROS: rosbag1, rosbag2 (SQLite, MCAP) and MCAP files with LaserScan, and Odometry or tf (REP 103, 105, 117).

The definitions of these messages are those of ROS and not those that a bag brings, of which code would be made.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.rosbag1 import Reader as Rosbag1
from rosbags.rosbag2 import Reader as Rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from agent.shell.ros2.laser_scan import APART_S, MAX_RANGE_M, LaserScan, stamp_of
from agent.shell.ros2.wire import ODOMETRY, SCAN
from deploy.recorded.bag_bounds import MORE_BYTES, bounded_memory, checked
from deploy.recorded.frames import Frames
from deploy.recorded.lidar_log import OF_LOGS, Given, LidarLog, Scan, check_amount
from deploy.recorded.noise import measured_noise
from deploy.recorded.revolution import KNOTS, unroll
from protocol.errors import InputError
from protocol.geometry import pose_of
from protocol.messages import LidarSpec

TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
FIXED_FRAME = "odom"  # the frame of odometry, by REP 105
MOUNTED = "the lidar"  # its frame where the user tells its mount: its own frame may be the robot's


class _Entry(NamedTuple):
    """One LaserScan of a bag."""

    number: int
    scan: LaserScan


@dataclass
class _Bag:
    """What is read out of a bag."""

    frames: Frames = field(default_factory=Frames)
    usable: list[_Entry] = field(default_factory=list)
    skipped: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    lidar_frame: str = ""
    limits: tuple[float, float] = (0.0, MAX_RANGE_M)  # m, of the lidar
    wheels: tuple[str, str] | None = None  # the frame of the odometry, and the robot's
    scans: int = 0  # LaserScan messages
    readings: int = 0  # of those that are usable


def definitions(old: bool) -> Typestore:
    """The messages of ROS 1 (old) or 2."""
    if not old:
        return get_typestore(Stores.LATEST)
    store = get_typestore(Stores.ROS1_NOETIC)  # which lacks that of tf
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORMS[0]))
    return store


def read_bag(file: Path, given: Given) -> LidarLog:
    """The scans of a bag, from the lidar's place by odometry. Raises InputError where none can be used."""
    try:
        with checked(file) as path, bounded_memory():
            with Rosbag1(path) if path.suffix == ".bag" else Rosbag2(path) as reader:
                bag = _read(reader, given)
            return _log(str(file), bag, given)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    except MemoryError:
        raise InputError(f"{file}: it takes more than {MORE_BYTES >> 30} GB of memory; split it") from None
    except Exception as error:  # the library checks little of bytes that are no bag
        raise InputError(f"{file}: it is no bag, or damaged: {_words(error)}") from None


def _words(error: Exception) -> str:
    return " ".join(str(error).split()).rstrip(".") or type(error).__name__


def _read(reader: Rosbag1 | Rosbag2, given: Given) -> _Bag:
    bag, wheels, old = _Bag(), Frames(), isinstance(reader, Rosbag1)
    store = definitions(old)
    decode: Callable[[bytes, str], Any] = store.deserialize_ros1 if old else store.deserialize_cdr
    scans, odometry = _topic(reader, bag, SCAN, given.scan_topic), _topic(reader, bag, ODOMETRY, given.odometry_topic)
    if scans is None:
        raise InputError(f"it has no topic of {SCAN}")
    wanted = [one for one in reader.connections if one.topic in (scans, odometry) or one.msgtype in TRANSFORMS]
    for connection, time_ns, message in _messages(reader, wanted, bag):
        kind, static = connection.msgtype, connection.topic.endswith("tf_static")
        bag.scans += kind == SCAN
        check_amount(bag.scans, bag.readings)
        try:
            if kind == SCAN:
                _take_scan(bag, decode(message, SCAN), time_ns)
            elif kind == ODOMETRY:
                _take_odometry(bag, wheels, decode(message, ODOMETRY), time_ns)
            else:
                _take_transforms(bag, decode(message, TRANSFORMS[0]), time_ns, static)
        except InputError:
            raise
        except Exception:  # as above, and one message may be damaged alone
            bag.skipped["messages that cannot be decoded"] += 1
    bag.frames.take(wheels)
    return bag


def _messages(reader: Rosbag1 | Rosbag2, wanted: list[Any], bag: _Bag) -> Iterator[tuple[Any, int, bytes]]:
    """Messages in the order of their times. Damage behind the first scan ends them, and is noted."""
    try:
        yield from reader.messages(wanted)
    except Exception as error:  # as above
        if not bag.scans or isinstance(error, MemoryError):
            raise
        bag.notes.append(f"damaged after {bag.scans} scans, and what follows is left out: {_words(error)}")


def _topic(reader: Rosbag1 | Rosbag2, bag: _Bag, kind: str, asked: str | None) -> str | None:
    """The topic with most messages of a kind, or the one that was asked for. Raises InputError where that is absent."""
    counts = Counter[str]()
    for connection in reader.connections:
        if connection.msgtype == kind:
            counts[connection.topic] += connection.msgcount
    if asked is not None and asked not in counts:
        raise InputError(f"{asked} is no topic of {kind} in it; there is {', '.join(sorted(counts)) or 'none'}")
    if not counts:
        return None
    best = asked or min(counts, key=lambda topic: (-counts[topic], topic))
    if asked is None and len(counts) > 1:
        bag.notes.append(f"{best} was read, and not {', '.join(sorted(set(counts) - {best}))}")
    return best


def _stamp(message: Any, time_ns: int) -> float:
    """Seconds of a message's header, or of its arrival where that has none."""
    return stamp_of(message) or 1e-9 * time_ns


def _pose(place: Any, turn: Any) -> tuple[float, ...]:
    return place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w


def _take_scan(bag: _Bag, told: Any, time_ns: int) -> None:
    scan = LaserScan.told(told, _stamp(told, time_ns))
    if not scan.makes_sense:
        bag.skipped["scans of no possible lidar"] += 1
        return
    if not bag.usable:
        bag.lidar_frame, bag.limits = told.header.frame_id, (told.range_min, told.range_max)
    bag.usable.append(_Entry(bag.scans - 1, scan))
    bag.readings += scan.bearings.number


def _take_odometry(bag: _Bag, wheels: Frames, told: Any, time_ns: int) -> None:
    if bag.wheels is None:
        bag.wheels = told.header.frame_id or FIXED_FRAME, told.child_frame_id or "the robot"
    wheels.add(*bag.wheels, _stamp(told, time_ns), _pose(told.pose.pose.position, told.pose.pose.orientation))


def _take_transforms(bag: _Bag, told: Any, time_ns: int, static: bool) -> None:
    for one in told.transforms:
        pose = _pose(one.transform.translation, one.transform.rotation)
        bag.frames.add(one.header.frame_id, one.child_frame_id, _stamp(one, time_ns), pose, static=static)


def _root(bag: _Bag, given: Given) -> str:
    """The frame in which odometry tells of the lidar, whose own frame is put on the robot where nobody says how."""
    frames, lidar = bag.frames, bag.lidar_frame
    if bag.wheels is None:
        moving = [frame for frame, fixed in frames.above(lidar) if not fixed]
        if given.mount is not None or not moving:
            raise InputError(f"it has no topic of {ODOMETRY}{'' if moving else f', and no tf that moves {lidar!r}'}")
        return next((frame for frame in moving if FIXED_FRAME in frame.rsplit("/")[-1]), moving[-1])
    root, robot = (frame.lstrip("/") for frame in bag.wheels)
    if given.mount is not None:
        x, y, yaw = given.mount
        bag.lidar_frame = MOUNTED
        frames.hang(MOUNTED, robot, (x, y, 0.0, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))
    elif robot not in (lidar.lstrip("/"), *(frame for frame, _ in frames.above(lidar))):
        part = next((frame for frame, fixed in reversed([*frames.above(lidar)]) if fixed), lidar)
        frames.hang(part, robot)
        bag.notes.append(f"nothing tells where {part} is on {robot}: taken as the same (--mount tells it)")
    return root


def _log(source: str, bag: _Bag, given: Given) -> LidarLog:
    """The scans, each at the end of the lidar's revolution, with their odometry."""
    if not bag.usable:
        raise InputError(f"none of its {bag.scans} scans can be used: {', '.join(bag.skipped)}")
    root, first = _root(bag, given), bag.usable[0].scan
    ends = np.array([entry.scan.end_s for entry in bag.usable])
    knots = [
        bag.frames.placed(bag.lidar_frame, root, ends - share * first.period_s) for share in np.linspace(1, 0, KNOTS)
    ]
    upside_down, ways = knots[-1].upside_down, np.stack([knot.poses for knot in knots], 1)
    lidar = _lidar(first, bag.limits, given, upside_down)
    log = LidarLog(lidar, source, skipped=bag.skipped, notes=bag.notes)
    for entry, end, way, apart in zip(bag.usable, ends.tolist(), ways, knots[-1].apart_s, strict=True):
        if apart > APART_S:
            log.skipped[f"scans without odometry within {APART_S} s"] += 1
            continue
        readings = entry.scan.at(first.bearings)
        log.add(Scan(entry.number, end, lidar.cleaned(readings), pose_of(way[-1]), way))
    if not log.scans:
        raise InputError(f"none of its {bag.scans} scans can be used: {', '.join(bag.skipped)}")
    if not lidar.turning:
        unroll(log, None, given.revolution_s, from_stamp=True)
    measured_noise(log)
    log.note_odd()
    return log


def _lidar(scan: LaserScan, limits: tuple[float, float], given: Given, upside_down: bool) -> LidarSpec:
    """The lidar that makes such scans."""
    low, high = limits
    reach = (low, high) if given.range_max_m is None else (low, given.range_max_m)
    return scan.lidar(LidarSpec(**OF_LOGS), reach, upside_down=upside_down)
