"""The shortest tour that sees all visible wall, from below: no explorer's path is shorter, even if it knows the map.

Why it is a bound. To see a place p on a wall, a robot's centre must come into V(p): where it can be at all, within
range of p and with a free line of sight to it. A path that sees places p1 ... pk enters each V(pi) for the first time
at some point; between two of these it drives at least the distance of the two sets. So its length is at least that
of the shortest open tour of the sets from the start (a relaxation of the travelling salesman problem with
neighbourhoods), and the Held-Karp bound is at most that: the weight of a least 1-tree stays below that of the best
tour whatever prices are put on the places. Every choice of places gives such a bound, so the greatest found
counts.

Each step errs downwards only:
- V(p) is made larger: the circle of the range by a polygon around it, and its rim moved outwards by a millimetre;
- it is sampled on a lattice, with all lattice points within half a cell's diagonal of it, and both ends of a leg are
  credited with that distance. The way between a point and its sample is free, as the body's disc around it is;
- the way between two samples is that of a point, which needs no room, around the true corners.

It bounds the path that sees those places, and so all of the visible wall, not 99 % of it.
"""

import math

import numpy as np
import shapely

from agent.exploration.planning import Roads
from agent.geometry.clearance import keeps_clear
from agent.geometry.visibility import visible_ring
from agent.kernels import kernel
from deploy.bench.cases import Case, Figures, each
from deploy.bench.exploration.runs import seeds, worlds
from deploy.bench.layouts import drawn_starts, path_of
from deploy.bench.tables import Outcomes, Row, Runs, Table, by_label
from protocol.arrays import Floats
from protocol.messages import RobotSpec
from protocol.walls import directions
from protocol.wireframe import enclosed
from world.coverage import visible_wall
from world.worldfile import World, load

LATTICE_M = 0.1  # cells whose half diagonal, 7 cm, is less than the body's radius
OFF_M = 1e-3  # a place on a wall is looked at from this far off it; ways keep this from walls
BEND_M = 0.01  # most by which a leg is too long because it bends around corners at OFF_M; three bends cost less
APART_M = 0.7  # least distance between the places that are tried; those seen from the least area come first
MOST = 25  # places that are tried
RAYS = 180


@kernel
def _between(a: Floats, b: Floats, walls: Floats, best: float) -> float:
    """Distance between points (k, 2) and (m, 2) in line of sight if below best, else best."""
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            d = math.hypot(a[i, 0] - b[j, 0], a[i, 1] - b[j, 1])
            if d < best and keeps_clear(a[i, 0], a[i, 1], b[j, 0], b[j, 1], walls, 0.5 * OFF_M):
                best = d
    return best


def _hardest(world: World, home: int, spec: RobotSpec) -> list[shapely.Geometry]:
    """V(p) of those places p of a region that are seen from the least area, spread over the walls."""
    wall = visible_wall(world, home, spec.radius_m, spec.lidar.range_max_m)
    ends, region = wall.ends[wall.visible], world.regions(spec.radius_m)[home]
    unit = directions(ends)
    places = 0.5 * (ends[:, :2] + ends[:, 2:]) + OFF_M * np.stack((-unit[:, 1], unit[:, 0]), 1)
    circle_m = spec.lidar.range_max_m / math.cos(math.pi / RAYS)
    views = []
    for x, y in places.tolist():
        ring = visible_ring(x, y, np.ascontiguousarray(world.segments), circle_m, RAYS)
        views.append(shapely.intersection(shapely.make_valid(shapely.Polygon(ring)).buffer(OFF_M), region))
    chosen: list[int] = []
    for k in sorted(range(len(views)), key=lambda k: views[k].area):
        d = np.hypot(*(places[chosen] - places[k]).T)
        if not views[k].is_empty and d.min(initial=np.inf) >= APART_M:
            chosen.append(k)
    return [views[k] for k in chosen[:MOST]]


def least_ways(world: World, starts: Floats, spec: RobotSpec) -> Floats:
    """(s + k, s + k): bounds of the ways from starts (s, 2) to sets V(p), and between sets; zero between starts.

    The starts are in one region. Rows are the starts, then the sets of the hardest places.
    """
    regions = world.regions(spec.radius_m)
    home = min(range(len(regions)), key=lambda k: regions[k].distance(shapely.Point(starts[0])))
    x0, y0, x1, y1 = regions[home].bounds
    grid = np.meshgrid(np.arange(x0, x1 + LATTICE_M, LATTICE_M), np.arange(y0, y1 + LATTICE_M, LATTICE_M))
    lattice, half_m = np.stack(grid, -1).reshape(-1, 2), LATTICE_M / math.sqrt(2)
    lattice = lattice[shapely.dwithin(regions[home], shapely.points(lattice), half_m)]
    sets, walls = _hardest(world, home, spec), np.ascontiguousarray(world.segments)
    near = [shapely.dwithin(view, shapely.points(lattice), half_m) for view in sets]
    samples = [start[None] for start in starts] + [np.ascontiguousarray(lattice[inside]) for inside in near]
    views = [shapely.Point(start) for start in starts] + sets
    roads = Roads(
        enclosed([ring[:-1] for ring in world.rings]), np.asarray(starts[0], np.float64), OFF_M, node_offset_m=1e-4
    )
    ways = np.array([roads.leave(node).cost for node in roads.nodes])
    to_nodes = np.array([[_between(node[None], points, walls, math.inf) for node in roads.nodes] for points in samples])
    s, n = len(starts), len(samples)
    out = np.zeros((n, n))
    for i in range(n):
        by = (to_nodes[i][:, None] + ways).min(0)  # to every node
        for j in range(max(i + 1, s), n):
            way = float((by + to_nodes[j]).min())
            if shapely.distance(views[i], views[j]) < way:
                way = _between(samples[i], samples[j], walls, way)
            slack = half_m * (2 if i >= s else 1) + BEND_M
            out[i, j] = out[j, i] = max(0.0, way - slack)
    return out


@kernel
def held_karp(cost: Floats, rounds: int = 200) -> float:
    """Lower bound of the shortest open tour through all rows of cost (n, n) from row 0 (Held and Karp 1970, 1971).

    The open end is closed by a place that is next to row 0 and as near to every other. Prices on the places are moved
    towards two neighbours each (subgradient), and the best bound on the way counts.
    """
    n = cost.shape[0]
    if n < 3:
        return float(cost.sum() / 2)
    price = np.zeros(n)
    best, step = 0.0, cost.sum() / (n * (n - 1)) / 4
    for _ in range(rounds):
        # least spanning tree (Prim) and the degree of each place
        degree, inside = np.zeros(n, np.int64), np.zeros(n, np.bool_)
        near, by = np.full(n, math.inf), np.zeros(n, np.int64)
        at, weight = 0, 0.0
        inside[0] = True
        for _ in range(n - 1):
            d = cost[at] + price[at] + price
            nearer = ~inside & (d < near)
            near, by = np.where(nearer, d, near), np.where(nearer, at, by)
            at = int(np.argmin(np.where(inside, math.inf, near)))
            weight += near[at]
            degree[at] += 1
            degree[by[at]] += 1
            inside[at] = True
        # the closing place joins row 0 and the cheapest other one: its price is zero, its ways cost nothing
        last = 1 + np.argmin(price[1:])
        degree[0] += 1
        degree[last] += 1
        best = max(best, weight + price[0] + price[last] - 2.0 * price.sum())
        if (degree == 2).all():
            break
        price += step * (degree - 2)
        step *= 0.97
    return best


@kernel
def best_bound(cost: Floats) -> tuple[float, int]:
    """Greatest bound over subsets of the rows of cost (n, n) with row 0, and their number but for it.

    Rows are added and removed one by one, the one that gains most first, while one gains a centimetre: sets between
    two others may be crossed at no cost, so more of them are not always better.
    """
    n = cost.shape[0]
    used = np.zeros(n, np.bool_)
    used[0] = True
    best = 0.0
    while True:
        top, which = best + 0.01, -1
        for k in range(1, n):
            used[k] = not used[k]
            bound = held_karp(np.ascontiguousarray(cost[used][:, used]), 60)
            used[k] = not used[k]
            if bound > top:
                top, which = bound, k
        if which < 0:
            return best, int(used.sum()) - 1
        best = top
        used[which] = not used[which]


def measure_bound(world: str, seeds: list[int]) -> Figures:
    """Lower bounds in metres for the starts of these seeds, of a robot alone."""
    starts = np.vstack([drawn_starts(world, 1, seed)[:, :2] for seed in seeds])
    cost = least_ways(load(path_of(world)), starts, RobotSpec())
    s = len(starts)
    found = [best_bound(cost[np.ix_(rows, rows)]) for k in range(s) if (rows := [k, *range(s, len(cost))])]
    return {"bound_m": [round(bound, 2) for bound, _ in found], "places": [places for _, places in found]}


def cases(quick: bool) -> list[Case]:
    """One for each layout."""
    return each("tours/{world}/all", measure_bound, {"seeds": list(seeds(quick))}, world=worlds(quick))


def _ratio(bounds: list[float], runs: Runs, key: str) -> float | None:
    """Median of paths over bounds, run by run; None where a run has no such path."""
    ratios = [run[key] / bound for run, bound in zip(runs, bounds, strict=False) if run[key] is not None]
    return float(np.median(ratios)) if len(ratios) == len(bounds) else None


def _rows(figures: Outcomes) -> list[Row]:
    runs, dense = by_label(figures, "runs/{world}/*"), by_label(figures, "dense/{world}/*")
    rows: list[Row] = []
    for world, (found,) in by_label(figures, "tours/{world}/all").items():
        bounds, mine = found["bound_m"], runs.get(world, [])
        row = {"world": world, "places": int(np.median(found["places"])), "bound": float(np.median(bounds))}
        row |= {"to_99": _ratio(bounds, mine, "path_99_m"), "whole": _ratio(bounds, mine, "path_m")}
        rows.append(row | {"dense_99": _ratio(bounds, dense.get(world, []), "path_99_m")})
    return rows


TABLES = [
    Table(
        "tours",
        "Paths over a lower bound of the shortest tour",
        _rows,
        "world; places; bound: bound m; to_99: path to 99 % / bound; whole: whole path / bound; "
        "dense_99: dense to 99 % / bound",
        note="No path that sees all visible wall is shorter than the bound. Medians over the starts.",
    )
]
