"""How rmw_zenoh puts ROS 2 on Zenoh: keys, liveliness tokens, attachments, and messages as CDR.

Its form is described in the design document of ros2/rmw_zenoh; definitions and hashes of types are those of `rosbags`.
"""

import struct
from functools import cache
from typing import Any, NamedTuple

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from protocol.errors import ProtocolError

ADMIN = "@ros2_lv"
NODE, PUBLISHER, SUBSCRIBER = "NN", "MP", "MS"
_ATTACHED = struct.Struct("<qqB16s")
_GID_BYTES = 16

SCAN, ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
TWIST, TWIST_STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
GRID, MARKERS = "nav_msgs/msg/OccupancyGrid", "visualization_msgs/msg/MarkerArray"
TRANSFORMS, DIAGNOSTICS = "tf2_msgs/msg/TFMessage", "diagnostic_msgs/msg/DiagnosticArray"
POSE, HELD = "geometry_msgs/msg/PoseStamped", "std_msgs/msg/Bool"


@cache
def types() -> Typestore:
    """The messages of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


@cache
def type_hash(kind: str) -> str:
    """Hash of a type such as SCAN, by which two sides know that they mean the same (REP 2016)."""
    return types().hash_rihs01(kind)


def to_bytes(kind: str, message: Any) -> bytes:
    """A message as CDR."""
    return bytes(types().serialize_cdr(message, kind))


def from_bytes(kind: str, data: bytes) -> Any:
    """The message of CDR. Raises ProtocolError on anything else."""
    try:
        return types().deserialize_cdr(data, kind)
    except Exception as error:  # the library checks little of bytes that are no message
        raise ProtocolError(f"no {kind}: {' '.join(str(error).split()) or type(error).__name__}") from None


class Quality(NamedTuple):
    """What a publisher or a subscriber promises (QoS)."""

    reliable: bool = True
    latched: bool = False  # who comes later gets the last message
    depth: int = 10

    def __str__(self) -> str:
        """As in a token: what is usual is left out."""
        return f"{'' if self.reliable else '2'}:{'1' if self.latched else ''}:,{self.depth}:,:,:,,"


class Endpoint(NamedTuple):
    """One topic of one type, in the words of Zenoh."""

    domain: int
    topic: str  # with its namespace, such as /r1/scan
    kind: str  # such as SCAN

    @property
    def key(self) -> str:
        """Where its messages travel."""
        return f"{self.domain}{self.topic}/{self.mangled_kind}/{type_hash(self.kind)}"

    @property
    def mangled_kind(self) -> str:
        """The type's name in C++."""
        package, _, name = self.kind.split("/")
        return f"{package}::msg::dds_::{name}_"

    @property
    def words(self) -> str:
        """Its part of a token."""
        return f"{mangled(self.topic)}/{self.mangled_kind}/{type_hash(self.kind)}"


def mangled(name: str) -> str:
    """A name with slashes as one part of a key."""
    return name.replace("/", "%")


def joined(namespace: str, topic: str) -> str:
    """A topic within a namespace (/ for none); one that begins with a slash stands for itself."""
    return topic if topic.startswith("/") else f"{namespace.rstrip('/')}/{topic}"


def token(domain: int, session: str, number: int, what: str, namespace: str, name: str, rest: str = "") -> str:
    """Liveliness token of a node, whose number is 0, or of an endpoint of it; rest: words and quality of that."""
    return f"{ADMIN}/{domain}/{session}/0/{number}/{what}/%/{mangled(namespace)}/{name}{rest and f'/{rest}'}"


def tokens_of(domain: int, what: str, topic: str) -> str:
    """Key expression of the tokens of all subscribers, or all publishers, of a topic."""
    return f"{ADMIN}/{domain}/*/*/*/{what}/*/*/*/{mangled(topic)}/**"


def kind_in(told: str) -> str:
    """Type in the token of an endpoint, such as TWIST; the empty string where there is none."""
    parts = told.split("/")
    package, _, name = parts[10].partition("::msg::dds_::") if len(parts) > 10 else ("", "", "")
    return f"{package}/msg/{name.removesuffix('_')}" if name else ""


def attachment(sequence: int, time_ns: int, gid: bytes) -> bytes:
    """What goes with each message, 33 bytes: its number from 1, when it was sent, and who sent it (16 bytes)."""
    return _ATTACHED.pack(sequence, time_ns, _GID_BYTES, gid)


def sender(attached: bytes) -> bytes:
    """Who sent a message. Raises ProtocolError for an attachment that is none."""
    if len(attached) != _ATTACHED.size or attached[16] != _GID_BYTES:
        raise ProtocolError("a message without rmw_zenoh's attachment")
    return attached[17:]
