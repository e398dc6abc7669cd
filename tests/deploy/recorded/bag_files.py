"""Bags as tests want them, written by the library that reads them."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.rosbag1 import Writer as Rosbag1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2

from deploy.recorded.bags import ODOMETRY, SCAN, definitions
from protocol.arrays import Floats
from protocol.geometry import Pose

TF = "tf2_msgs/msg/TFMessage"
KINDS = ("rosbag1", "sqlite3", "mcap")
Turn = tuple[float, float, float, float]


class Said(NamedTuple):
    """One message on a topic."""

    t: float
    topic: str
    kind: str
    message: Any  # as made by a Speaker, or bytes


class Speaker:
    """Makes messages of ROS 1 or 2."""

    def __init__(self, kind: str) -> None:
        self.old = kind == "rosbag1"
        self.store = definitions(self.old)

    def make(self, name: str, **fields: Any) -> Any:
        return self.store.types[name](**fields)

    def header(self, t: float, frame: str) -> Any:
        sec, nanosec = divmod(round(t * 1e9), 10**9)
        stamp = self.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **({"seq": 0} if self.old else {}))

    def scan(self, t: float, ranges: Floats, **more: Any) -> Said:
        n = len(ranges)
        fields = {
            "angle_min": -0.5 * math.pi,
            "angle_max": 0.5 * math.pi,
            "angle_increment": math.pi / n,
            "time_increment": 0.0,
            "scan_time": 0.2,
            "range_min": 0.1,
            "range_max": 10.0,
        } | more
        header = self.header(fields.pop("stamp", t), fields.pop("frame", "laser"))
        readings = np.asarray(ranges, np.float32)
        message = self.make(SCAN, header=header, ranges=readings, intensities=np.zeros(0, np.float32), **fields)
        return Said(t, "/scan", SCAN, message)

    def odometry(self, t: float, pose: Pose, child: str = "base_link") -> Said:
        place = self.make("geometry_msgs/msg/Point", x=pose[0], y=pose[1], z=0.0)
        x, y, z, w = yawed(pose[2])
        turn = self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
        zero = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        message = self.make(
            ODOMETRY,
            header=self.header(t, "odom"),
            child_frame_id=child,
            pose=self.make(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=self.make("geometry_msgs/msg/Pose", position=place, orientation=turn),
                covariance=np.zeros(36),
            ),
            twist=self.make(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=self.make("geometry_msgs/msg/Twist", linear=zero, angular=zero),
                covariance=np.zeros(36),
            ),
        )
        return Said(t, "/odom", ODOMETRY, message)

    def transform(
        self, t: float, parent: str, child: str, place: Sequence[float], turn: Turn, topic: str = "/tf"
    ) -> Said:
        x, y, z = place
        moved = self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)
        turned = self.make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", turn, strict=True)))
        stamped = self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(t, parent),
            child_frame_id=child,
            transform=self.make("geometry_msgs/msg/Transform", translation=moved, rotation=turned),
        )
        return Said(t, topic, TF, self.make(TF, transforms=[stamped]))

    def encoded(self, said: Said) -> bytes:
        if isinstance(said.message, bytes):
            return said.message
        encode = self.store.serialize_ros1 if self.old else self.store.serialize_cdr
        return bytes(encode(said.message, said.kind))


def yawed(angle: float) -> Turn:
    return 0.0, 0.0, math.sin(0.5 * angle), math.cos(0.5 * angle)


def write_bag(
    folder: Path, kind: str, said: Iterable[Said], name: str = "drive", whole_files_compressed: bool = False
) -> Path:
    """Write messages in their order into a bag of a kind; its path as a user would give it."""
    speaker = Speaker(kind)
    path = folder / (f"{name}.bag" if kind == "rosbag1" else name)
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    writer = Rosbag1(path) if kind == "rosbag1" else Rosbag2(path, version=9, storage_plugin=plugin)
    if whole_files_compressed and isinstance(writer, Rosbag2):
        writer.set_compression(CompressionMode.FILE, CompressionFormat.ZSTD)
    with writer as bag:
        connections: dict[str, Any] = {}
        for one in said:
            if one.topic not in connections:
                connections[one.topic] = bag.add_connection(one.topic, one.kind, typestore=speaker.store)
            bag.write(connections[one.topic], round(one.t * 1e9), speaker.encoded(one))
    return path
