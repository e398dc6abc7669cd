"""Paths around known walls: a lazy visibility graph over the corners of the map (ours).

The shortest path among walls bends only at corners that stick out into free space. Each of them gets nodes at the
distance that a path must keep; two nodes are joined if the straight motion between them keeps that distance from
every wall, which is asked only when the answer could shorten a path. Nothing is kept from one plan to the next:
walls move a little with every scan.
"""

from __future__ import annotations

import math
from copy import copy

import numpy as np

from agent.exploration.config import PlanningConfig
from agent.geometry.clearance import crosses, distance_to_walls, distances_to_walls, keeps_clear, path_clear
from agent.kernels import kernel
from protocol.arrays import Bools, Floats, Ints
from protocol.geometry import wrapped
from protocol.wireframe import Label, Wireframe

_UNASKED, _BARRED = -2, -1
_SLACK = 0.98
"""A start nearer to a wall than the clearance may go on at this share of its distance, so that it gets away."""


@kernel
def _corner_nodes(points: Floats, into: Ints, out_of: Ints, offset: float) -> Floats:
    """Nodes (k, 2) around the corners that stick out, where free space is on the left of every edge.

    into, out_of: (n,) the vertex before and after, or -1. A chain's end is walked around as the tip of a thin wall.
    """
    nodes = np.empty((2 * points.shape[0], 2))
    k = 0
    for v in range(points.shape[0]):
        a, b = into[v], out_of[v]
        if a < 0 and b < 0:
            continue
        x, y = points[v]
        if a >= 0 and b >= 0:
            first = math.atan2(y - points[a, 1], x - points[a, 0])
            second = math.atan2(points[b, 1] - y, points[b, 0] - x)
            turn = -wrapped(first - second)
            if turn > math.pi - 1e-6:
                turn = -math.pi
        elif a >= 0:
            first = math.atan2(y - points[a, 1], x - points[a, 0])
            turn = -math.pi
        else:
            first = math.atan2(points[b, 1] - y, points[b, 0] - x) + math.pi
            turn = -math.pi
        if turn > -0.05:
            continue
        count = 1 if turn > -0.5 * math.pi - 0.1 else 2
        radius = offset / math.cos(0.5 * turn / count)
        for j in range(count):
            angle = first + 0.5 * math.pi + turn * (j + 0.5) / count
            nodes[k, 0], nodes[k, 1] = x + radius * math.cos(angle), y + radius * math.sin(angle)
            k += 1
    return nodes[:k]


@kernel
def _join(ax: float, ay: float, bx: float, by: float, walls: Floats, hurdles: Floats, clearance: float) -> int:
    """How many hurdles the straight motion a-b crosses, -1 if it does not keep the clearance from the walls."""
    if not keeps_clear(ax, ay, bx, by, walls, clearance):
        return _BARRED
    n = 0
    for k in range(hurdles.shape[0]):
        if crosses(ax, ay, bx, by, hurdles[k, 0], hurdles[k, 1], hurdles[k, 2], hurdles[k, 3]):
            n += 1
    return n


@kernel
def _shortest(
    start: Floats,
    start_clearance: float,
    nodes: Floats,
    joins: Ints,
    walls: Floats,
    hurdles: Floats,
    clearance: float,
    toll: float,
) -> tuple[Floats, Ints]:
    """Dijkstra from start: cost (k,) of each node, inf where there is no way, and the node before it, -1: the start.

    joins: (k, k) what `_join` said of two nodes, filled in as it is asked.
    """
    n = nodes.shape[0]
    cost = np.full(n, math.inf)
    before = np.full(n, -1)
    settled = np.zeros(n, np.bool_)
    at, at_cost = -1, 0.0
    while True:
        px, py = (start[0], start[1]) if at < 0 else (nodes[at, 0], nodes[at, 1])
        for j in range(n):
            if settled[j]:
                continue
            qx, qy = nodes[j, 0], nodes[j, 1]
            new = at_cost + math.hypot(qx - px, qy - py)
            if new >= cost[j]:
                continue
            if at < 0:
                join = _join(px, py, qx, qy, walls, hurdles, start_clearance)
            else:
                if joins[at, j] == _UNASKED:
                    joins[at, j] = joins[j, at] = _join(px, py, qx, qy, walls, hurdles, clearance)
                join = joins[at, j]
            if join == _BARRED:
                continue
            new += toll * join
            if new < cost[j]:
                cost[j], before[j] = new, at
        at = -1
        best = math.inf
        for j in range(n):
            if not settled[j] and cost[j] < best:
                best, at = cost[j], j
        if at < 0:
            return cost, before
        settled[at] = True
        at_cost = best


@kernel
def _reach(
    start: Floats,
    start_clearance: float,
    nodes: Floats,
    cost: Floats,
    goal: Floats,
    walls: Floats,
    hurdles: Floats,
    clearance: float,
    toll: float,
    worst: float,
) -> tuple[float, int]:
    """Cost of the goal if below worst, and the node before it: -1 the start, -2 none."""
    best, last = worst, -2
    direct = math.hypot(goal[0] - start[0], goal[1] - start[1])
    if direct < best:
        join = _join(start[0], start[1], goal[0], goal[1], walls, hurdles, start_clearance)
        if join != _BARRED and direct + toll * join < best:
            best, last = direct + toll * join, -1
    for j in range(nodes.shape[0]):
        new = cost[j] + math.hypot(goal[0] - nodes[j, 0], goal[1] - nodes[j, 1])
        if new >= best:
            continue
        join = _join(nodes[j, 0], nodes[j, 1], goal[0], goal[1], walls, hurdles, clearance)
        if join != _BARRED and new + toll * join < best:
            best, last = new + toll * join, j
    return best, last


@kernel
def _costs(
    start: Floats,
    start_clearance: float,
    nodes: Floats,
    cost: Floats,
    goals: Floats,
    walls: Floats,
    hurdles: Floats,
    clearance: float,
    toll: float,
) -> Floats:
    """Cost (g,) of each of goals (g, 2), inf where there is no way."""
    out = np.empty(goals.shape[0])
    for i in range(goals.shape[0]):
        out[i], _ = _reach(start, start_clearance, nodes, cost, goals[i], walls, hurdles, clearance, toll, math.inf)
    return out


@kernel
def _reached(
    start: Floats, start_clearance: float, nodes: Floats, cost: Floats, goals: Floats, walls: Floats, clearance: float
) -> Bools:
    """Whether each of goals (g, 2) is reached from the start or from a node that is."""
    out = np.zeros(goals.shape[0], np.bool_)
    for i in range(goals.shape[0]):
        x, y = goals[i]
        out[i] = keeps_clear(start[0], start[1], x, y, walls, start_clearance)
        for j in range(nodes.shape[0]):
            if out[i]:
                break
            out[i] = cost[j] < math.inf and keeps_clear(nodes[j, 0], nodes[j, 1], x, y, walls, clearance)
    return out


@kernel
def _nearest(
    start: Floats,
    start_clearance: float,
    nodes: Floats,
    cost: Floats,
    goals: Floats,
    extra: Floats,
    walls: Floats,
    hurdles: Floats,
    clearance: float,
    toll: float,
) -> tuple[int, float, int]:
    """Goal of least cost + extra, that sum, and the node before it; goal -1 if none is reached.

    Goals are tried in the order of a lower bound that asks for no walls.
    """
    g = goals.shape[0]
    bound = np.empty(g)
    for i in range(g):
        low = math.hypot(goals[i, 0] - start[0], goals[i, 1] - start[1])
        if not keeps_clear(start[0], start[1], goals[i, 0], goals[i, 1], walls, start_clearance):
            low = math.inf
            for j in range(nodes.shape[0]):
                low = min(low, cost[j] + math.hypot(goals[i, 0] - nodes[j, 0], goals[i, 1] - nodes[j, 1]))
        bound[i] = low + extra[i]
    best, which, last = math.inf, -1, -2
    for i in np.argsort(bound):
        if bound[i] >= best:
            break
        found, node = _reach(
            start, start_clearance, nodes, cost, goals[i], walls, hurdles, clearance, toll, best - extra[i]
        )
        if node != -2:
            best, which, last = found + extra[i], i, node
    return which, best, last


def chains(wireframe: Wireframe) -> tuple[Ints, Ints]:
    """Per vertex (n,) the one before and the one after it along the wall, -1 where there is none."""
    n = len(wireframe.points)
    into, out_of = np.full(n, -1), np.full(n, -1)
    into[wireframe.edges[:, 1]] = wireframe.edges[:, 0]
    out_of[wireframe.edges[:, 0]] = wireframe.edges[:, 1]
    return into, out_of


def hurdles_of(wireframe: Wireframe, reach_m: float) -> Floats:
    """Stretches (h, 4) where walls probably go on beyond their frontier ends."""
    into, out_of = chains(wireframe)
    frontier = wireframe.labels == Label.FRONTIER
    head = np.flatnonzero(frontier & (into >= 0) & (out_of < 0))
    tail = np.flatnonzero(frontier & (into < 0) & (out_of >= 0))
    ends = np.concatenate((head, tail))
    inner = np.concatenate((into[head], out_of[tail]))
    p = wireframe.points[ends]
    along = p - wireframe.points[inner]
    along *= reach_m / np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
    return np.hstack((p, p + along))


class Roads:
    """All shortest ways from one start around the walls of a map, at one clearance."""

    def __init__(
        self,
        config: PlanningConfig,
        wireframe: Wireframe,
        start: Floats,
        clearance_m: float,
        more_walls: Floats | None = None,
        more_nodes: Floats | None = None,
    ) -> None:
        """start: (2,) metres in the map's frame; more_walls (k, 4), more_nodes (j, 2): obstacles not in the map."""
        walls = wireframe.segments()
        if more_walls is not None and len(more_walls):
            walls = np.vstack((walls, more_walls))
        self.walls = np.ascontiguousarray(walls)
        self.clearance = clearance_m
        self.hurdles = hurdles_of(wireframe, config.frontier_reach_m)
        self.toll = config.frontier_cost_m
        into, out_of = chains(wireframe)
        nodes = _corner_nodes(wireframe.points, into, out_of, clearance_m + config.node_offset_m)
        if more_nodes is not None and len(more_nodes):
            nodes = np.vstack((nodes, more_nodes))
        self.nodes = nodes[distances_to_walls(nodes, self.walls) >= clearance_m]
        self._joins = np.full((len(self.nodes),) * 2, _UNASKED)
        self._start(start)

    def _start(self, start: Floats) -> None:
        self.start = np.ascontiguousarray(start, np.float64)
        self.start_clearance = min(self.clearance, _SLACK * distance_to_walls(start[0], start[1], self.walls))
        self.cost, self.before = _shortest(
            self.start, self.start_clearance, self.nodes, self._joins,
            self.walls, self.hurdles, self.clearance, self.toll,
        )  # fmt: skip

    def starting_at(self, start: Floats) -> Roads:
        """The same roads from another start (2,)."""
        other = copy(self)
        other._start(start)
        return other

    def standable(self, points: Floats) -> Bools:
        """Whether each of points (n, 2) keeps the clearance."""
        return np.asarray(distances_to_walls(np.ascontiguousarray(points), self.walls) >= self.clearance)

    def nearest(self, goals: Floats, extra: Floats) -> tuple[int, float, Floats] | None:
        """Goal (of (g, 2)) with the least path cost + extra (g,), that sum in metres, and its path (k, 2) from start.

        None if no goal is reached.
        """
        if not len(goals):
            return None
        which, cost, last = _nearest(
            self.start, self.start_clearance, self.nodes, self.cost, np.ascontiguousarray(goals),
            extra, self.walls, self.hurdles, self.clearance, self.toll,
        )  # fmt: skip
        if which < 0:
            return None
        way = [goals[which]]
        while last >= 0:
            way.append(self.nodes[last])
            last = int(self.before[last])
        way.append(self.start)
        return which, cost, np.array(way[::-1])

    def reached(self, goals: Floats) -> Bools:
        """Whether there is a way to each of goals (g, 2)."""
        goals = np.ascontiguousarray(goals, np.float64)
        reached: Bools = _reached(
            self.start, self.start_clearance, self.nodes, self.cost, goals, self.walls, self.clearance
        )
        return reached

    def costs(self, goals: Floats) -> Floats:
        """Path cost (g,) in metres of each of goals (g, 2); inf where there is no way."""
        costs: Floats = _costs(
            self.start, self.start_clearance, self.nodes, self.cost, np.ascontiguousarray(goals, np.float64),
            self.walls, self.hurdles, self.clearance, self.toll,
        )  # fmt: skip
        return costs


def still_clear(path: Floats, walls: Floats, clearance_m: float) -> bool:
    """Whether a path (k, 2) still keeps the clearance from walls (m, 4); its first piece may begin nearer."""
    if len(path) < 2:
        return True
    x, y = path[0]
    first = min(clearance_m, _SLACK * distance_to_walls(x, y, walls))
    return bool(path_clear(path[:2], walls, first) and path_clear(path[1:], walls, clearance_m))
