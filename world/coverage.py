"""Coverage: the share of the visible wall that robots' beams have hit (docs/formats.md)."""

import math
from collections.abc import Mapping
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon

from protocol.arrays import Bools, Floats, Ints
from protocol.walls import directions, lengths
from world.checkpoint import State, restore_array
from world.worldfile import World

PIECE_M = 0.05
"""Walls are counted in pieces of at most this length (as in the scorer)."""
GRAZING_RAD = math.radians(8.0)
"""A wall seen at a smaller angle than this is not expected to be mapped (as in the scorer)."""
GRID_M = 0.30
"""Distance between the poses from which visibility is tried (as in the scorer)."""
_EYE_M = 2e-4
"""A line of sight to a piece of wall ends this far before its middle, in free space (as in the scorer)."""
_BLOCK = 1_000_000
"""Pairs of a pose and a piece of wall that are compared at a time; a pair takes 50 bytes."""
_SIGHTS = 20_000
"""Lines of sight that are tried at a time: one a piece at first, as the nearest pose sees nearly all, then more."""
_JOINT_M = 1e-6
"""A hit this near to the joint of two pieces counts for the second piece; larger than rounding errors."""
NEVER = np.iinfo(np.int32).max
"""In place of a tick: not yet."""
_ROW_M = 1e4
"""The key of a place on the outline is its segment's index times this, plus metres along it. No wall is longer."""


class VisibleWall(NamedTuple):
    """The outline around one region, cut into pieces, and which of them a robot in the region can see."""

    ends: Floats
    """(n, 4) x1, y1, x2, y2 of each piece."""
    lengths: Floats
    """(n,) metres."""
    visible: Bools
    """(n,) whether some place that the robot's centre can reach sees it, within range and above GRAZING_RAD."""


@lru_cache(maxsize=16)
def visible_wall(world: World, region: int, radius_m: float, reach_m: float) -> VisibleWall:
    """Visible wall of the region of that index among `world.regions(radius_m)`; the scorer's definition."""
    reachable = world.regions(radius_m)[region]
    pieces = []
    for ring in world.outlines_around(reachable):
        for a, b in pairwise(ring):
            count = max(1, math.ceil(np.hypot(*(b - a)) / PIECE_M))
            cuts = a + np.linspace(0, 1, count + 1)[:, None] * (b - a)
            pieces.append(np.hstack([cuts[:-1], cuts[1:]]))
    ends = np.vstack(pieces) if pieces else np.zeros((0, 4))
    return VisibleWall(ends, lengths(ends), _visible(world, reachable, ends, reach_m))


def _visible(world: World, reachable: Polygon, ends: Floats, reach_m: float) -> Bools:
    """(n,) which pieces some pose sees. Near poses are tried first, as they show nearly all pieces."""
    poses = _poses(reachable)
    normal = directions(ends)[:, ::-1] * (-1, 1)  # free space lies on the left
    eye = (ends[:, :2] + ends[:, 2:]) / 2 + _EYE_M * normal
    tree = shapely.STRtree(shapely.points(poses))
    visible = np.zeros(len(ends), np.bool_)
    shapely.prepare(world.solid)
    tried = 0.0
    for distance in (reach_m / 8, reach_m / 4, reach_m / 2, reach_m):
        around = math.pi * (distance + GRID_M) ** 2 / GRID_M**2  # poses, about; bounds the memory of a block
        hidden = np.flatnonzero(~visible)
        for block in np.array_split(hidden, math.ceil(len(hidden) * around / _BLOCK) or 1):
            visible[block] = _seen(world, tree, poses, eye[block], normal[block], (tried, distance))
        tried = distance
    return visible


def _seen(
    world: World, tree: shapely.STRtree, poses: Floats, eye: Floats, normal: Floats, between: tuple[float, float]
) -> Bools:
    """(n,) which eyes (n, 2) on walls with these normals some pose (p, 2) sees from between these distances."""
    piece, pose = tree.query(shapely.points(eye), predicate="dwithin", distance=between[1])
    view = poses[pose] - eye[piece]
    away = np.hypot(view[:, 0], view[:, 1])
    asked = (view * normal[piece]).sum(1) > math.sin(GRAZING_RAD) * away
    asked &= away > between[0] - _EYE_M  # what rounding puts on both sides is asked twice, and nothing never
    piece, pose, away = piece[asked], pose[asked], away[asked]
    order = np.lexsort((away, piece))
    piece, pose = piece[order], pose[order]
    first = np.searchsorted(piece, np.arange(len(eye)))
    count = np.bincount(piece, minlength=len(eye))
    seen, tried = np.zeros(len(eye), np.bool_), 0
    while len(hidden := np.flatnonzero(~seen & (count > tried))):
        more = min(max(tried, 1), max(_SIGHTS // len(hidden), 1))
        tries = np.minimum(count[hidden] - tried, more)
        of = np.repeat(hidden, tries)
        nth = np.arange(len(of)) - np.repeat(np.cumsum(tries) - tries, tries)
        sight = shapely.linestrings(np.stack([eye[of], poses[pose[first[of] + tried + nth]]], 1))
        seen[of[~shapely.intersects(world.solid, sight)]] = True
        tried += more
    return seen


def _poses(reachable: Polygon) -> Floats:
    """(p, 2) places in a region: a grid, and points along its rim."""
    x0, y0, x1, y1 = reachable.bounds
    grid = np.meshgrid(np.arange(x0, x1 + GRID_M, GRID_M), np.arange(y0, y1 + GRID_M, GRID_M))
    spots = np.stack(grid, -1).reshape(-1, 2)
    spots = spots[shapely.contains_xy(reachable, spots[:, 0], spots[:, 1])]
    rings = (reachable.exterior, *reachable.interiors)
    rim = [shapely.line_interpolate_point(ring, np.arange(0, ring.length, GRID_M)) for ring in rings]
    return np.vstack([spots, shapely.get_coordinates(np.concatenate(rim))])


class _Lookup(NamedTuple):
    """Pieces (n,) of the outline around one region, in the order in which they begin on the lidar's segments."""

    begins: Floats
    """Key (see _ROW_M) of the place where each begins, rising."""
    walls: Ints
    """The segment that each is a part of."""
    pieces: Ints
    """Its index among the pieces of all regions."""


class Coverage:
    """Which pieces of wall each robot has covered so far, and when that made 90 and 99 %.

    A robot covers a piece that its own beams have hit, or that a peer had covered when it sent a map which the robot
    has merged, also from a peer of its own: so coverage passes through any number of merges. The team's coverage is the
    union of all robots' own beams.
    """

    MILESTONES = (0.90, 0.99)

    def __init__(self, world: World, starts: Floats, radius_m: float, reach_m: float) -> None:
        """`starts` is (k, 3): robots that start in one region share its visible wall."""
        homes = [world.region_index(x, y, radius_m) for x, y, _ in starts.tolist()]
        walls = {home: visible_wall(world, home, radius_m, reach_m) for home in sorted(set(homes))}
        self._weight = np.concatenate([np.where(wall.visible, wall.lengths, 0.0) for wall in walls.values()])
        self._home_of_piece = np.repeat(list(walls), [len(wall.ends) for wall in walls.values()])
        robots, pieces = len(starts), len(self._weight)
        self._total = np.array([walls[h].lengths[walls[h].visible].sum() for h in homes])
        self._team_total = float(self._weight.sum())
        self._since = np.full((robots, pieces), NEVER, np.int32)
        """Tick since which a piece has been covered."""
        self._hit_since = self._since.copy()
        """Tick of the first own beam."""
        self._merged: list[dict[int, int]] = [{} for _ in range(robots)]
        """For each robot: the peers whose maps it has merged, and the ticks of these maps."""
        self._team_hit = np.zeros(pieces, np.bool_)
        self._length = np.zeros(robots)
        self._covered_length = np.zeros(robots)
        self._team_length = 0.0
        self._start, self._unit = world.segments[:, :2], directions(world.segments)
        self._origin = (self._start * self._unit).sum(1)
        firsts = np.searchsorted(self._home_of_piece, list(walls)).tolist()
        self._lookups = {
            home: self._lookup(world, wall.ends, first)
            for (home, wall), first in zip(walls.items(), firsts, strict=True)
        }
        self._homes = np.array(homes)
        self.own = np.zeros(robots)
        """(k,) share of the visible wall of each robot's region that its own beams have hit."""
        self.covered = np.zeros(robots)
        """(k,) the same, and what merged maps cover."""
        self.team = 0.0
        """Share of the visible wall of all robots' regions that any robot has hit."""
        self.reached: list[dict[float, float]] = [{} for _ in range(robots)]
        """For each robot: simulated seconds at which a milestone was reached."""
        self.team_reached: dict[float, float] = {}

    def _arrays(self) -> dict[str, NDArray[Any]]:
        """Those that grow with the run."""
        names = ("_team_hit", "_length", "_covered_length", "own", "covered")
        return {name: getattr(self, name) for name in names}

    def state(self) -> State:
        """For a checkpoint."""
        numbers = {"merged": self._merged, "reached": self.reached, "team_reached": self.team_reached}
        numbers |= {"team_length": self._team_length, "team": self.team}
        numbers |= {name: _known(getattr(self, name)) for name in ("_since", "_hit_since")}
        return numbers | {name: array.tobytes() for name, array in self._arrays().items()}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        for name, array in self._arrays().items():
            restore_array(array, state[name])
        for name in ("_since", "_hit_since"):
            _restore_known(getattr(self, name), *state[name])
        self._merged, self.reached, self.team_reached = (state[name] for name in ("merged", "reached", "team_reached"))
        self._team_length, self.team = float(state["team_length"]), float(state["team"])

    def _lookup(self, world: World, ends: Floats, first: int) -> _Lookup:
        """Which piece a place on the lidar's segments belongs to; `first` is that of the first of `ends`."""
        middles = shapely.points((ends[:, :2] + ends[:, 2:]) / 2)
        tree = shapely.STRtree(shapely.linestrings(world.segments.reshape(-1, 2, 2)))
        piece, segment = tree.query_nearest(middles, all_matches=False)
        begin = ((ends[piece, :2] - self._start[segment]) * self._unit[segment]).sum(1)
        key = segment * _ROW_M + begin
        order = np.argsort(key, kind="stable")
        return _Lookup(key[order], segment[order], piece[order] + first)

    def merge(self, tick: int, robot: int, merged: Mapping[int, int]) -> None:
        """Take the peers whose maps a robot has merged, with the ticks of these maps; other merges are undone."""
        before = self._merged[robot]
        if merged == before:
            return
        then = np.array([*merged.values()], np.int64)[:, None]
        known = (self._since[[*merged]] <= then).any(0)
        if any(peer not in merged for peer in before):
            np.copyto(self._since[robot], self._hit_since[robot], where=~known)
        np.minimum(self._since[robot], tick, out=self._since[robot], where=known)
        self._merged[robot] = dict(merged)
        at_home = self._home_of_piece == self._homes[robot]  # a peer may be in another region
        self._covered_length[robot] = self._weight[(self._since[robot] < NEVER) & at_home].sum()

    def update(self, t: float, tick: int, robots: Ints, rays: Floats, ranges: Floats, met: Ints) -> None:
        """Count the beams of one tick.

        t: its simulated seconds. `robots` (r,) says whose rows these are; rays (r, beams, 3) as from `Lidar.rays`, true
        ranges and met walls (r, beams) as from `Lidar.trace`, with met < 0 for beams that are not to count.
        """
        ray = np.flatnonzero(met.reshape(-1) >= 0)
        wall = met.reshape(-1)[ray]
        x, y, angle = rays.reshape(-1, 3)[ray].T
        ux, uy = self._unit[wall].T
        along = x * ux + y * uy - self._origin[wall]
        along += ranges.reshape(-1)[ray] * (np.cos(angle) * ux + np.sin(angle) * uy)
        place = wall * _ROW_M + np.maximum(along, 0.0)
        robot = robots[ray // met.shape[1]]
        for home, lookup in self._lookups.items():
            mine = self._homes[robot] == home if len(self._lookups) > 1 else slice(None)
            self._count(tick, robot[mine], wall[mine], place[mine], lookup)
        self.judge(t)

    @property
    def overlap(self) -> float:
        """Share of the same wall as `team` that robots' own beams have hit once more, for each further robot."""
        again = float(self._length.sum()) - self._team_length
        return max(again, 0.0) / max(self._team_total, 1e-9)  # less than 0 by rounding only

    def judge(self, t: float) -> None:
        """Work out the shares, and which milestones are reached at t, simulated seconds."""
        self.own = self._length / np.maximum(self._total, 1e-9)
        self.covered = self._covered_length / np.maximum(self._total, 1e-9)
        self.team = self._team_length / max(self._team_total, 1e-9)
        for share in self.MILESTONES:
            for i in np.flatnonzero(self.covered >= share - 1e-9).tolist():
                self.reached[i].setdefault(share, t)
            if self.team >= share - 1e-9:
                self.team_reached.setdefault(share, t)

    def _count(self, tick: int, robot: Ints, wall: Ints, place: Floats, lookup: _Lookup) -> None:
        """Count hits (h,) of robots on walls at places (see _ROW_M)."""
        nth = np.maximum(np.searchsorted(lookup.begins, place + _JOINT_M, side="right") - 1, 0)
        known = lookup.walls[nth] == wall  # a beam may meet the outside of a building, which has no pieces
        robot, piece = robot[known], lookup.pieces[nth[known]]
        fresh = self._hit_since[robot, piece] == NEVER
        if not fresh.any():
            return
        robot, piece = np.unique(np.stack([robot[fresh], piece[fresh]]), axis=1)
        np.add.at(self._length, robot, self._weight[piece])
        first = self._since[robot, piece] > tick
        np.add.at(self._covered_length, robot[first], self._weight[piece[first]])
        self._hit_since[robot, piece] = tick
        self._since[robot, piece] = np.minimum(self._since[robot, piece], tick)
        new = np.unique(piece[~self._team_hit[piece]])
        self._team_hit[new] = True
        self._team_length += float(self._weight[new].sum())


def _known(ticks: NDArray[np.int32]) -> tuple[bytes, bytes]:
    """Which of many ticks are not NEVER, and what they are: a robot of many sees a small part of a large world."""
    at = np.flatnonzero(ticks != NEVER)
    return at.tobytes(), ticks.reshape(-1)[at].tobytes()


def _restore_known(ticks: NDArray[np.int32], at: bytes, known: bytes) -> None:
    """Set ticks as `_known` told. Raises ValueError or IndexError where that makes no sense."""
    places = np.frombuffer(at, np.intp)
    if (places < 0).any():
        raise ValueError("a place before the first")
    ticks[...] = NEVER
    ticks.reshape(-1)[places] = np.frombuffer(known, ticks.dtype)
