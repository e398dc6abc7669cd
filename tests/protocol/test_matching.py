"""Publishers know whether anybody reads them: who joins waits for it, and telemetry stays at home without."""

import time

import numpy as np
import pytest

from agent.config import AgentConfig
from agent.shell.process import answer
from protocol import keys
from protocol.errors import Interrupted, LinkError
from protocol.messages import Observation, RobotSpec
from protocol.session import open_client, open_router, wait_for_matching
from tests.wanderer import Wanderer

JOIN_S = 20.0


class Noted:
    """A publisher that notes when something is put."""

    def __init__(self, publisher: object, put: list[str], name: str) -> None:
        self._publisher, self._put, self._name = publisher, put, name

    @property
    def matching_status(self) -> object:
        return self._publisher.matching_status  # type: ignore[attr-defined]

    def put(self, payload: bytes) -> None:
        self._put.append(self._name)


def test_who_waits_for_a_reader_waits_until_there_is_one() -> None:
    with open_router(insecure=True) as (world, endpoint), open_client(endpoint, JOIN_S) as robot:
        key = keys.from_robot("r1", keys.ACT)
        publisher = robot.declare_publisher(key)
        with pytest.raises(LinkError, match=f"nobody reads {key} within 0.2 s"):
            wait_for_matching([publisher], 0.2, lambda: False)
        with pytest.raises(Interrupted):
            wait_for_matching([publisher], JOIN_S, lambda: True)
        with world.declare_subscriber(key, lambda sample: None):
            wait_for_matching([publisher], JOIN_S, lambda: False)


def test_scans_and_poses_leave_a_robot_only_while_somebody_subscribes() -> None:
    with open_router(insecure=True) as (world, endpoint), open_client(endpoint, JOIN_S) as robot:
        put: list[str] = []
        keyed = {channel: keys.from_robot("r1", channel) for channel in keys.OUTPUTS}
        publishers = {channel: Noted(robot.declare_publisher(key), put, channel) for channel, key in keyed.items()}
        mind = Wanderer("r1", RobotSpec(), AgentConfig(), 0)
        ranges = np.full(RobotSpec().lidar.beams, np.inf, "<f4").tobytes()
        step = mind.step(Observation(tick=1, ranges=ranges, odometry=(0.0, 0.0, 0.0)), [])
        answer(publishers, step)  # type: ignore[arg-type]
        assert put == [keys.ACT]
        with world.declare_subscriber(keyed[keys.SCAN], lambda sample: None):
            end = time.monotonic() + JOIN_S
            while put[-2:] != [keys.SCAN, keys.ACT]:
                assert time.monotonic() < end
                answer(publishers, step)  # type: ignore[arg-type]
        assert keys.POSE not in put
