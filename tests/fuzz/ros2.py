"""What a ROS 2 robot says as a fuzz target: between good messages, one that is anything."""

from functools import cache

from agent.shell.ros2 import wire
from agent.shell.ros2.sensing import ALIKE, Sensing
from protocol.errors import ProtocolError
from protocol.messages import RobotSpec
from tests.agent.shell.ros2.messages import BEGIN_S, odometry, scan

KINDS = (wire.SCAN, wire.ODOMETRY)


def fuzz_one(data: bytes) -> None:
    """The first byte says whether it is a scan or odometry, and whether it comes before or after the good ones."""
    kind, first = KINDS[data[0] % 2 if data else 0], data[:1] > b"\x80"
    sensing = Sensing(RobotSpec(), False)
    heard = [(kind, data[1:])] * first + _good() + [(kind, data[1:])] * (not first) + _good(0.2)
    for told, payload in heard:
        try:
            message = wire.from_bytes(told, payload)
        except ProtocolError as error:
            assert "\n" not in str(error)
            continue
        (sensing.take_scan if told == wire.SCAN else sensing.wheels.take)(message)
        if (seen := sensing.due()) is not None:
            assert len(seen.observation.scan()) == sensing.spec.lidar.beams


@cache
def _good(late_s: float = 0.0) -> list[tuple[str, bytes]]:
    told = [(wire.ODOMETRY, odometry(BEGIN_S + late_s + 0.05 * k, (0.01 * k, 0.0, 0.0))) for k in range(4)]
    told += [(wire.SCAN, scan(BEGIN_S + late_s + 0.04 + 0.05 * k)) for k in range(ALIKE)]
    return [(kind, wire.to_bytes(kind, one)) for kind, one in told]


def seeds() -> list[bytes]:
    """A scan and odometry that make sense, before and after others."""
    return [bytes([KINDS.index(kind) + 0x82 * early]) + payload for kind, payload in _good(0.1) for early in (0, 1)]
