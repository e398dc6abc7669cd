"""Interior sweep: look at all free area from near enough to see the smallest object (paper IV-B; rule ours).

What was seen is kept as poses only. When no frontier is left, the free area is the face of the map's walls that the
robot has driven in, and what is still unseen is that face without what the kept poses see, given the walls.
"""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import NDArray

from agent.exploration_config import ExplorationConfig
from agent.goals import open_ends
from agent.planning import Roads
from agent.visibility import visible_ring
from protocol.messages import LidarSpec
from protocol.wireframe import Wireframe

Floats = NDArray[np.float64]

_RAYS = 60
"""Rays of a visibility polygon besides those at wall ends; its rim is then within 3 mm of the circle's at 1.9 m."""
_GAP_M = 3.0
"""Gaps up to this long between open ends are closed to tell the free face from the outside."""

_STOOD_M = 0.15
"""Standing points closer than this to a former one show nothing more."""


def sweep_radius(config: ExplorationConfig, lidar: LidarSpec) -> float:
    """Distance in metres at which the smallest object gets enough beams to be seen."""
    return min(
        config.smallest_object_m / (config.object_beams * 2.0 * math.pi / lidar.beams),
        0.95 * lidar.range_max_m,
    )


def seen_from(x: float, y: float, walls: Floats, radius_m: float) -> shapely.Geometry:
    """Area seen from a point within the radius; walls (m, 4)."""
    area = shapely.make_valid(shapely.polygons(visible_ring(x, y, walls, radius_m, _RAYS)))
    return shapely.union_all([part for part in shapely.get_parts(area) if part.geom_type == "Polygon"])


def free_face(wireframe: Wireframe, poses: Floats) -> shapely.Geometry:
    """The faces of the map's walls that hold any of poses (k, 2); the walls' bounding box if none does."""
    walls = shapely.linestrings(wireframe.segments().reshape(-1, 2, 2))
    ends = open_ends(wireframe)
    lines = list(walls)
    if len(ends.points) > 1:
        d = np.hypot(*(ends.points[:, None] - ends.points[None, :]).transpose(2, 0, 1))
        np.fill_diagonal(d, np.inf)
        other = d.argmin(1)
        lines += [
            shapely.linestrings([ends.points[i], ends.points[j]])
            for i, j in enumerate(other)
            if d[i, j] < _GAP_M
        ]
    faces = shapely.get_parts(shapely.polygonize([shapely.union_all(lines)]))
    places = shapely.multipoints(poses)
    held = faces[shapely.intersects(faces, places)] if len(faces) else faces
    if not len(held):
        return shapely.box(*shapely.total_bounds(walls))
    return shapely.union_all(held)


class Sweep:
    """What of the free area is unseen, and where to stand next."""

    def __init__(self, config: ExplorationConfig, lidar: LidarSpec) -> None:
        self.config = config
        self.radius = sweep_radius(config, lidar)
        self.unseen: shapely.Geometry = shapely.Polygon()
        self._given_up: list[shapely.Geometry] = []
        self._stood: list[tuple[float, float]] = []
        self._version = -1
        self._counted = 0

    def update(self, wireframe: Wireframe, version: int, poses: Floats) -> None:
        """Work out the unseen area for kept poses (k, 2): anew if the map changed, else only the new poses."""
        walls = wireframe.segments()
        if version != self._version:
            face = free_face(wireframe, poses)
            seen = [seen_from(x, y, walls, self.radius) for x, y in poses]
            self.unseen = shapely.difference(face, shapely.union_all(seen + self._given_up))
        else:
            for x, y in poses[self._counted :]:
                self.unseen = shapely.difference(self.unseen, seen_from(x, y, walls, self.radius))
        self._version, self._counted = version, len(poses)
        # an object of the smallest size is wholly hidden only where a disc of half its width fits
        half = 0.5 * self.config.smallest_object_m
        parts = [p for p in shapely.get_parts(self.unseen) if p.geom_type == "Polygon"]
        self.unseen = shapely.MultiPolygon([p for p in parts if not shapely.is_empty(shapely.buffer(p, -half))])

    def give_up(self, x: float, y: float, walls: Floats) -> None:
        """Ask no more for what is unseen though the robot stood at (x, y)."""
        self._stood.append((x, y))
        area = shapely.intersection(shapely.buffer(seen_from(x, y, walls, self.radius), 0.05), self.unseen)
        self._given_up.append(area)
        self.unseen = shapely.difference(self.unseen, area)

    def best_stand(self, roads: Roads) -> tuple[Floats, Floats] | None:
        """Standing point (2,) that shows most area for its way, and the path (k, 2); None if nothing is left."""
        if shapely.is_empty(self.unseen):
            return None
        step = self.config.sweep_lattice_m
        x0, y0, x1, y1 = shapely.bounds(self.unseen) + np.array((-1, -1, 1, 1)) * self.radius
        xs = np.arange(math.floor(x0 / step), math.ceil(x1 / step) + 1) * step
        ys = np.arange(math.floor(y0 / step), math.ceil(y1 / step) + 1) * step
        lattice = np.stack(np.meshgrid(xs, ys), -1).reshape(-1, 2)
        inside = shapely.point_on_surface(shapely.get_parts(self.unseen))
        points = np.vstack((lattice, shapely.get_coordinates(inside)))
        points = points[roads.standable(points)]
        points = points[shapely.dwithin(shapely.points(points), self.unseen, self.radius)]
        if self._stood:  # never twice, so that the sweep ends whatever the map does
            stood = shapely.multipoints(np.array(self._stood))
            points = points[~shapely.dwithin(shapely.points(points), stood, _STOOD_M)]
        costs = roads.costs(points)
        order = np.argsort(costs, kind="stable")
        least = (0.5 * self.config.smallest_object_m) ** 2
        best, stand, found = 0.0, None, 0
        for k in order[np.isfinite(costs[order])]:
            area = shapely.area(shapely.intersection(seen_from(*points[k], roads.walls, self.radius), self.unseen))
            if area < least:
                continue
            score = area / (costs[k] + self.config.sweep_detour_m)
            if score > best:
                best, stand = score, points[k]
            found += 1
            if found >= self.config.sweep_candidates:
                break
        if stand is None:
            return None
        way = roads.nearest(stand[None], np.zeros(1))
        return None if way is None else (stand, way[2])
