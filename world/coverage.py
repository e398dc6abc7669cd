"""How much of the visible wall the robots have hit with their beams."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon

from world.config import CoverageConfig
from world.worldfile import World, WorldFileError

_EYE_M = 2e-4
"""A piece of wall is looked at this far before its middle: in free space (as in the scorer)."""

_JOINT_M = 1e-6
"""A hit this near to a joint of two pieces counts for the second; more than rounding."""

_ROW_M = 1e4
"""Key of a place on the outline: segment times this plus metres along it; longer than any wall."""


@dataclass(frozen=True, eq=False)
class VisibleWall:
    """The outline around one region in pieces, and which of them a robot in it can see (contracts.md)."""

    ends: NDArray[np.float64]
    """(n, 4) x1, y1, x2, y2 of each piece."""
    lengths: NDArray[np.float64]
    """(n,) metres."""
    visible: NDArray[np.bool_]
    """(n,) seen within range, not too flat, from a place that the robot's centre can reach."""


@lru_cache(maxsize=16)
def visible_wall(world: World, region: int, radius_m: float, reach_m: float, config: CoverageConfig) -> VisibleWall:
    """Visible wall of the region of that index among `world.regions(radius_m)`; the scorer's definition."""
    reachable = world.regions(radius_m)[region]
    pieces = []
    for polygon in world.free:
        if not polygon.intersects(reachable):
            continue
        for ring in world.outline(polygon):
            for a, b in pairwise(ring):
                count = max(1, math.ceil(np.hypot(*(b - a)) / config.piece_m))
                cuts = a + np.linspace(0, 1, count + 1)[:, None] * (b - a)
                pieces.append(np.hstack([cuts[:-1], cuts[1:]]))
    ends = np.vstack(pieces) if pieces else np.zeros((0, 4))
    along = ends[:, 2:] - ends[:, :2]
    return VisibleWall(
        ends=ends,
        lengths=np.hypot(along[:, 0], along[:, 1]),
        visible=_visible(world, reachable, ends, reach_m, config),
    )


def _visible(
    world: World, reachable: Polygon, ends: NDArray[np.float64], reach_m: float, config: CoverageConfig
) -> NDArray[np.bool_]:
    """Which pieces some pose sees: each is tried from its nearest pose first, until one sees it."""
    poses = _poses(reachable, config.grid_m)
    along = ends[:, 2:] - ends[:, :2]
    length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-12)
    normal = np.stack([-along[:, 1], along[:, 0]], 1) / length[:, None]  # free space lies on the left
    eye = (ends[:, :2] + ends[:, 2:]) / 2 + _EYE_M * normal
    piece, pose = shapely.STRtree(shapely.points(poses)).query(
        shapely.points(eye), predicate="dwithin", distance=reach_m
    )
    view = poses[pose] - eye[piece]
    away = np.hypot(view[:, 0], view[:, 1])
    steep = (view * normal[piece]).sum(1) > math.sin(math.radians(config.grazing_deg)) * away
    piece, pose, away = piece[steep], pose[steep], away[steep]
    order = np.lexsort((away, piece))
    piece, pose = piece[order], pose[order]
    first = np.searchsorted(piece, np.arange(len(ends)))
    count = np.bincount(piece, minlength=len(ends))
    visible = np.zeros(len(ends), np.bool_)
    shapely.prepare(world.solid)
    for nth in range(int(count.max(initial=0))):
        hidden = np.flatnonzero(~visible & (count > nth))
        if not len(hidden):
            break
        sight = shapely.linestrings(np.stack([eye[hidden], poses[pose[first[hidden] + nth]]], 1))
        visible[hidden] = ~shapely.intersects(world.solid, sight)
    return visible


def _poses(reachable: Polygon, grid_m: float) -> NDArray[np.float64]:
    """A grid of places in a region, and its rim."""
    x0, y0, x1, y1 = reachable.bounds
    grid = np.meshgrid(np.arange(x0, x1 + grid_m, grid_m), np.arange(y0, y1 + grid_m, grid_m))
    spots = np.stack(grid, -1).reshape(-1, 2)
    spots = spots[shapely.contains_xy(reachable, spots[:, 0], spots[:, 1])]
    rings = (reachable.exterior, *reachable.interiors)
    rim = [shapely.line_interpolate_point(ring, np.arange(0, ring.length, grid_m)) for ring in rings]
    return np.vstack([spots, shapely.get_coordinates(np.concatenate(rim))])


class _Lookup(NamedTuple):
    """Pieces sorted by where they begin on the lidar's segments."""

    begins: NDArray[np.float64]
    walls: NDArray[np.intp]
    pieces: NDArray[np.intp]


class Coverage:
    """Which pieces of wall each robot has covered so far, and when that made 90 and 99 %.

    Covered is what its own beams have hit, or what a peer had covered when it sent a map that the robot has merged
    (contracts.md). The team's is the union of all own beams.
    """

    MILESTONES = (0.90, 0.99)

    def __init__(
        self,
        world: World,
        starts: NDArray[np.float64],
        radius_m: float,
        reach_m: float,
        config: CoverageConfig,
    ) -> None:
        """`starts` is (k, 3): robots that start in one region share its visible wall."""
        regions = world.regions(radius_m)
        homes = [_index_of(world, regions, x, y, radius_m) for x, y, _ in starts.tolist()]
        walls = {home: visible_wall(world, home, radius_m, reach_m, config) for home in sorted(set(homes))}
        blocks = dict(zip(walls, np.cumsum([0] + [len(w.ends) for w in walls.values()]), strict=False))
        ends = np.vstack([wall.ends for wall in walls.values()])
        lengths = np.concatenate([wall.lengths for wall in walls.values()])
        visible = np.concatenate([wall.visible for wall in walls.values()])
        self._weight = np.where(visible, lengths, 0.0)
        robots, pieces = len(starts), len(ends)
        self._total = np.array([walls[h].lengths[walls[h].visible].sum() for h in homes])
        self._team_total = float(self._weight.sum())
        self._hit = np.zeros((robots, pieces), np.bool_)
        """Hit by own beams."""
        self._since = np.full((robots, pieces), np.iinfo(np.int64).max)
        """Tick since which a piece has been covered."""
        self._hit_since = self._since.copy()
        """Tick of the first own beam."""
        self._merged: list[dict[int, int]] = [{} for _ in range(robots)]
        """For each robot: merged peers, and when their maps were so."""
        self._team_hit = np.zeros(pieces, np.bool_)
        self._length = np.zeros(robots)
        self._covered_length = np.zeros(robots)
        self._blocks = {home: (int(low), int(low) + len(walls[home].ends)) for home, low in blocks.items()}
        self._team_length = 0.0
        self._start = world.segments[:, :2]
        along = world.segments[:, 2:] - self._start
        self._unit = along / np.hypot(along[:, 0], along[:, 1])[:, None]
        self._origin = (self._start * self._unit).sum(1)
        self._lookups = {home: self._keys(world, walls[home].ends, blocks[home]) for home in walls}
        self._homes = np.array(homes)
        self.own = np.zeros(robots)
        """(k,) share of the visible wall of its region that own beams of each robot have hit."""
        self.covered = np.zeros(robots)
        """(k,) the same with what merged maps cover."""
        self.team = 0.0
        """Share of the visible wall of all robots' regions that any robot has hit."""
        self.reached: list[dict[float, float]] = [{} for _ in range(robots)]
        """For each robot: simulated seconds at which a milestone was reached."""
        self.team_reached: dict[float, float] = {}

    def _keys(self, world: World, ends: NDArray[np.float64], block: int) -> _Lookup:
        """Which piece a place on the lidar's segments belongs to."""
        middles = shapely.points((ends[:, :2] + ends[:, 2:]) / 2)
        tree = shapely.STRtree(shapely.linestrings(world.segments.reshape(-1, 2, 2)))
        piece, segment = tree.query_nearest(middles, all_matches=False)
        begin = ((ends[piece, :2] - self._start[segment]) * self._unit[segment]).sum(1)
        key = segment * _ROW_M + begin
        order = np.argsort(key, kind="stable")
        return _Lookup(key[order], segment[order], piece[order] + block)

    def merge(self, tick: int, robot: int, merged: Mapping[int, int]) -> None:
        """Take in whose maps a robot has merged, and at which tick each of these maps was so; all others are undone."""
        before = self._merged[robot]
        if merged == before:
            return
        if any(peer not in merged for peer in before):
            self._since[robot] = self._hit_since[robot]
        for peer, then in merged.items():
            known = self._since[peer] <= then
            self._since[robot, known] = np.minimum(self._since[robot, known], tick)
        self._merged[robot] = dict(merged)
        self._sum(robot)

    def _sum(self, robot: int) -> None:
        covered = self._since[robot] < np.iinfo(np.int64).max
        self._covered_length[robot] = self._weight[covered & self._in_home(robot)].sum()

    def _in_home(self, robot: int) -> NDArray[np.bool_]:
        """(pieces,) those of the region that the robot is in; a peer's may be another."""
        low = self._blocks[self._homes[robot]]
        out = np.zeros(len(self._weight), np.bool_)
        out[low[0] : low[1]] = True
        return out

    def update(
        self,
        t: float,
        tick: int,
        robots: NDArray[np.intp],
        poses: NDArray[np.float64],
        ranges: NDArray[np.float64],
        met: NDArray[np.intp],
    ) -> None:
        """Count the beams of one tick.

        t: simulated seconds at that tick. `robots` (r,) says whose rows these are; poses (r, 3); true ranges and met
        walls (r, beams) as from `Lidar.trace`, with met < 0 for beams that are not to count.
        """
        ray = np.flatnonzero(met.reshape(-1) >= 0)
        row, beam = np.divmod(ray, met.shape[1])
        wall = met.reshape(-1)[ray]
        x, y, theta = poses.T
        angle = theta[row] + beam * (2 * math.pi / met.shape[1])
        ux, uy = self._unit[wall].T
        along = x[row] * ux + y[row] * uy - self._origin[wall]
        along += ranges.reshape(-1)[ray] * (np.cos(angle) * ux + np.sin(angle) * uy)
        place = wall * _ROW_M + np.maximum(along, 0.0)
        robot = robots[row]
        for home, lookup in self._lookups.items():
            mine = self._homes[robot] == home if len(self._lookups) > 1 else slice(None)
            self._count(tick, robot[mine], wall[mine], place[mine], lookup)
        self.own = self._length / np.maximum(self._total, 1e-9)
        self.covered = self._covered_length / np.maximum(self._total, 1e-9)
        self.team = self._team_length / max(self._team_total, 1e-9)
        for share in self.MILESTONES:
            for i in np.flatnonzero(self.covered >= share - 1e-9).tolist():
                self.reached[i].setdefault(share, t)
            if self.team >= share - 1e-9:
                self.team_reached.setdefault(share, t)

    def _count(
        self,
        tick: int,
        robot: NDArray[np.intp],
        wall: NDArray[np.intp],
        place: NDArray[np.float64],
        lookup: _Lookup,
    ) -> None:
        nth = np.maximum(np.searchsorted(lookup.begins, place + _JOINT_M, side="right") - 1, 0)
        known = lookup.walls[nth] == wall  # the outside of a building is no visible wall
        robot, piece = robot[known], lookup.pieces[nth[known]]
        fresh = np.flatnonzero(~self._hit[robot, piece])
        if not len(fresh):
            return
        robot, piece = np.unique(np.stack([robot[fresh], piece[fresh]]), axis=1)
        self._hit[robot, piece] = True
        np.add.at(self._length, robot, self._weight[piece])
        first = self._since[robot, piece] > tick
        np.add.at(self._covered_length, robot[first], self._weight[piece[first]])
        self._hit_since[robot, piece] = tick
        self._since[robot, piece] = np.minimum(self._since[robot, piece], tick)
        new = np.unique(piece[~self._team_hit[piece]])
        self._team_hit[new] = True
        self._team_length += float(self._weight[new].sum())


def _index_of(world: World, regions: list[Polygon], x: float, y: float, radius_m: float) -> int:
    spot = shapely.Point(x, y)
    for i, region in enumerate(regions):
        if region.distance(spot) < 1e-3:
            return i
    raise WorldFileError(f"{world.source}: no free space for a robot of radius {radius_m} m at ({x:g}, {y:g})")
