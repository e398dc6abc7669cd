"""Paths around known walls: a lazy visibility graph over the corners of the map (ours).

The shortest path among walls bends only at corners that stick out into free space. Each of them gets nodes at the
distance that a path must keep; two nodes are joined if the straight motion between them keeps that distance from
every wall, which is asked only when the answer could shorten a path. Nothing is kept from one plan to the next:
walls move a little with every scan.
"""

import math
from collections.abc import Callable, Iterable
from functools import cached_property
from typing import NamedTuple

import numpy as np

from agent.exploration.frontiers import Ends, open_ends
from agent.exploration.path import first_clearance
from agent.geometry.bends import bend
from agent.geometry.clearance import crosses
from agent.geometry.wall_tiles import WallTiles, all_in_view, barred_by, keep_off, wall_tiles
from agent.kernels import kernel, shared_kernel
from protocol.arrays import Bools, Floats, Ints
from protocol.walls import neighbours
from protocol.wireframe import Wireframe

NODE_OFFSET_M = 0.01  # corners are passed this much wider than the clearance, as walls move a little with each scan
NODE_SHARE = 1.15  # nodes stand off a round or thin obstacle by so many clearances, so that ways between them keep it
FRONTIER_REACH_M = 0.5  # a wall probably goes on at least this far beyond its frontier end
FRONTIER_TOLL_M = 3.0  # what crossing that stretch costs, in metres of path

_NO_WALLS, _NO_NODES = np.zeros((0, 4)), np.zeros((0, 2))
_FROM_START, _NO_WAY = -1, -2  # in place of the row of the node before a goal


class Terrain(NamedTuple):
    """What ways lead around, at one clearance."""

    walls: WallTiles
    hurdles: Floats  # (h, 4) stretches that cost a toll: there walls probably go on beyond their frontier ends
    clearance: float  # distance in metres kept from walls
    nodes: Floats  # (k, 2) places where ways may bend
    motions: Floats  # (k, k) `_motion` of straight motions between nodes; before it was asked, minus their length
    joined: Ints  # (k, k) row by row first the nodes that may be joined to one: all but those found to be barred
    counts: Ints  # (k,) how many these are


class Origin(NamedTuple):
    """Where ways start, and the nodes as reached from there."""

    point: Floats  # (2,) metres
    clearance: float  # distance kept from walls on the first piece: less than the terrain's where the start is nearer
    cost: Floats  # (k,) metres of path to each node, tolls included; inf where there is no way
    before: Ints  # (k,) the node before each


@kernel
def _corner_nodes(points: Floats, into: Ints, out_of: Ints, offset: float) -> Floats:
    """Nodes (k, 2) around the corners that stick out; into, out_of: as of `bend`."""
    nodes, k = np.empty((2 * points.shape[0], 2)), 0
    for v in range(points.shape[0]):
        first, turn, count = bend(points, into, out_of, v)
        for j in range(count):
            radius = offset / math.cos(0.5 * turn / count)
            angle = first + 0.5 * math.pi + turn * (j + 0.5) / count
            nodes[k, 0] = points[v, 0] + radius * math.cos(angle)
            nodes[k, 1] = points[v, 1] + radius * math.sin(angle)
            k += 1
    return nodes[:k]


@kernel
def _motion(
    ax: float, ay: float, bx: float, by: float, clearance: float, walls: WallTiles, hurdles: Floats, likely: int
) -> tuple[float, int]:
    """Metres of the straight motion a-b, tolls included; inf, and by which row of walls, if one is too near.

    likely: the row that is looked at first, or -1. What bars one motion often bars those to the next nodes.
    """
    bar = barred_by(ax, ay, bx, by, walls, clearance, likely)
    if bar >= 0:
        return math.inf, bar
    along_x, along_y = bx - ax, by - ay
    cost = math.hypot(along_x, along_y)
    for k in range(hurdles.shape[0]):
        cx, cy, dx, dy = hurdles[k, 0], hurdles[k, 1], hurdles[k, 2], hurdles[k, 3]
        beside = ((cx - ax) * along_y - (cy - ay) * along_x) * ((dx - ax) * along_y - (dy - ay) * along_x) > 0.0
        if not beside and crosses(ax, ay, bx, by, cx, cy, dx, dy):
            cost += FRONTIER_TOLL_M
    return cost, -1


@shared_kernel
def _unasked(points: Floats, nodes: Floats) -> Floats:
    """(n, k) minus the distances between points (n, 2) and nodes (k, 2)."""
    out = np.empty((points.shape[0], nodes.shape[0]))
    for i in range(points.shape[0]):
        for j in range(nodes.shape[0]):
            dx, dy = points[i, 0] - nodes[j, 0], points[i, 1] - nodes[j, 1]
            out[i, j] = -math.sqrt(dx * dx + dy * dy)  # `hypot` takes four times as long
    return out


@kernel
def _shortest(start: Floats, start_clearance: float, terrain: Terrain) -> tuple[Floats, Ints]:
    """Dijkstra from start (2,): `cost` and `before` of an Origin."""
    walls, hurdles, clearance = terrain.walls, terrain.hurdles, terrain.clearance
    nodes, motions, joined = terrain.nodes, terrain.motions, terrain.joined
    n, (x, y), bar = nodes.shape[0], start, -1
    cost, before = np.empty(n), np.full(n, _FROM_START)
    for j in range(n):
        cost[j], bar = _motion(x, y, nodes[j, 0], nodes[j, 1], start_clearance, walls, hurdles, bar)
    ahead = cost.copy()  # inf where a node is settled
    for _ in range(n):
        at = int(np.argmin(ahead))
        if ahead[at] == math.inf:
            break
        ahead[at] = math.inf
        x, y = nodes[at]
        kept, bar = 0, -1
        for i in range(terrain.counts[at]):
            j = joined[at, i]
            if cost[at] + abs(motions[at, j]) < cost[j]:
                if motions[at, j] < 0.0:
                    motion, bar = _motion(x, y, nodes[j, 0], nodes[j, 1], clearance, walls, hurdles, bar)
                    motions[at, j] = motions[j, at] = motion
                if cost[at] + motions[at, j] < cost[j]:
                    cost[j] = ahead[j] = cost[at] + motions[at, j]
                    before[j] = at
            if motions[at, j] < math.inf:
                joined[at, kept] = j
                kept += 1
        terrain.counts[at] = kept
    return cost, before


@kernel
def _reach(origin: Origin, terrain: Terrain, goal: Floats, motions: Floats, worst: float) -> tuple[float, int]:
    """Cost of goal (2,) if below worst, and the node before it, _FROM_START or _NO_WAY.

    motions: (k,) from each node to the goal, as those of a terrain, filled in as they are asked.
    """
    walls, hurdles, clearance = terrain.walls, terrain.hurdles, terrain.clearance
    start, nodes, (x, y) = origin.point, terrain.nodes, goal
    best, last, bar = worst, _NO_WAY, -1
    if math.hypot(x - start[0], y - start[1]) < best:
        direct, bar = _motion(start[0], start[1], x, y, origin.clearance, walls, hurdles, bar)
        if direct < best:
            best, last = direct, _FROM_START
    for j in range(nodes.shape[0]):
        if origin.cost[j] + abs(motions[j]) >= best:
            continue
        if motions[j] < 0.0:
            motions[j], bar = _motion(nodes[j, 0], nodes[j, 1], x, y, clearance, walls, hurdles, bar)
        if origin.cost[j] + motions[j] < best:
            best, last = origin.cost[j] + motions[j], j
    return best, last


@kernel
def _costs(origin: Origin, terrain: Terrain, goals: Floats, motions: Floats) -> Floats:
    """Cost (g,) of each of goals (g, 2), inf where there is no way; motions: (g, k) rows of `_reach`."""
    out = np.empty(goals.shape[0])
    for i in range(goals.shape[0]):
        out[i], _ = _reach(origin, terrain, goals[i], motions[i], math.inf)
    return out


@kernel
def _reached(origin: Origin, terrain: Terrain, goals: Floats) -> Bools:
    """Whether each of goals (g, 2) is reached from the start or from a node that is."""
    start, nodes = origin.point, terrain.nodes
    out = np.zeros(goals.shape[0], np.bool_)
    for i in range(goals.shape[0]):
        x, y = goals[i]
        out[i] = barred_by(start[0], start[1], x, y, terrain.walls, origin.clearance, -1) < 0
        for j in range(nodes.shape[0]):
            if out[i]:
                break
            if origin.cost[j] < math.inf:
                out[i] = barred_by(nodes[j, 0], nodes[j, 1], x, y, terrain.walls, terrain.clearance, -1) < 0
    return out


@kernel
def _nearest(origin: Origin, terrain: Terrain, goals: Floats, extra: Floats) -> tuple[int, float, int]:
    """Goal of least cost + extra, that sum, and the node before it; goal -1 if none is reached.

    Goals are tried in the order of a lower bound that asks for no hurdles.
    """
    start, nodes = origin.point, terrain.nodes
    g = goals.shape[0]
    bound = np.empty(g)
    for i in range(g):
        low = math.hypot(goals[i, 0] - start[0], goals[i, 1] - start[1])
        if barred_by(start[0], start[1], goals[i, 0], goals[i, 1], terrain.walls, origin.clearance, -1) >= 0:
            low = math.inf
            for j in range(nodes.shape[0]):
                dx, dy = goals[i, 0] - nodes[j, 0], goals[i, 1] - nodes[j, 1]
                low = min(low, origin.cost[j] + math.sqrt(dx * dx + dy * dy))
        bound[i] = low + extra[i]
    best, which, last = math.inf, -1, _NO_WAY
    while g > 0:
        i = int(np.argmin(bound))
        if bound[i] >= best:
            break
        motions = _unasked(goals[i : i + 1], nodes)[0]
        found, node = _reach(origin, terrain, goals[i], motions, best - extra[i])
        if node != _NO_WAY:
            best, which, last = found + extra[i], i, node
        bound[i] = math.inf
    return which, best, last


def hurdles_of(ends: Ends) -> Floats:
    """Stretches (h, 4) where walls probably go on beyond their frontier ends."""
    p = ends.points[ends.frontier]
    return np.hstack((p, p + FRONTIER_REACH_M * ends.along[ends.frontier]))


class Route(NamedTuple):
    """The way to the best of several goals."""

    row: int  # of that goal among them
    cost: float  # metres of path, tolls and what was added to the goal included
    path: Floats  # (k, 2) from the start to the goal


class Roads:
    """All shortest ways from one start around the walls of a map, at one clearance."""

    def __init__(
        self,
        wireframe: Wireframe,
        start: Floats,
        clearance_m: float,
        more_walls: Floats = _NO_WALLS,
        more_nodes: Floats = _NO_NODES,
        node_offset_m: float = NODE_OFFSET_M,
        of_teammates: "Callable[[], Roads] | None" = None,
        sight_m: float = math.inf,
    ) -> None:
        """start: (2,) metres in the map's frame; more_walls (k, 4), more_nodes (j, 2): obstacles not in the map.

        of_teammates: makes the roads that teammates take, where they are others. sight_m: as far as the robot sees.
        """
        self.clearance, self._of_teammates, self._sight_m = clearance_m, of_teammates, sight_m
        self.walls = np.ascontiguousarray(np.vstack((wireframe.segments(), more_walls)))
        into, out_of = neighbours(wireframe.edges, len(wireframe.points))
        nodes = _corner_nodes(wireframe.points, into, out_of, clearance_m + node_offset_m)
        nodes = np.vstack((nodes, more_nodes))
        tiles = wall_tiles(self.walls)
        self.nodes = nodes[keep_off(nodes, tiles, clearance_m)]
        k = len(self.nodes)
        asked = _unasked(self.nodes, self.nodes), np.tile(np.arange(k), (k, 1)), np.full(k, k)
        self.terrain = Terrain(tiles, hurdles_of(open_ends(wireframe)), clearance_m, self.nodes, *asked)
        self.origin = self.leave(start)

    def leave(self, start: Floats) -> Origin:
        """Where ways start at another place (2,), and the nodes as reached from there."""
        start = np.ascontiguousarray(start, np.float64)
        clearance = first_clearance(start, self.walls, self.clearance)
        return Origin(start, clearance, *_shortest(start, clearance, self.terrain))

    @cached_property
    def of_teammates(self) -> "Roads":
        """The roads that teammates take: they lead through teammates, as none stands in its own way.

        That one may stand in another's is left away.
        """
        return self._of_teammates() if self._of_teammates else self

    def standable(self, points: Floats) -> Bools:
        """Whether each of points (n, 2) keeps the clearance."""
        return np.asarray(keep_off(np.ascontiguousarray(points), self.terrain.walls, self.clearance))

    def with_view(self, points: Floats, targets: Floats, hiding: WallTiles | None = None) -> Bools:
        """Which of points (n, 2) keep the clearance and have the target (n, 2) of the same row in view, near enough.

        hiding: walls that hide targets, if not those that the roads lead around.
        """
        good = self.standable(points)
        good &= np.hypot(*(points - targets).T) <= self._sight_m
        good[good] = all_in_view(points[good], targets[good], self.terrain.walls if hiding is None else hiding)
        return good

    def nearest(self, goals: Floats, extra: Floats) -> Route | None:
        """The way to that of goals (g, 2) with the least path cost + extra (g,) metres; None if none is reached."""
        if not len(goals):
            return None
        which, cost, last = _nearest(self.origin, self.terrain, np.ascontiguousarray(goals), extra)
        if which < 0:
            return None
        way = [goals[which]]
        while last != _FROM_START:
            way.append(self.nodes[last])
            last = int(self.origin.before[last])
        way.append(self.origin.point)
        return Route(which, cost, np.array(way[::-1]))

    def way_to(self, goal: Floats) -> Route | None:
        """The way to one goal (2,), None if there is none."""
        return self.nearest(goal[None], np.zeros(1))

    def reached(self, goals: Floats) -> Bools:
        """Whether there is a way to each of goals (g, 2)."""
        return np.asarray(_reached(self.origin, self.terrain, np.ascontiguousarray(goals, np.float64)))

    def costs(self, goals: Floats) -> Floats:
        """Path cost (g,) in metres of each of goals (g, 2); inf where there is no way."""
        return np.asarray(self._costs([self.origin], goals)[0])

    def costs_from(self, starts: Floats, goals: Floats) -> Floats:
        """Path cost (s, g) in metres of goals (g, 2) from each of starts (s, 2); inf where there is no way."""
        return self._costs(map(self.leave, starts), goals)

    def _costs(self, origins: Iterable[Origin], goals: Floats) -> Floats:
        goals = np.ascontiguousarray(goals, np.float64)
        motions = _unasked(goals, self.nodes)
        return np.array([_costs(origin, self.terrain, goals, motions) for origin in origins])


def circle(count: int) -> Floats:
    """(count, 2) unit vectors evenly around, the first along x."""
    angles = np.arange(count) * (2.0 * math.pi / count)
    return np.stack((np.cos(angles), np.sin(angles)), 1)
