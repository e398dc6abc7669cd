"""Interior sweep: look at all free area from near enough to see the smallest object (paper IV-B; rule ours).

What was seen is kept as viewpoints only. When asked, the free area is the face of the map's walls that the robot or
its teammates have driven in. It is sampled as densely as the smallest object needs; a sample is unseen if no viewpoint
within the radius sees it past the walls.
"""

import math

import numpy as np
import shapely

from agent.exploration.agenda import Task
from agent.exploration.driving import sees_m
from agent.exploration.frontiers import open_ends
from agent.exploration.lattice import Lattice, inside, lattice_between, marked, take_beside, take_seen
from agent.exploration.planning import Roads
from agent.geometry.clearance import walls_near
from agent.geometry.visibility import hidden_by
from agent.kernels import kernel
from protocol.arrays import Bools, Floats
from protocol.messages import LidarSpec
from protocol.wireframe import Wireframe

OBJECT_BEAMS = 2.0
"""Beams that an object gets on average where it counts as seen: 0.1 m at 2.9 m. What shows one or two beams is found
over many views (`agent/mapping/poles.py`).

Of 40 posts of 0.1 m in eight halls of 11 m x 10 m, 2.4, 2.0 and 1.7 beams miss 0, 0 and 2. In 31 runs in eight layouts
99 % of the wall is seen after 10,713, 9,724 and 9,035 s, and all is complete after 13,040, 11,459 and 12,185 s."""
EDGE_BEAMS = 0.4
"""So many more where a beam at an edge may measure something between what is before and behind it, as an object has
two edges. Of faces of posts of 10 and 13 cm in three rooms with all of `deploy/sensing.py`, REAL, 0.80 are mapped with
2.4 beams and 0.57 with 1.7."""
LATTICE_M = 0.6  # distance between standing points considered by the sweep: a quarter of its radius
LATTICE_SHARE = 0.7  # ... at most so much of it: where it is short, there may be no such point within it
LEAST_SAMPLES = 3  # unseen samples, squares as wide as the smallest object, that a stand must show: fewer are a sliver
RANGE_SHARE = 0.95  # share of the lidar's range within which walls are counted as seen
_GAP_M = 3.0  # gaps up to this long between open ends are closed to tell the free face from the outside
_STOOD_M = 0.15  # standing points nearer than this to a former one show nothing more
SPACING_M = 0.5
"""Distance between viewpoints. With a radius of 2.4 m, a corridor of 1.9 m to either side has gaps from 2.9 m on."""
MOST_SAMPLES = 20_000
"""Unseen samples, 200 m2, for which standing points are looked for at a time, the nearest: which point shows which is a
table of 50 to 100 MB then, and more where a lidar sees less than 0.3 m. In a hall of 80 m a side all half a million of
them would take 8 GB."""
MOST_VIEWS = 400_000_000
"""Bytes of that table at most, those of a maze of 80 m: where samples lie scattered, of standing points beside any the
nearest."""
MOST_AWAY_M = 150.0
"""Metres by which those of the free area go at most beyond where the robot itself has been. The largest mazes
measure 141 m across. A merged peer that lies may tell of four walls around square kilometres."""
MOST_KEPT = 3000  # most own viewpoints kept (24 bytes each), 1.5 km of path; then every second one is forgotten
MOST_SLIVERS = 2 * MOST_KEPT  # most samples kept that sweeps have left, two of each at most; the oldest are forgotten


class Viewpoints:
    """From where was looked: the robot's own places so far, and those of teammates whose maps are merged."""

    def __init__(self) -> None:
        self.own: list[tuple[float, float]] = []  # metres, frame of the map
        self.ticks: list[int] = []  # when the robot was there
        self.teammates = np.zeros((0, 2))  # (k, 2) those of teammates

    @property
    def nbytes(self) -> int:
        """Bytes of what is kept."""
        return 24 * len(self.own) + self.teammates.nbytes

    def keep(self, tick: int, here: Floats, spacing_m: float = SPACING_M) -> bool:
        """Keep the present place (2,) if it is so far from the last one; true if kept."""
        x, y = here.tolist()
        if self.own and math.hypot(self.own[-1][0] - x, self.own[-1][1] - y) < spacing_m:
            return False
        self.own.append((x, y))
        self.ticks.append(tick)
        if len(self.own) > MOST_KEPT:
            del self.own[1::2], self.ticks[1::2]
        return True

    def own_places(self) -> Floats:
        """(k, 2) the robot's own."""
        return np.array(self.own).reshape(-1, 2)

    def all(self) -> Floats:
        """(k, 2) own ones and teammates'."""
        return np.vstack((self.own_places(), self.teammates))


@kernel
def _views(points: Floats, eyes: Floats, walls: Floats, radius: float) -> Bools:
    """Matrix (k, n): which of points (n, 2), in the order of y, is seen from which of eyes (k, 2) past walls (m, 4)."""
    views = np.zeros((eyes.shape[0], points.shape[0]), np.bool_)
    for e in range(eyes.shape[0]):
        x, y = eyes[e]
        near, asked = walls[:0], False
        first, last = np.searchsorted(points[:, 1], np.array([y - radius, y + radius]))
        hid = -1  # what hid one point hides most of its neighbours
        for i in range(first, last):
            px, py = points[i]
            if (px - x) ** 2 + (py - y) ** 2 > radius * radius:
                continue
            if not asked:
                near, asked = walls_near(walls, x, y, radius), True
            if hid < 0 or hidden_by(x, y, px, py, near[hid : hid + 1]) < 0:
                k = hidden_by(x, y, px, py, near)
                views[e, i] = k < 0
                hid = k if k >= 0 else hid
    return views


def _cover(views: Bools, keep: bool) -> list[int]:
    """Rows of views (k, n) that together show most columns, each the one that adds most, while it adds LEAST_SAMPLES.

    keep: the first row that shows so many is taken first.
    """
    gains, left, chosen = views.sum(1), np.ones(views.shape[1], np.bool_), list[int]()
    while True:
        best = int((gains >= LEAST_SAMPLES).argmax() if keep and not chosen else gains.argmax())
        if gains[best] < LEAST_SAMPLES:
            return chosen
        chosen.append(best)
        new = left & views[best]
        gains -= views[:, new].sum(1)
        left &= ~new


def _nearest(points: Floats, here: Floats, most: int) -> Floats:
    """Those of points (n, 2) that are nearest to here (2,), so many at most, in their order."""
    if len(points) <= most:
        return points
    away = np.hypot(*(points - here).T)
    return points[np.sort(np.argsort(away, kind="stable")[:most])]


def _beside(points: Floats, samples: Floats, radius: float) -> Bools:
    """Which of points (n, 2) have samples (m, 2) nearby: all within a radius, and none beyond three of them."""
    low = np.minimum(points.min(0), samples.min(0)) - radius
    cells, held = ((points - low) / radius).astype(np.int64), ((samples - low) / radius).astype(np.int64)
    taken = np.zeros(np.maximum(cells.max(0), held.max(0)) + 2, np.bool_)
    for dx, dy in np.ndindex(3, 3):
        taken[held[:, 0] + dx - 1, held[:, 1] + dy - 1] = True
    return np.asarray(taken[cells[:, 0], cells[:, 1]])


def free_face(wireframe: Wireframe, poses: Floats, reach_m: float) -> shapely.Geometry:
    """The faces of the map's walls that hold any of poses (k, 2).

    If none does, the walls are objects in a larger room: their bounding box, and what is within reach around it.
    """
    walls = shapely.linestrings(wireframe.segments().reshape(-1, 2, 2))
    points = open_ends(wireframe).points
    lines = list(walls)
    if len(points) > 1:
        d = np.hypot(*(points[:, None] - points[None, :]).transpose(2, 0, 1))
        np.fill_diagonal(d, np.inf)
        lines += [shapely.linestrings([points[i], points[j]]) for i, j in enumerate(d.argmin(1)) if d[i, j] < _GAP_M]
    faces = shapely.get_parts(shapely.polygonize([shapely.union_all(lines)]))
    shapely.prepare(faces)
    held = faces[shapely.intersects(faces, shapely.multipoints(poses))] if len(faces) else faces
    return shapely.union_all(held) if len(held) else shapely.box(*shapely.total_bounds(walls)).buffer(reach_m)


class Sweep:
    """What of the free area is unseen, and from where it would be seen."""

    def __init__(self, smallest_object_m: float, lidar: LidarSpec) -> None:
        self.sample_m = smallest_object_m
        self.range = RANGE_SHARE * lidar.range_max_m
        beam, beams = lidar.beam_step, OBJECT_BEAMS + EDGE_BEAMS * (lidar.mixed > 0)
        around = max(RANGE_SHARE * sees_m(lidar), min(self.range, smallest_object_m))  # it may see nothing on one side
        self.radius = min(smallest_object_m / (beams * beam), around)
        """Distance in metres at which the smallest object gets enough beams to be seen."""
        self._stood: list[tuple[float, float]] = []
        self._slivers = np.zeros((0, 2))
        """(s, 2) samples that sweeps have left, as too few to go for. A wall that moved by 5 mm had one more before it,
        and a robot drove the same 20 m again (maze of 20 m, seed 41 of `bench exploration`)."""

    @property
    def nbytes(self) -> int:
        """Bytes of what is kept."""
        return 16 * len(self._stood) + self._slivers.nbytes

    def unseen(self, wireframe: Wireframe, viewpoints: Viewpoints) -> Floats:
        """Samples (n, 2) of the free area that nobody has seen from within the radius."""
        face = free_face(wireframe, viewpoints.all(), self.range)
        bounds, own = shapely.bounds(face), viewpoints.own_places()
        been = np.vstack((own, np.zeros(2)))
        low, high = np.maximum(bounds[:2], been.min(0) - MOST_AWAY_M), np.minimum(bounds[2:], been.max(0) + MOST_AWAY_M)
        lattice = lattice_between(low, high, self.sample_m)
        left = inside(lattice, face)
        self._take_swept(left, lattice, own, viewpoints.teammates, wireframe.segments())
        return lattice.points(left)

    def passed_by(self, wireframe: Wireframe, viewpoints: Viewpoints, here: Floats, reach_m: float) -> Floats:
        """Samples (n, 2) around here (2,) that somebody has seen, but from too far; asks for no closed walls."""
        lattice = lattice_between(here - reach_m, here + reach_m, self.sample_m)
        left = np.ones((len(lattice.ys), len(lattice.xs)), np.bool_)
        own, teammates = (
            eyes[(np.abs(eyes - here) < reach_m + self.range).all(1)]
            for eyes in (viewpoints.own_places(), viewpoints.teammates)
        )
        walls = wireframe.segments()
        self._take_swept(left, lattice, own, teammates, walls)
        never = left.copy()
        take_seen(never, lattice, np.vstack((own, teammates)), walls, self.range, self.radius)
        return lattice.points(left & ~never)

    def _take_swept(self, left: Bools, lattice: Lattice, own: Floats, teammates: Floats, walls: Floats) -> None:
        """Take out of `left` (r, c) the samples at which nothing is to be looked for.

        Those are what own eyes (k, 2) or teammates' have seen from near enough, where no middle of the smallest object
        can be, as a wall (m, 4) is too near, and what sweeps have left.

        A teammate has left what was a sliver on its own lattice. On another one the sliver may have more samples, and
        a crowd whose map was whole went to look at such corners for 400 s. So its eyes count for one sample more.
        """
        left[lattice.places(self._slivers)] = False
        take_beside(left, lattice, walls, 0.5 * self.sample_m)
        take_seen(left, lattice, own, walls, self.radius, 0.0)
        take_seen(left, lattice, teammates, walls, self.radius + self.sample_m, 0.0)

    def left(self, samples: Floats, own: Floats, teammates: Floats, walls: Floats) -> tuple[Floats, bool]:
        """What is left of samples (n, 2), metres, and whether that is too little to go for.

        own, teammates (k, 2): from where they were seen. walls: (m, 4).
        """
        lattice, left = marked(samples, self.sample_m)
        self._take_swept(left, lattice, own, teammates, walls)
        samples = lattice.points(left)
        return samples, len(samples) < LEAST_SAMPLES

    def leave(self, samples: Floats) -> None:
        """Go no more for samples (n, 2): so few were left when a sweep ended."""
        lattice, more = marked(samples, self.sample_m)
        more[lattice.places(self._slivers)] = False
        self._slivers = np.vstack((self._slivers, lattice.points(more)))[-MOST_SLIVERS:]

    def stood(self, stand: Floats) -> None:
        """Ask no more to stand at (2,) stand."""
        self._stood.append((float(stand[0]), float(stand[1])))

    def tasks(self, unseen: Floats, roads: Roads, begun: Floats | None = None) -> list[Task]:
        """Standing points that together show the unseen samples (n, 2), those that show most first.

        Of very many samples the nearest count. begun: (2,) the standing point that the robot is on its way to, which is
        kept while it shows anything.
        """
        if not len(unseen):
            return []
        unseen = _nearest(unseen, roads.origin.point, MOST_SAMPLES)
        apart_m = min(LATTICE_M, LATTICE_SHARE * self.radius)
        lattice = lattice_between(unseen.min(0) - self.radius, unseen.max(0) + self.radius, apart_m)
        points = lattice.points(np.ones((len(lattice.ys), len(lattice.xs)), np.bool_))
        points, most = points[roads.standable(points)], MOST_VIEWS // len(unseen)
        if len(points) > most:
            points = _nearest(points[_beside(points, unseen, self.radius)], roads.origin.point, most)
        for x, y in self._stood:  # never twice, so that the sweep ends whatever the map does
            points = points[np.hypot(points[:, 0] - x, points[:, 1] - y) > _STOOD_M]
        if begun is not None:
            points = np.vstack((begun, points))
        views = np.asarray(_views(unseen, points, roads.walls, self.radius))
        shows = views.sum(1) >= LEAST_SAMPLES
        shows[shows] = roads.reached(points[shows])
        points, views = points[shows], views[shows]
        if not len(points):
            return []
        kept = begun is not None and bool((points[0] == begun).all())
        return [
            Task("sweep", points[k], points[k], samples=unseen[views[k]], begun=kept and k == 0)
            for k in _cover(views, kept)
        ]
