"""What is free in the grid that a ROS 2 robot shows."""

import math

import numpy as np
import pytest

from agent.geometry.cells import CELL_M
from agent.shell.ros2.showing import SeenArea
from protocol.arrays import Floats
from protocol.geometry import pose_of
from protocol.messages import LidarSpec, Observation
from protocol.wireframe import Wireframe, certain
from world.lidar.lidar import Lidar

HALF_M = 1.5
CORNERS = HALF_M * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
ROOM = certain(CORNERS, np.array([(0, 1), (1, 2), (2, 3), (3, 0)]))
NOTHING = Wireframe()
STILL = np.zeros((6, 3))


def looked(area: SeenArea, lidar: LidarSpec, way: Floats, known: Wireframe = NOTHING, lost: slice = slice(0)) -> bool:
    """Look round in the room at the end of a way, the beams `lost` of which measure nothing."""
    (ranges,) = Lidar(ROOM.segments(), lidar).cast(way[:, None])
    ranges[lost] = math.nan
    x, y, theta = pose_of(way[-1])
    told = {"ranges": ranges.astype("<f4").tobytes(), "way": way[1:].astype("<f8").tobytes()}
    return area.look((x, y, theta), Observation(tick=0, odometry=(x, y, theta), **told), known)


def free(area: SeenArea) -> Floats:
    """(n, 2) middles of the free cells."""
    middles: Floats = CELL_M * (np.argwhere(area.seen)[:, ::-1] + area.low + 0.5)
    return middles


@pytest.mark.parametrize("turn", [0.0, 0.4], ids=["straight", "turning"])
def test_nothing_beyond_walls_is_free_though_they_are_mapped_later(turn: float) -> None:
    """The whole disc of the lidar's range was free for ever: 28 square metres around a room of nine."""
    lidar, steps = LidarSpec(mount_x_m=-0.03), np.linspace(0.0, 1.0, 6)[:, None]
    area = SeenArea(lidar)
    assert looked(area, lidar, steps * (0.05, 0.0, turn))
    assert looked(area, lidar, steps * (0.05, 0.0, turn) + (0.4, 0.0, 0.0), ROOM)
    cells = free(area)
    assert np.abs(cells).max() < HALF_M + CELL_M
    assert len(cells) * CELL_M**2 > 0.95 * (2 * HALF_M) ** 2


def test_a_known_wall_hides_what_is_behind_it_whatever_a_scan_errs() -> None:
    lidar = LidarSpec()
    area = SeenArea(lidar)
    wall = certain(np.array([(0.5, 2.0), (0.5, -2.0)]), np.array([(0, 1)]))
    assert looked(area, lidar, STILL, wall)
    assert free(area)[:, 0].max() < 0.5 + CELL_M


def test_where_nothing_was_measured_nothing_is_free() -> None:
    lidar = LidarSpec(turning=False)
    area = SeenArea(lidar)
    looked(area, lidar, STILL, lost=slice(80, 101))
    x, y = free(area).T
    assert not ((np.abs(x) < 0.1 * y) & (y > 0.1)).any() and ((np.abs(x) < -0.1 * y) & (y < -1.0)).any()


def test_a_lidar_that_looks_ahead_sees_all_round_where_it_turns() -> None:
    lidar = LidarSpec(field_of_view_deg=180.0, first_beam_deg=-90.0, beams=180, turning=False)
    area = SeenArea(lidar)
    drew = [looked(area, lidar, np.full((6, 3), (0.0, 0.0, math.radians(turned)))) for turned in (0, 10, 90, 180, 190)]
    assert drew == [True, False, True, True, False]
    assert len(free(area)) * CELL_M**2 > 0.95 * (2 * HALF_M) ** 2
