"""How good a map is, compared with the true world: walls, corners, repetitions. No input or output.

The definitions are those of the independent scorer that judges run directories. Benchmarks use these, so that they run
where the scorer is absent; a test compares the two.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from agent.geometry.transform import fit_on_points
from protocol.arrays import Floats
from protocol.geometry import Pose, apply
from protocol.walls import directions, lengths, points_along
from protocol.wireframe import Label, Wireframe
from world.coverage import visible_wall
from world.worldfile import World

NEAR_M = 0.05  # a wall is mapped, and a mapped wall is true, within this distance: half the thickness of a usual wall
ALIKE_DEG = 15.0  # walls whose directions differ by less are alike, and only such are compared; a corner turns by more
SAMPLE_M = 0.02  # distance between samples of a mapped wall
CELL_M = 0.10  # one sample counts per cell of this size and direction, so that repeating a wall gains nothing
FAR_M = 0.30  # a wall's distance counts in the root mean square up to this
CORNER_NEAR_M = 0.10  # a vertex this near to a true corner is that corner
CORNER_FLAT_M = 0.006  # an outline that bends by less is straight
CORNER_SEEN_M = 0.03  # a corner is visible where visible wall ends this near to it
_ALIKE_COS = math.cos(math.radians(ALIKE_DEG))


class Score(NamedTuple):
    """The score of one map; None where there is nothing to judge."""

    wall_recall: float  # share of the visible true wall with a mapped wall near it and alike
    wall_precision: float  # share of the mapped wall with a true wall near it and alike
    wall_rmse_m: float | None  # root mean square distance of the mapped wall to the nearest true one alike
    repeated: float  # mapped length over its distinct length; much over 1 means walls mapped several times
    corner_recall: float | None  # share of the visible true corners with a nominal vertex near
    corner_precision: float | None  # share of the nominal vertices with a true corner near
    corner_rmse_m: float | None  # root mean square distance over the pairs of corner_precision


class WallScore(NamedTuple):
    """The fields of Score about walls."""

    recall: float
    precision: float
    rmse_m: float | None
    repeated: float


@dataclass(frozen=True, eq=False)
class Truth:
    """The outline around one region of a world, and what of it a robot in it can see. World frame, metres."""

    outline: Floats  # (n, 4) x1, y1, x2, y2: the walls that bound the region's free space
    corners: Floats  # (c, 2) where the outline turns
    seen_points: Floats  # (p, 2) middles of the pieces of visible wall
    seen_directions: Floats  # (p, 2) their unit directions
    seen_lengths: Floats  # (p,) their lengths
    seen_corners: Floats  # (k, 2) corners at the end of visible wall


def truth_of(world: World, start: tuple[float, float], radius_m: float, reach_m: float) -> Truth:
    """Truth for a robot of this radius and range of lidar that starts at (x, y).

    Raises WorldFileError where the start is in a wall.
    """
    return _truth(world, world.region_index(*start, radius_m), radius_m, reach_m)


@lru_cache(maxsize=16)
def _truth(world: World, region: int, radius_m: float, reach_m: float) -> Truth:
    rings = world.outlines_around(world.regions(radius_m)[region])
    outline = np.vstack([np.zeros((0, 4)), *(np.hstack([ring[:-1], ring[1:]]) for ring in rings)])
    corners = np.vstack([np.zeros((0, 2)), *(_corners(ring) for ring in rings)])
    wall = visible_wall(world, region, radius_m, reach_m)
    ends, lengths = wall.ends[wall.visible], wall.lengths[wall.visible]
    seen = nearest_point(corners, ends.reshape(-1, 2)) < CORNER_SEEN_M
    middles = (ends[:, :2] + ends[:, 2:]) / 2
    return Truth(outline, corners, middles, directions(ends), lengths, corners[seen])


def _corners(ring: Floats) -> Floats:
    """(c, 2) where a closed ring turns; the tip of a thin wall is a corner, too."""
    straight = np.asarray(shapely.LinearRing(ring).simplify(CORNER_FLAT_M).coords)[:-1]
    along = np.roll(straight, -1, 0) - straight
    along /= np.hypot(along[:, 0], along[:, 1])[:, None]
    turned: NDArray[np.bool_] = (along * np.roll(along, 1, 0)).sum(1) < _ALIKE_COS
    return straight[turned]


def score(wireframe: Wireframe, frame: Pose, truth: Truth) -> Score:
    """Score of a map whose frame has this pose (x, y, theta) in the world."""
    points = apply(frame, wireframe.points)
    nominal = points[wireframe.labels == Label.NOMINAL]
    off = nearest_point(nominal, truth.corners)
    found = nearest_point(truth.seen_corners, nominal)
    return Score(
        *score_walls(points[wireframe.edges].reshape(-1, 4), truth),
        corner_recall=float((found < CORNER_NEAR_M).mean()) if len(found) else None,
        corner_precision=float((off < CORNER_NEAR_M).mean()) if len(off) else None,
        corner_rmse_m=_rms(off[off < CORNER_NEAR_M]),
    )


def score_walls(segments: Floats, truth: Truth) -> WallScore:
    """Score of walls (m, 4) x1, y1, x2, y2 in the world."""
    points, ways = _samples(segments)
    apart = len(_distinct(points, ways, SAMPLE_M)[0])
    repeated = float(lengths(segments).sum()) / SAMPLE_M / max(apart, 1) if len(points) else 1.0
    points, ways = _distinct(points, ways, CELL_M)
    to_truth = distance_to(points, ways, truth.outline)
    to_map = distance_to(truth.seen_points, truth.seen_directions, segments)
    return WallScore(
        recall=float(truth.seen_lengths[to_map < NEAR_M].sum() / max(truth.seen_lengths.sum(), 1e-9)),
        precision=float((to_truth < NEAR_M).mean()) if len(points) else 0.0,
        rmse_m=_rms(np.minimum(to_truth, FAR_M)),
        repeated=repeated,
    )


def corner_pairs(wireframe: Wireframe, frame: Pose, truth: Truth) -> tuple[Floats, Floats]:
    """Nominal vertices near to a true corner, and those corners, (n, 2) each in the world: `corner_precision`'s."""
    points = apply(frame, wireframe.points[wireframe.labels == Label.NOMINAL])
    points = points[nearest_point(points, truth.corners) < CORNER_NEAR_M]
    if not len(points):
        return points, points
    return points, truth.corners[np.linalg.norm(points[:, None] - truth.corners, axis=2).argmin(1)]


def corners_fitted(wireframe: Wireframe, frame: Pose, truth: Truth) -> float | None:
    """`corner_rmse_m` after the best rigid fit: what is wrong in the map itself, however it lies in its frame."""
    points, corners = corner_pairs(wireframe, frame, truth)
    if len(points) < 2:
        return None
    return _rms(np.hypot(*(apply(fit_on_points(points, corners, len(points)), points) - corners).T))


def _rms(distances: Floats) -> float | None:
    return float(np.sqrt((distances**2).mean())) if len(distances) else None


def _samples(segments: Floats) -> tuple[Floats, Floats]:
    """Points along walls and the unit direction at each, both (n, 2)."""
    segments = segments[lengths(segments) > 1e-9]
    points, wall = points_along(segments, np.maximum(1, np.round(lengths(segments) / SAMPLE_M)).astype(np.int64))
    return points, directions(segments)[wall]


def _distinct(points: Floats, ways: Floats, cell_m: float) -> tuple[Floats, Floats]:
    """One sample per cell and direction."""
    turn = np.arctan2(ways[:, 1], ways[:, 0]) % math.pi / math.radians(ALIKE_DEG)
    sector = np.round(turn).astype(int) % round(180.0 / ALIKE_DEG)
    cells = np.column_stack([np.floor(points / cell_m).astype(int), sector])
    _, first = np.unique(cells, axis=0, return_index=True)
    return points[first], ways[first]


def distance_to(points: Floats, ways: Floats, segments: Floats) -> Floats:
    """(n,) metres from each point to the nearest wall alike in direction; inf where there is none.

    points and unit directions `ways`: (n, 2); segments: (m, 4) x1, y1, x2, y2.
    """
    out = np.full(len(points), np.inf)
    segments = segments[lengths(segments) > 1e-9]
    length, unit = lengths(segments), directions(segments)
    for low in range(0, len(points), 2000):  # a block of points by all walls stays in the cache
        part = slice(low, low + 2000)
        offset = points[part, None] - segments[:, :2]
        t = np.clip((offset * unit).sum(2), 0, length)
        away = np.linalg.norm(offset - t[..., None] * unit, axis=2)
        alike = np.abs(ways[part] @ unit.T) > _ALIKE_COS
        out[part] = np.where(alike, away, np.inf).min(1, initial=np.inf)
    return out


def nearest_point(points: Floats, others: Floats) -> Floats:
    """(n,) distance of each point to the nearest of the others; inf without others."""
    return np.asarray(np.linalg.norm(points[:, None] - others[None], axis=2).min(1, initial=np.inf), np.float64)
