"""A dense baseline: nearest frontier (Yamauchi 1997) on an occupancy grid of 5 cm.

Body and drive control are those of our robot, and sensing is ideal: the grid corrects no pose. A frontier is a group of
free cells beside unknown ones. The robot drives to the one that is nearest by path over free cells, inflated by its
body, and chooses anew every second, as explore_lite does. It gives up frontiers that stay though it came near, and ends
without any.
"""

import heapq
import math
import time
import zlib
from collections.abc import Sequence
from functools import partial
from itertools import chain

import numpy as np

from agent.config import AgentConfig
from agent.exploration.driving import Driver, Obstacles
from agent.kernels import kernel
from agent.perception.perceive import perceive
from agent.robot import Step
from deploy.bench.cases import Case, Figures, each
from deploy.bench.exploration.runs import LIMIT_S, seeds, worlds
from deploy.bench.explored import explore, mute_step
from deploy.bench.layouts import path_of
from deploy.bench.tables import Outcomes, Row, Runs, Table, by_label, median, most
from deploy.occupancy_grid import OccupancyGrid
from deploy.sensing import IDEAL
from protocol.arrays import Bools, Floats, Ints
from protocol.geometry import Pose, apply
from protocol.messages import Action, Heard, Observation, RobotSpec
from world.lidar.lidar import Lidar
from world.worldfile import load

CELL_M = 0.05
ROOMY_M, TIGHT_M = 0.2, 0.15
"""Cells nearer than this to an occupied one are not driven through: our paths' two clearances and half a cell. The
tight one counts where there is no roomy way. Nearer cells are no frontiers either, as in explore_lite's costmap."""
LEAST_CELLS = 4  # smaller groups are no frontiers: slivers between beams; a doorway of 0.5 m shows four cells
GIVEN_UP_M = 0.6  # of a frontier that is given up, cells this near to the one driven to are no frontier any more
LEAVE_M = 0.3  # a robot that stands where it may not drive crosses cells up to this far to leave
REPLAN_TICKS = 5
PATIENCE_TICKS = 25  # a frontier is given up when the robot came no nearer to it and saw nothing new for so long
FAR_TICKS = 600  # a goal is also given up after two minutes (26 m) without news, as two may come nearer in turns
NEWS_CELLS = 10  # as many cells that became known are something new
BLIND_M = 0.2  # silent beams beside a nearer return are not free, but at a wall: the lidar is blind below 0.12 m
MOST_RATIO = 1.1  # bar of our path to 99 % of the wall over the dense robot's


@kernel
def _frontiers(log_odds: Floats, candidates: Bools, least: int) -> Bools:
    """Those of the candidates that lie beside unknown cells, in 8-connected groups of at least so many."""
    unknown, edge, out = log_odds == 0.0, np.zeros(log_odds.shape, np.bool_), np.zeros(log_odds.shape, np.bool_)
    beside = unknown[:-2, 1:-1] | unknown[2:, 1:-1] | unknown[1:-1, :-2] | unknown[1:-1, 2:]
    edge[1:-1, 1:-1] = candidates[1:-1, 1:-1] & beside
    for i0, j0 in np.argwhere(edge):
        if not edge[i0, j0]:
            continue  # in an earlier group
        edge[i0, j0] = False
        group, k = [(i0, j0)], 0
        while k < len(group):
            i, j = group[k]
            k += 1
            for a in range(i - 1, i + 2):
                for b in range(j - 1, j + 2):
                    if edge[a, b]:
                        edge[a, b] = False
                        group.append((a, b))
        if len(group) >= least:
            for i, j in group:
                out[i, j] = True
    return out


def _grown(cells: Bools, radius: float) -> Bools:
    """All cells whose middle is nearer than the radius (in cells) to that of a given one."""
    r = math.ceil(radius)
    disc = np.hypot(*np.mgrid[-r : r + 1, -r : r + 1]) < radius
    padded, (nx, ny) = np.pad(cells, r), cells.shape
    grown: Bools = np.any([padded[a : a + nx, b : b + ny] for a, b in np.argwhere(disc)], 0)
    return grown


def _heard(ranges: Floats, blind: float) -> Floats:
    """Ranges (beams,), nan where silence may come of a wall too near to be seen."""
    out, silent = ranges.copy(), np.flatnonzero(~np.isfinite(ranges))
    if len(known := np.flatnonzero(np.isfinite(ranges))):
        after = np.searchsorted(known, silent)
        beside = np.minimum(ranges[known[after - 1]], ranges[known[after % len(known)]])
        out[silent[beside < blind]] = math.nan
    return out


@kernel
def _way(free: Bools, goals: Bools, i0: int, j0: int, leave: float) -> Ints:
    """Cells (k, 2) of the shortest way over free cells to the nearest goal (Dijkstra, 8 neighbours); empty if none.

    Cells within `leave` of the start may be driven over though they are not free, at ten times the cost.
    """
    nx, ny = free.shape
    cost, before = np.full((nx, ny), math.inf), np.full((nx, ny), -1)
    cost[i0, j0] = 0.0
    queue = [(0.0, i0, j0)]
    while len(queue):
        d, i, j = heapq.heappop(queue)
        if d > cost[i, j]:
            continue
        if goals[i, j] and free[i, j]:
            way = [(i, j)]
            while before[i, j] >= 0:
                i, j = before[i, j] // ny, before[i, j] % ny
                way.append((i, j))
            return np.array(way[::-1])
        for a in range(max(0, i - 1), min(nx, i + 2)):
            for b in range(max(0, j - 1), min(ny, j + 2)):
                step = math.hypot(a - i, b - j)
                if not free[a, b]:
                    if (a - i0) ** 2 + (b - j0) ** 2 > leave * leave:
                        continue
                    step *= 10.0
                if d + step < cost[a, b]:
                    cost[a, b] = d + step
                    before[a, b] = i * ny + j
                    heapq.heappush(queue, (d + step, a, b))
    return np.empty((0, 2), np.int64)


def _straight(free: Bools, start: Ints, end: Ints) -> bool:
    """Whether the straight way between two cells (2,) is free, looked at every third of a cell."""
    cells = np.linspace(start, end, 3 * max(int(np.abs(end - start).max()), 1) + 1).round().astype(int)
    return bool(free[tuple(cells.T)].all())


def _pulled(free: Bools, way: Ints) -> Ints:
    """The way without waypoints that can be passed straight."""
    kept = [0]
    while kept[-1] < len(way) - 1:
        k = len(way) - 1
        while k > kept[-1] + 1 and not _straight(free, way[kept[-1]], way[k]):
            k -= 1
        kept.append(k)
    return way[kept]


class DenseRobot:
    """A mind that maps and plans on the grid."""

    def __init__(self, robot: str, spec: RobotSpec, config: AgentConfig, seed: int, reach_m: float) -> None:
        """reach_m: the grid's half width around the start."""
        self.spec, self.config = spec, config
        self.driver = Driver(config.driving, spec)
        n = 2 * math.ceil(reach_m / CELL_M)
        self.corner = -CELL_M * n / 2
        box = self.corner, self.corner, -self.corner, -self.corner
        self.lidar = Lidar(np.zeros((0, 4)), spec.lidar)
        self.grid = OccupancyGrid(box, CELL_M, spec.lidar.range_max_m)
        self.log_odds = self.grid.log_odds
        self.given_up = np.zeros(self.log_odds.shape, np.bool_)
        self.path: Floats | None = None
        self.complete, self.clearance = False, 0.0
        self._known_cells, self._steps, self._vain, self._nothing = 0, 0, 0, 0
        self._goal = np.zeros(2)

    def _known(self) -> tuple[slice, slice]:
        """The box of cells that are known, and one around it."""
        known = np.argwhere(self.log_odds)
        (i0, j0), (i1, j1) = np.maximum(0, known.min(0) - 1).tolist(), (known.max(0) + 2).tolist()
        return slice(i0, i1), slice(j0, j1)

    def grid_bytes(self) -> tuple[int, int]:
        """Bytes of the known box at one byte a cell, and of its three states after zlib."""
        states = np.sign(self.log_odds[self._known()]).astype(np.int8)
        return states.size, len(zlib.compress(states.tobytes(), 9))

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
        """Map, plan, drive."""
        started = time.perf_counter()
        pose, ranges = observation.odometry, observation.scan()
        self.grid.add(_heard(ranges, BLIND_M)[None], self.lidar.rays(np.array(pose)))
        if not self.complete and observation.tick % REPLAN_TICKS == 0:
            self._plan(pose)
        scan = perceive(ranges, self.spec, self.config.perception.method).wireframe()
        walls = np.ascontiguousarray(apply(pose, scan.points)[scan.edges].reshape(-1, 4))
        speed = turn = 0.0
        if self.path is not None:
            motion = self.driver.follow(self.path, pose, Obstacles(walls, np.zeros((0, 2))), self.clearance)
            speed, turn = motion.speed_mps, motion.turn_rps
        tick, step_ms = observation.tick, 1e3 * (time.perf_counter() - started)
        action = Action(tick=tick, speed_mps=speed, turn_rps=turn, complete=self.complete, step_ms=step_ms)
        return mute_step(action, pose)

    def _plan(self, pose: Pose) -> None:
        box = self._known()
        log_odds = np.ascontiguousarray(self.log_odds[box])
        i, j = (math.floor((at - self.corner) / CELL_M) - part.start for at, part in zip(pose, box, strict=False))
        roomy, tight = ((log_odds < 0) & ~_grown(log_odds > 0, room_m / CELL_M) for room_m in (ROOMY_M, TIGHT_M))
        while True:
            frontiers = _frontiers(log_odds, tight & ~self.given_up[box], LEAST_CELLS)
            for free, room_m in ((roomy, ROOMY_M), (tight, TIGHT_M)):
                self.clearance = room_m - CELL_M
                way = _way(free, frontiers, i, j, LEAVE_M / CELL_M)
                if len(way):
                    break
            else:  # no frontier left, or none that can be reached
                self.complete, self.path = True, None
                return
            goal = self._at(way[-1], box)
            if not self._in_vain(int(np.count_nonzero(log_odds)), len(way), goal):
                break
            end = np.zeros(log_odds.shape, np.bool_)
            end[tuple(way[-1])] = True
            self.given_up[box] |= frontiers & _grown(end, GIVEN_UP_M / CELL_M)
        free[i, j] = True
        path = self._at(_pulled(free, way), box)
        path[0] = pose[:2]
        self.path = path if len(path) > 1 else np.vstack((path, path))

    def _at(self, cells: Ints, box: tuple[slice, slice]) -> Floats:
        """Middles of cells (..., 2) of the box."""
        middles: Floats = self.corner + CELL_M * (cells + np.array((box[0].start + 0.5, box[1].start + 0.5)))
        return middles

    def _in_vain(self, known: int, steps: int, goal: Floats) -> bool:
        """Whether the goal is neither nearer nor anything new seen for its patience, or nothing new for far longer."""
        if known >= self._known_cells + NEWS_CELLS:
            self._known_cells, self._steps, self._vain, self._nothing = known, steps, 0, 0
        elif steps < self._steps or math.hypot(*(goal - self._goal)) > GIVEN_UP_M:
            self._steps, self._vain = steps, 0
        self._goal = goal
        self._vain += REPLAN_TICKS
        self._nothing += REPLAN_TICKS
        if self._vain <= PATIENCE_TICKS and self._nothing <= FAR_TICKS:
            return False
        self._steps, self._vain, self._nothing = steps, 0, 0
        return True


def measure_dense(world: str, seed: int) -> Figures:
    """One run of the dense robot, from the start that ours has in `runs`."""
    x0, y0, x1, y1 = load(path_of(world)).solid.bounds
    reach_m = math.hypot(x1 - x0, y1 - y0) + RobotSpec().lidar.range_max_m
    settings = {"world": world, "robots": 1, "seed": seed, "starts": "random", "max_time_s": LIMIT_S, "spec": IDEAL}
    run = explore(settings, {}, make_mind=partial(DenseRobot, reach_m=reach_m))
    raw, packed = run.robots["r1"].grid_bytes()
    figures: Figures = run.summary["robots"]["r1"] | run.driven.until["r1"]
    return figures | {"grid_bytes": raw, "grid_zlib_bytes": packed}


def cases(quick: bool) -> list[Case]:
    """The dense robot from the same starts as ours in `runs`."""
    return each("dense/{world}/{seed}", measure_dense, seed=seeds(quick), world=worlds(quick))


def _compared(mine: Runs, theirs: Runs) -> Row:
    """Our and the dense paths to 99 % of starts where both got so far, and of how many starts each did."""
    both = [(a["path_99_m"], b["path_99_m"]) for a, b in zip(mine, theirs, strict=True)]
    reached = [(a, b) for a, b in both if a is not None and b is not None]
    shares = f"{sum(a is not None for a, _ in both)} / {sum(b is not None for _, b in both)}"
    if not reached:
        return {"path": None, "dense_path": None, "ratio": None, "reached": shares}
    path, dense_path = np.median(reached, 0).tolist()
    ratio = sum(a for a, _ in reached) / sum(b for _, b in reached)
    return {"path": path, "dense_path": dense_path, "ratio": ratio, "reached": shares}


def _rows(figures: Outcomes) -> list[Row]:
    """Ours and the dense one, of starts that both have, a row a layout and one for all."""
    pairs = dict[str, tuple[list[Figures], list[Figures]]]()
    for start, (dense,) in by_label(figures, "dense/{start}").items():
        if ours := figures.get(f"runs/{start}"):
            mine, theirs = pairs.setdefault(start.partition("/")[0], ([], []))
            mine.append(ours)
            theirs.append(dense)
    rows: list[Row] = []
    for world, (mine, theirs) in pairs.items():
        row = {"world": world, **_compared(mine, theirs), "dense_contacts": most(theirs, "wall_contacts")}
        row |= {"path_90": median(mine, "path_90_m"), "dense_path_90": median(theirs, "path_90_m")}
        row |= {key: median(mine, key) for key in ("map_bytes", "filter_bytes")}
        rows.append(row | {key: median(theirs, key) for key in ("grid_bytes", "grid_zlib_bytes")})
    every = [list(chain.from_iterable(runs)) for runs in zip(*pairs.values(), strict=True)]
    return [*rows, {"world": "all", **_compared(*every)}] if rows else []


TABLES = [
    Table(
        "dense",
        "Ours and nearest frontier on a grid of 5 cm",
        _rows,
        f"world; path_90: m to 90 %; dense_path_90: dense; path: m to 99 %; dense_path: dense; "
        f"ratio <= {MOST_RATIO}: ours / dense; reached: 99 % reached; map_bytes: map B; filter_bytes: filter B; "
        "grid_bytes: grid B; grid_zlib_bytes: grid zlib B; dense_contacts: dense wall contacts",
        judged=lambda row: row["world"] == "all",  # a world has few starts from which the dense one sees 99 % at all
        note="Medians: of paths to 99 % over starts where both reached it, to 90 % over all; the ratio is of the sums "
        "of those to 99 %. Reached: ours / dense. The bar is that of all worlds together. Grid: one byte a cell of the "
        "box that is known. The dense robot's sensing is ideal.",
    )
]
