"""Bags of ROS: rosbag1, rosbag2 (SQLite, MCAP) and MCAP files with LaserScan, and Odometry or tf (REP 103, 105, 117).

The definitions of these messages are those of ROS and not those that a bag brings, of which code would be made.
"""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Reader as Rosbag1
from rosbags.rosbag2 import Reader as Rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from agent.shell.ros2.laser_scan import APART_S, stamp_of
from agent.shell.ros2.timing import Timing
from agent.shell.ros2.wire import ODOMETRY, SCAN
from deploy.recorded.bag_bounds import MORE_BYTES, bounded_memory, checked
from deploy.recorded.bag_files import how_to_mend, known_by_suffix
from deploy.recorded.frames import Frames
from deploy.recorded.laser_scans import BagScan, of_most, typical
from deploy.recorded.lidar_log import OF_LOGS, Given, LidarLog, Scan, check_amount
from deploy.recorded.revolution import KNOTS
from deploy.recorded.topics import most_of, transforms_beside
from deploy.recorded.untold import find_untold
from protocol.arrays import Floats
from protocol.errors import InputError
from protocol.geometry import Pose, pose_of
from protocol.messages import LidarSpec

TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
FIXED_FRAME = "odom"  # the frame of odometry, by REP 105
OTHER_MCAP = "Profile is not ros2"  # by the library, of the file of another program, or of one that does not tell
MOUNTED = "the lidar"  # its frame where the user tells its mount: its own frame may be the robot's


@dataclass
class _Bag:
    """What is read out of a bag."""

    frames: Frames = field(default_factory=Frames)
    usable: list[BagScan] = field(default_factory=list)
    skipped: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    lidar_frame: str = ""
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
        with checked(file) as found, known_by_suffix(found) as path, bounded_memory():
            with Rosbag1(path) if path.suffix == ".bag" else Rosbag2(path) as reader:
                bag = _read(reader, given)
            return _log(str(file), bag, given)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    except MemoryError:
        raise InputError(f"{file}: it takes more than {MORE_BYTES >> 30} GB of memory; split it") from None
    except Exception as error:  # the library checks little of bytes that are no bag
        if OTHER_MCAP in (words := _words(error)):
            raise InputError(f"{file}: an MCAP file that does not say that it is of ROS 2 (its profile)") from None
        raise InputError(f"{file}: it is no bag, or damaged: {words}{how_to_mend(file)}") from None


def _words(error: Exception) -> str:
    text = re.sub(r"\('(.*?)',\)", r"\1", " ".join(str(error).split()))  # of an error within it
    return text.rstrip(".") or type(error).__name__


def _read(reader: Rosbag1 | Rosbag2, given: Given) -> _Bag:
    bag, wheels, old = _Bag(), Frames(), isinstance(reader, Rosbag1)
    store = definitions(old)
    decode: Callable[[bytes, str], Any] = store.deserialize_ros1 if old else store.deserialize_cdr
    scans = most_of(reader.connections, SCAN, given.scan_topic, bag.notes)
    if scans is None:
        raise InputError(f"it has no topic of {SCAN}")
    odometry = most_of(reader.connections, ODOMETRY, given.odometry_topic, bag.notes, scans)
    told = [one.topic for one in reader.connections if one.msgtype in TRANSFORMS]
    timing = Timing(None if given.revolution_s is None else 0.0)  # of one moment, until it is unrolled as given
    topics = {scans, odometry, *transforms_beside(scans, told, bag.notes)}
    wanted = [one for one in reader.connections if one.topic in topics]
    for connection, time_ns, message in _messages(reader, wanted, bag):
        kind, static = connection.msgtype, connection.topic.endswith("tf_static")
        bag.scans += kind == SCAN
        check_amount(bag.scans, bag.readings)
        try:
            if kind == SCAN:
                _take_scan(bag, decode(message, SCAN), time_ns, timing)
            elif kind == ODOMETRY:
                _take_odometry(bag, wheels, decode(message, ODOMETRY), time_ns)
            else:
                _take_transforms(bag, decode(message, TRANSFORMS[0]), time_ns, static, connection.topic)
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


def _pose(place: Any, turn: Any) -> tuple[float, ...]:
    return place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w


def _take_scan(bag: _Bag, told: Any, time_ns: int, timing: Timing) -> None:
    entry = BagScan.told(bag.scans - 1, told, 1e-9 * time_ns, timing)
    if not entry.scan.makes_sense:
        bag.skipped["scans of no possible lidar"] += 1
        return
    bag.usable.append(entry)
    bag.readings += entry.scan.bearings.number


def _take_odometry(bag: _Bag, wheels: Frames, told: Any, time_ns: int) -> None:
    if bag.wheels is None:
        frame, child = told.header.frame_id.lstrip("/") or FIXED_FRAME, told.child_frame_id.lstrip("/")
        # a frame that stands for both is that of the robot in tf, or that of odometry
        bag.wheels = ("the odometry", "the robot") if child in ("", frame) else (frame, child)
    pose = _pose(told.pose.pose.position, told.pose.pose.orientation)
    wheels.add(*bag.wheels, stamp_of(told, 1e-9 * time_ns), pose, arrived_s=1e-9 * time_ns)


def _take_transforms(bag: _Bag, told: Any, time_ns: int, static: bool, topic: str) -> None:
    for one in told.transforms:
        link, pose = (one.header.frame_id, one.child_frame_id), _pose(one.transform.translation, one.transform.rotation)
        bag.frames.add(*link, stamp_of(one, 1e-9 * time_ns), pose, static=static, topic=topic, arrived_s=1e-9 * time_ns)


def _root(bag: _Bag, given: Given) -> str:
    """The frame in which odometry tells of the lidar, whose own frame is put on the robot where nobody says how."""
    frames, lidar = bag.frames, bag.lidar_frame
    if bag.wheels is None:
        moving = [frame for frame, fixed in frames.above(lidar) if not fixed]
        if given.mount is not None or not moving:
            raise InputError(f"it has no topic of {ODOMETRY}{'' if moving else f', and no tf that moves {lidar!r}'}")
        return next((frame for frame in moving if FIXED_FRAME in frame.rsplit("/")[-1]), moving[-1])
    root, robot = bag.wheels
    is_told = robot in (lidar.lstrip("/"), *(frame for frame, _ in frames.above(lidar)))
    part = frames.part(lidar, root)
    if given.mount is not None:
        x, y, yaw = given.mount
        bag.lidar_frame = MOUNTED
        turn = 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)
        with suppress(InputError):  # tf of a lidar that is not level, in place of which the mount is told
            if frames.placed(lidar, robot if is_told else part, np.zeros(1)).upside_down:
                turn = turn[3], turn[2], 0.0, 0.0  # after half a turn about its x axis
        frames.hang(MOUNTED, robot, (x, y, 0.0, *turn))
    elif not is_told:
        frames.hang(part, robot)
        bag.notes.append(f"nothing tells where {part} is on {robot}: taken as the same (--mount tells it)")
    return root


def _log(source: str, bag: _Bag, given: Given) -> LidarLog:
    """The scans, each at the end of the lidar's revolution, with their odometry."""
    if not bag.usable:
        raise InputError(f"none of its {bag.scans} scans can be used: {', '.join(bag.skipped)}")
    usable = of_most(bag.usable, bag.skipped)
    bag.lidar_frame = usable[0].frame
    root = _root(bag, given)
    usable = _until_reset(bag, root, usable)
    most = typical(usable, bag.notes)
    ends = np.array([entry.scan.end_s for entry in usable])
    knots = [
        bag.frames.placed(bag.lidar_frame, root, ends - share * most.scan.period_s)
        for share in np.linspace(1, 0, KNOTS)
    ]
    bag.notes += bag.frames.contradictions(bag.lidar_frame, root)
    upside_down, ways = knots[-1].upside_down or bool(given.upside_down), np.stack([knot.poses for knot in knots], 1)
    lidar = _lidar(most, given, upside_down)
    log = LidarLog(lidar, source, skipped=bag.skipped, notes=bag.notes, mount=_mount(bag, root, ends[:1]))
    told = knots[-1].apart_s, knots[-1].rarest
    for entry, end, way, apart, rarest in zip(usable, ends.tolist(), ways, *told, strict=True):
        if apart > APART_S:
            log.skipped[f"scans without {rarest} within {APART_S} s"] += 1
            continue
        readings = entry.scan.at(most.scan.bearings)
        log.add(Scan(entry.number, end, lidar.cleaned(readings), pose_of(way[-1]), way))
    if not log.scans:
        raise InputError(f"none of its {bag.scans} scans can be used: {', '.join(bag.skipped)}")
    find_untold(log, given, from_stamp=True)
    return log


def _mount(bag: _Bag, root: str, times: Floats) -> Pose | None:
    """The lidar's on the robot at times (1,); None on one whose frame is not level, as that of a camera."""
    robot = bag.frames.robot(bag.lidar_frame, root)
    with suppress(InputError):
        return pose_of(bag.frames.placed(bag.lidar_frame, robot, times).poses[0])
    return None


def _until_reset(bag: _Bag, root: str, entries: list[BagScan]) -> list[BagScan]:
    """The scans up to where the clock of the odometry begins anew, as that of a simulation does that is reset.

    What follows is another drive, and its times may be those of the first one. Raises InputError where no scan is left.
    """
    reset_s = bag.frames.reset_s(bag.lidar_frame, root)
    if reset_s is None:
        return entries
    bag.frames.end(reset_s)
    kept = [entry for entry in entries if entry.arrived_s < reset_s]
    if not kept:
        raise InputError("the clock of its odometry jumps back before its first scan: split it there")
    bag.skipped += Counter({"scans after the clock of the odometry jumped back": len(entries) - len(kept)})
    return kept


def _lidar(most: BagScan, given: Given, upside_down: bool) -> LidarSpec:
    """The lidar that makes such scans."""
    low, high = most.limits
    reach = (low, high) if given.range_max_m is None else (low, given.range_max_m)
    return most.scan.lidar(LidarSpec(**OF_LOGS), reach, upside_down=upside_down)
