"""Interior sweep: look at all free area from near enough to see the smallest object (paper IV-B; rule ours).

What was seen is kept as poses only. When asked, the free area is the face of the map's walls that the robot has
driven in; it is sampled as densely as the smallest object needs, and a sample is unseen if no kept pose within the
radius sees it past the walls. The samples are made anew for each question; nothing of them is kept.
"""

import math

import numpy as np
import shapely
from numpy.typing import NDArray

from agent.exploration.agenda import Task
from agent.exploration.frontiers import open_ends
from agent.exploration.planning import Roads
from agent.geometry.clearance import walls_near
from agent.geometry.visibility import hidden_by
from agent.kernels import kernel
from protocol.arrays import Bools, Floats
from protocol.messages import LidarSpec
from protocol.wireframe import Wireframe

OBJECT_BEAMS = 2.4
"""Beams that an object gets on average where it counts as seen: 0.1 m at 2.4 m.

Three beams make a wall; two of five scans then have three, and between two kept poses there are eleven scans. Every
scan has three at 1.9 m, for which maze-15 takes 589 s instead of 556 (medians of five starts).
"""
LATTICE_M = 0.6
"""Distance between standing points considered by the sweep: a quarter of its radius."""
LEAST_SAMPLES = 3
"""Unseen samples, one per square of the smallest object's width, that a standing point must show: fewer are a sliver
that hides no such object but for its edge."""
RANGE_SHARE = 0.95
"""Share of the lidar's range within which walls are counted as seen."""
_GAP_M = 3.0
"""Gaps up to this long between open ends are closed to tell the free face from the outside."""
_STOOD_M = 0.15
"""Standing points closer than this to a former one show nothing more."""


def sweep_radius(smallest_object_m: float, lidar: LidarSpec, beams: float = OBJECT_BEAMS) -> float:
    """Distance in metres at which the smallest object gets enough beams to be seen."""
    return min(smallest_object_m / (beams * 2.0 * math.pi / lidar.beams), RANGE_SHARE * lidar.range_max_m)


@kernel
def _in_view(points: Floats, eyes: Floats, walls: Floats, radius: float, beyond: float = 0.0) -> Bools:
    """Whether each of points (n, 2) is seen from any of eyes (k, 2) within the radius, past walls (m, 4).

    The points are in the order of y, as those of a lattice are. beyond: no point is seen from an eye so near to it,
    as the caller knows. Metres.
    """
    out = np.zeros(points.shape[0], np.bool_)
    for e in range(eyes.shape[0] - 1, -1, -1):
        x, y = eyes[e]
        near = walls_near(walls, x, y, radius)
        first, last = np.searchsorted(points[:, 1], np.array([y - radius, y + radius]))
        last_hid = near[:0]  # what hid one point hides most of its neighbours
        for i in range(first, last):
            px, py = points[i]
            away2 = (px - x) ** 2 + (py - y) ** 2
            if out[i] or away2 > radius * radius or 0.0 < away2 <= beyond * beyond:
                continue
            if hidden_by(x, y, px, py, last_hid) >= 0:
                continue
            k = hidden_by(x, y, px, py, near)
            if k < 0:
                out[i] = True
            else:
                last_hid = near[k : k + 1]
    return out


@kernel
def _views(points: Floats, eyes: Floats, walls: Floats, radius: float) -> Bools:
    """Matrix (k, n): which of points (n, 2) is seen from which of eyes (k, 2)."""
    out = np.empty((eyes.shape[0], points.shape[0]), np.bool_)
    for e in range(eyes.shape[0]):
        out[e] = _in_view(points, eyes[e : e + 1], walls, radius)
    return out


@kernel
def _cover(views: Bools, least: int, keep: bool) -> NDArray[np.int64]:
    """Rows that together cover what the matrix covers, the one that adds most first, while it adds the least.

    keep: row 0 comes before all others if it shows the least.
    """
    left = np.ones(views.shape[1], np.bool_)
    chosen = np.empty(views.shape[0], np.int64)
    for k in range(views.shape[0]):
        best, which = 0, -1
        for e in range(views.shape[0]):
            gain = 0
            for i in range(views.shape[1]):
                if left[i] and views[e, i]:
                    gain += 1
            if gain > best:
                best, which = gain, e
            if keep and k == 0 and best >= least:
                break
        if which < 0 or best < least:
            return chosen[:k]
        chosen[k] = which
        for i in range(views.shape[1]):
            if views[which, i]:
                left[i] = False
    return chosen


def lattice(x0: float, y0: float, x1: float, y1: float, step: float) -> Floats:
    """Points (n, 2) of a square lattice through the origin inside a box, in the order of y; metres."""
    xs = np.arange(math.ceil(x0 / step), math.floor(x1 / step) + 1) * step
    ys = np.arange(math.ceil(y0 / step), math.floor(y1 / step) + 1) * step
    return np.stack(np.meshgrid(xs, ys), -1).reshape(-1, 2)


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
            shapely.linestrings([ends.points[i], ends.points[j]]) for i, j in enumerate(other) if d[i, j] < _GAP_M
        ]
    faces = shapely.get_parts(shapely.polygonize([shapely.union_all(lines)]))
    held = faces[shapely.intersects(faces, shapely.multipoints(poses))] if len(faces) else faces
    if not len(held):
        return shapely.box(*shapely.total_bounds(walls))
    return shapely.union_all(held)


class Sweep:
    """What of the free area is unseen, and from where it would be seen."""

    def __init__(self, smallest_object_m: float, lidar: LidarSpec, object_beams: float = OBJECT_BEAMS) -> None:
        self.sample_m = smallest_object_m
        self.radius = sweep_radius(smallest_object_m, lidar, object_beams)
        self.range = RANGE_SHARE * lidar.range_max_m
        self._stood: list[tuple[float, float]] = []

    def unseen(self, wireframe: Wireframe, eyes: Floats) -> Floats:
        """Samples (n, 2) of the free area that no eye (k, 2) has seen from within the radius."""
        face = free_face(wireframe, eyes)
        x0, y0, x1, y1 = shapely.bounds(face)
        points = lattice(x0, y0, x1, y1, self.sample_m)
        shapely.prepare(face)
        points = points[shapely.contains_xy(face, points[:, 0], points[:, 1])]
        seen = _in_view(points, eyes, wireframe.segments(), self.radius)
        return np.asarray(points[~seen], np.float64)

    def passed_by(self, wireframe: Wireframe, eyes: Floats, here: Floats, reach_m: float) -> Floats:
        """Samples (n, 2) around here (2,) that eyes (k, 2) have seen, but from too far; asks for no closed walls."""
        x, y = here
        points = lattice(x - reach_m, y - reach_m, x + reach_m, y + reach_m, self.sample_m)
        around = eyes[(np.abs(eyes - here) < reach_m + self.range).all(1)]
        walls = wireframe.segments()
        points = points[~_in_view(points, around, walls, self.radius)]
        in_range: Floats = points[_in_view(points, around, walls, self.range, self.radius)]
        return in_range

    def left(self, samples: Floats, eye: Floats, walls: Floats) -> tuple[Floats, bool]:
        """Samples (n, 2) that the eye (2,) does not see from within the radius, and whether they are too few to count.

        walls (m, 4): what hides them.
        """
        left = samples[~np.asarray(_in_view(samples, eye[None], walls, self.radius))]
        return left, len(left) < LEAST_SAMPLES

    def stood(self, stand: Floats) -> None:
        """Ask no more to stand at (2,) stand."""
        self._stood.append((float(stand[0]), float(stand[1])))

    def tasks(self, unseen: Floats, roads: Roads, begun: Floats | None = None) -> list[Task]:
        """Standing points that together show the unseen samples (n, 2), those that show most first.

        begun: (2,) the standing point that the robot is on its way to, which is kept while it shows anything.
        """
        if not len(unseen):
            return []
        low, high = unseen.min(0) - self.radius, unseen.max(0) + self.radius
        points = lattice(low[0], low[1], high[0], high[1], LATTICE_M)
        points = points[roads.standable(points)]
        for x, y in self._stood:  # never twice, so that the sweep ends whatever the map does
            points = points[np.hypot(points[:, 0] - x, points[:, 1] - y) > _STOOD_M]
        if begun is not None:
            points = np.vstack((begun, points))
        points = points[roads.reached(points)]
        if not len(points):
            return []
        views = _views(unseen, points, roads.walls, self.radius)
        kept = begun is not None and bool((points[0] == begun).all())
        return [
            Task("sweep", points[k], points[k], samples=unseen[views[k]], begun=bool(kept and k == 0))
            for k in _cover(views, LEAST_SAMPLES, kept)
        ]
