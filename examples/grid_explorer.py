"""A robot with an occupancy grid: `wireswarm run --mind examples.grid_explorer:GridExplorer --ideal --robots 2`.

It drives to the nearest frontier, which is a free cell beside an unknown one. Whom it hears it sends its whole grid,
compressed by zlib, every ten seconds. It trusts its odometry, and makes nothing of the grids that it hears, since it
cannot know where they lie.
"""

import math
import zlib
from collections import deque
from collections.abc import Iterator, Sequence

import numpy as np

from agent.config import AgentConfig
from agent.shell.mind import OwnMind
from protocol.messages import Heard, Observation, RobotSpec

CELL_M = 0.1
CELLS = 600  # along a side, the start in the middle
UNKNOWN, FREE, WALL = 0, 1, 2
PLAN_TICKS = 5  # between two looks for the nearest frontier
GRID_S = 10.0  # between two grids to a peer in contact

Cell = tuple[int, int]


class GridExplorer(OwnMind):
    """Nearest frontier on a grid."""

    def __init__(self, robot: str, spec: RobotSpec, config: AgentConfig, seed: int) -> None:
        """As all minds."""
        super().__init__(robot, spec, config, seed)
        self.grid = np.zeros((CELLS, CELLS), np.uint8)
        self.path: list[Cell] = []
        self.told: dict[str, int] = {}  # peers and the ticks at which they were last sent the grid

    def drive(self, observation: Observation, heard: Sequence[Heard]) -> tuple[float, float]:
        """One tick: map, talk, choose where to go, drive."""
        tick, (x, y, theta) = observation.tick, observation.odometry
        self.map(observation)
        self.talk(tick, heard)
        if tick % PLAN_TICKS == 0:
            self.path = self.nearest_frontier(self.cell(x, y))
            self.complete = tick > PLAN_TICKS and not self.path
        if not self.path:
            return (0.0, 1.0) if tick <= PLAN_TICKS else (0.0, 0.0)
        ahead = self.path[min(3, len(self.path) - 1)]
        goal_x, goal_y = ((part - CELLS / 2 + 0.5) * CELL_M for part in ahead)
        off = math.remainder(math.atan2(goal_y - y, goal_x - x) - theta, math.tau)
        if self.path[1:] and math.hypot(goal_x - x, goal_y - y) < CELL_M:
            self.path = self.path[1:]
        return (self.spec.max_speed_mps if abs(off) < 0.5 else 0.0), max(-2.0, min(2.0, 2.5 * off))

    def cell(self, x: float, y: float) -> Cell:
        """The cell of a point in the own frame."""
        return int(x / CELL_M + CELLS / 2), int(y / CELL_M + CELLS / 2)

    def map(self, observation: Observation) -> None:
        """Free what the beams passed, and set what they met."""
        x, y, theta = observation.odometry
        ranges, bearings = observation.scan(), self.spec.lidar.bearings() + theta
        met = np.isfinite(ranges)
        reach = np.nan_to_num(ranges, nan=0.0, posinf=0.0)  # a beam that nothing came back of may have met black
        steps = np.arange(0.0, self.spec.lidar.range_max_m, CELL_M / 2)[:, None]
        passed = steps < reach - CELL_M
        self.grid[self.indices(x + steps * np.cos(bearings), y + steps * np.sin(bearings), passed)] = FREE
        self.grid[self.indices(x + reach * np.cos(bearings), y + reach * np.sin(bearings), met)] = WALL

    def indices(self, x: np.ndarray, y: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cells of those points that are chosen."""
        i, j = (np.clip(part[chosen] / CELL_M + CELLS / 2, 0, CELLS - 1).astype(int) for part in (x, y))
        return i, j

    def nearest_frontier(self, start: Cell) -> list[Cell]:
        """The cells to the nearest frontier, by breadth-first search with room for the body; empty without one."""
        near_wall = self.grid == WALL
        for _ in range(math.ceil(self.spec.radius_m / CELL_M)):
            near_wall = grown(near_wall)
        frontier = (self.grid == FREE) & grown(self.grid == UNKNOWN) & ~near_wall
        open_ = (self.grid == FREE) & ~near_wall
        came, queue = {start: start}, deque([start])
        while queue:
            cell = queue.popleft()
            if frontier[cell] and cell != start:
                path = [cell]
                while path[-1] != start:
                    path.append(came[path[-1]])
                return path[::-1]
            for other in around(cell):
                if other not in came and (open_[other] or (len(came) < 30 and self.grid[other] != WALL)):
                    came[other] = cell
                    queue.append(other)
        return []

    def talk(self, tick: int, heard: Sequence[Heard]) -> None:
        """Say who is there once a second, and send the grid to whom was heard."""
        if tick % round(self.spec.lidar.rate_hz) == 0:
            self.send("hello", self.robot.encode())
        for message in heard:
            last = self.told.get(message.sender)
            if last is None or tick - last >= GRID_S * self.spec.lidar.rate_hz:
                self.told[message.sender] = tick
                known = np.argwhere(self.grid != UNKNOWN)
                (i, j), (to_i, to_j) = known.min(0), known.max(0) + 1
                data, mtu = zlib.compress(self.grid[i:to_i, j:to_j].tobytes(), 9), self.spec.radio_mtu_bytes
                for at in range(0, len(data), mtu):
                    self.send("grid", data[at : at + mtu], message.sender)


def grown(mask: np.ndarray) -> np.ndarray:
    """The mask and the four neighbours of each cell in it."""
    out: np.ndarray = mask.copy()
    out[1:] |= mask[:-1]
    out[:-1] |= mask[1:]
    out[:, 1:] |= mask[:, :-1]
    out[:, :-1] |= mask[:, 1:]
    return out


def around(cell: Cell) -> Iterator[Cell]:
    """Its four neighbours within the grid."""
    i, j = cell
    return ((k, m) for k, m in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)) if 0 <= k < CELLS and 0 <= m < CELLS)
