"""What a robot shows in ROS 2: its map as a grid and as lines, its frame in tf, and how it does.

The wireframe is the map. In the grid its walls are occupied, and what scans saw on this side of them is free.
"""

import math
from typing import Any

import numpy as np
import shapely

from agent.geometry.cells import CELL_M, MARGIN_CELLS, wall_cells
from agent.geometry.visibility import VIEW_RAYS, VIEW_STEP_M, visible_ring
from agent.perception.beams import ring_of
from agent.shell.ros2.wire import DIAGNOSTICS, GRID, MARKERS, ODOMETRY, SCAN, TRANSFORMS, types
from protocol.arrays import Floats, Ints
from protocol.geometry import Pose, wrapped
from protocol.messages import LidarSpec, Observation
from protocol.wireframe import Label, Wireframe

VIEW_TURN_RAD = math.radians(45)  # between two views from one place: not every lidar looks all round
REACH_M = 8.0  # of a view at most, where the lidar's range is longer: it is drawn in 8 ms among 300 walls
MAX_CELLS = 25_000_000  # of a grid: a square of 250 m
UNKNOWN, FREE, OCCUPIED = -1, 0, 100  # as in nav_msgs/msg/OccupancyGrid
LINE_M = 0.03  # as wide as walls are drawn, and half of an open end
OK, WARN = 0, 1  # levels of diagnostic_msgs/msg/DiagnosticStatus
LINES, POINTS = 5, 8  # kinds of visualization_msgs/msg/Marker


class SeenArea:
    """What scans along the robot's path saw to be free, as cells: up to what they met and to the walls known then.

    Walls alone will not do: before they are known, the view goes far beyond them. Nor will scans, which err.
    """

    def __init__(self, lidar: LidarSpec) -> None:
        self._lidar, self._reach_m = lidar, min(lidar.range_max_m, REACH_M)
        self._last: Pose = (math.inf, math.inf, 0.0)
        self.low = np.zeros(2, np.int64)
        """Column and row of the first cell, counted from the map's origin."""
        self.seen = np.zeros((1, 1), np.bool_)
        """(rows, columns)"""

    @property
    def high(self) -> Ints:
        """Column and row behind the last cell."""
        return self.low + self.seen.shape[::-1]

    def look(self, pose: Pose, observation: Observation, wireframe: Wireframe) -> bool:
        """Take what a scan sees from a pose in the map, if that is apart from the last; whether it did."""
        (x, y, theta), last = pose, self._last
        if math.hypot(x - last[0], y - last[1]) < VIEW_STEP_M and abs(wrapped(theta - last[2])) < VIEW_TURN_RAD:
            return False
        self._last = pose
        ring = visible_ring(x, y, wireframe.segments(), self._reach_m, VIEW_RAYS)
        low, high = (np.floor(edge / CELL_M).astype(np.int64) for edge in (ring.min(0), ring.max(0) + CELL_M))
        if not self._grow(np.minimum(self.low, low), np.maximum(self.high, high)):
            return False
        area = shapely.Polygon(ring).buffer(0)
        shapely.prepare(area)
        px, py = np.meshgrid(*(CELL_M * (np.arange(a, b) + 0.5) for a, b in zip(low, high, strict=True)))
        dx, dy = px - x, py - y
        seen = np.hypot(dx, dy) < self._free_m(observation, np.arctan2(dy, dx) - theta)
        seen[seen] = shapely.contains_xy(area, px[seen], py[seen])
        (left, bottom), (right, top) = (low - self.low).tolist(), (high - self.low).tolist()
        self.seen[bottom:top, left:right] |= seen
        return True

    def _free_m(self, observation: Observation, bearings: Floats) -> Floats:
        """How far, m, a scan sees from the robot at bearings (rows, columns), rad; 0 where nothing was measured."""
        poses = observation.poses()
        way = np.vstack((2 * poses[:1] - poses[1:2], poses))  # which began as it went on
        beams = ring_of(observation.scan(), self._lidar, way)
        reach_m = np.minimum(beams.distances, self._reach_m - beams.shift)
        reach_m[np.isnan(beams.ranges)] = 0.0
        return np.interp(bearings, beams.bearings, reach_m, period=2 * math.pi)

    def _grow(self, low: Ints, high: Ints) -> bool:
        """Have cells from `low` to before `high`, column and row; false where they would be too many."""
        if np.prod(high - low) > MAX_CELLS:
            return False
        (left, bottom), (right, top) = (self.low - low).tolist(), (high - self.high).tolist()
        if left or bottom or right or top:
            self.seen = np.pad(self.seen, ((bottom, top), (left, right)))
            self.low = low
        return True


def _make(kind: str, **fields: Any) -> Any:
    return types().types[kind](**fields)


def header(stamp_s: float, frame: str) -> Any:
    """std_msgs/Header."""
    sec, nanosec = divmod(round(stamp_s * 1e9), 10**9)
    return _make(
        "std_msgs/msg/Header", stamp=_make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec), frame_id=frame
    )


def _point(x: float, y: float) -> Any:
    return _make("geometry_msgs/msg/Point", x=x, y=y, z=0.0)


def turned(theta: float) -> Any:
    """geometry_msgs/Quaternion of a heading."""
    return _make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=float(np.sin(theta / 2)), w=float(np.cos(theta / 2)))


def grid_of(wireframe: Wireframe, seen: SeenArea, stamp_s: float, frame: str) -> Any | None:
    """nav_msgs/OccupancyGrid of a map; None where it is too large for one."""
    walls = wireframe.segments()
    low, high = seen.low, seen.high
    if len(walls):
        ends = np.floor(walls.reshape(-1, 2) / CELL_M).astype(np.int64)
        low, high = np.minimum(low, ends.min(0)), np.maximum(high, ends.max(0) + 1)
    low, high = low - MARGIN_CELLS, high + MARGIN_CELLS
    width, height = (int(size) for size in high - low)
    if width * height > MAX_CELLS:
        return None
    cells = np.full((height, width), UNKNOWN, np.int8)
    (left, bottom), (rows, columns) = (seen.low - low).tolist(), seen.seen.shape
    cells[bottom : bottom + rows, left : left + columns][seen.seen] = FREE
    x, y = (float(CELL_M * edge) for edge in low)
    column, row = wall_cells(walls, (x, y)).T
    cells[row, column] = OCCUPIED
    stamped = header(stamp_s, frame)
    place = _make("geometry_msgs/msg/Pose", position=_point(x, y), orientation=turned(0.0))
    info = _make(
        "nav_msgs/msg/MapMetaData",
        map_load_time=stamped.stamp,
        resolution=CELL_M,
        width=width,
        height=height,
        origin=place,
    )
    return _make(GRID, header=stamped, info=info, data=cells.reshape(-1))


def markers_of(wireframe: Wireframe, stamp_s: float, frame: str) -> Any:
    """visualization_msgs/MarkerArray of a map: own walls, those of peers, and open ends."""
    walls = wireframe.segments()
    ends = wireframe.points[wireframe.labels == Label.FRONTIER]
    stamped = header(stamp_s, frame)
    return _make(
        MARKERS,
        markers=[
            _marker("walls", LINES, walls[wireframe.own].reshape(-1, 2), (0.1, 0.3, 0.8), stamped),
            _marker("heard walls", LINES, walls[~wireframe.own].reshape(-1, 2), (0.8, 0.5, 0.1), stamped),
            _marker("open ends", POINTS, ends, (0.8, 0.1, 0.1), stamped),
        ],
    )


def _marker(name: str, kind: int, points: Floats, colour: tuple[float, float, float], stamped: Any) -> Any:
    red, green, blue = colour
    size = LINE_M if kind == LINES else 2 * LINE_M
    still = _make("builtin_interfaces/msg/Duration", sec=0, nanosec=0)
    no_picture = _make("sensor_msgs/msg/CompressedImage", header=header(0.0, ""), format="", data=np.zeros(0, np.uint8))
    return _make(
        "visualization_msgs/msg/Marker",
        header=stamped,
        ns=name,
        id=0,
        type=kind,
        action=0,
        pose=_make("geometry_msgs/msg/Pose", position=_point(0.0, 0.0), orientation=turned(0.0)),
        scale=_make("geometry_msgs/msg/Vector3", x=size, y=size, z=0.0),
        color=_make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=1.0),
        lifetime=still,
        frame_locked=False,
        points=[_point(x, y) for x, y in points.tolist()],
        colors=[],
        texture_resource="",
        texture=no_picture,
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=_make("visualization_msgs/msg/MeshFile", filename="", data=np.zeros(0, np.uint8)),
        mesh_use_embedded_materials=False,
    )


def transforms_of(places: list[tuple[str, str, Pose]], stamp_s: float) -> Any:
    """tf2_msgs/TFMessage: frames by parent, child and pose in the parent."""
    told = []
    for parent, child, (x, y, theta) in places:
        moved = _make("geometry_msgs/msg/Vector3", x=x, y=y, z=0.0)
        transform = _make("geometry_msgs/msg/Transform", translation=moved, rotation=turned(theta))
        stamped = header(stamp_s, parent)
        told.append(
            _make("geometry_msgs/msg/TransformStamped", header=stamped, child_frame_id=child, transform=transform)
        )
    return _make(TRANSFORMS, transforms=told)


def diagnostics_of(robot: str, level: int, sentence: str, figures: dict[str, object], stamp_s: float) -> Any:
    """diagnostic_msgs/DiagnosticArray with how a robot does."""
    values = [_make("diagnostic_msgs/msg/KeyValue", key=key, value=str(value)) for key, value in figures.items()]
    status = _make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=level,
        name=f"wireswarm: {robot}",
        message=sentence,
        hardware_id=robot,
        values=values,
    )
    return _make(DIAGNOSTICS, header=header(stamp_s, ""), status=[status])


def scan_of(lidar: LidarSpec, ranges: Floats, stamp_s: float, frame: str) -> Any:
    """sensor_msgs/LaserScan of ranges (beams,), m, whose last beam is taken at the stamp."""
    step = lidar.beam_step * (-1 if lidar.clockwise else 1)
    first, period_s = math.radians(lidar.first_beam_deg), 1 / lidar.rate_hz
    between_s = period_s * abs(step) / (2 * math.pi) if lidar.turning else 0.0
    return _make(
        SCAN,
        header=header(stamp_s - between_s * (lidar.beams - 1), frame),
        angle_min=first,
        angle_max=first + step * (lidar.beams - 1),
        angle_increment=step,
        time_increment=between_s,
        scan_time=period_s,
        range_min=lidar.range_min_m,
        range_max=lidar.range_max_m,
        ranges=ranges.astype(np.float32),
        intensities=np.zeros(0, np.float32),
    )


def odometry_of(pose: Pose, moved: Pose, took_s: float, stamp_s: float, frames: tuple[str, str]) -> Any:
    """nav_msgs/Odometry of a pose, and of the move to it in the robot's frame. frames: the odometry's, the robot's."""
    dx, dy, turn = (value / took_s for value in moved)
    speed = _make("geometry_msgs/msg/Vector3", x=dx, y=dy, z=0.0)
    around = _make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=turn)
    twist = _make("geometry_msgs/msg/Twist", linear=speed, angular=around)
    place = _make("geometry_msgs/msg/Pose", position=_point(pose[0], pose[1]), orientation=turned(pose[2]))
    unsure = np.zeros(36)
    return _make(
        ODOMETRY,
        header=header(stamp_s, frames[0]),
        child_frame_id=frames[1],
        pose=_make("geometry_msgs/msg/PoseWithCovariance", pose=place, covariance=unsure),
        twist=_make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unsure),
    )


def twist_of(speed_mps: float, turn_rps: float) -> Any:
    """geometry_msgs/Twist."""
    ahead = _make("geometry_msgs/msg/Vector3", x=speed_mps, y=0.0, z=0.0)
    around = _make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=turn_rps)
    return _make("geometry_msgs/msg/Twist", linear=ahead, angular=around)


def twist_stamped_of(speed_mps: float, turn_rps: float, stamp_s: float, frame: str) -> Any:
    """geometry_msgs/TwistStamped."""
    return _make("geometry_msgs/msg/TwistStamped", header=header(stamp_s, frame), twist=twist_of(speed_mps, turn_rps))
