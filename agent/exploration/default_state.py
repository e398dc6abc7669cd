"""What a robot does when no frontier is left: the four default states of the paper (IV-B), and ours. All end."""

import itertools
import math

import numpy as np

from agent.exploration.agenda import Task, agenda_of, first_of_tour
from agent.exploration.auction import own_share
from agent.exploration.config import ExplorationConfig
from agent.exploration.frontiers import stands_at_edges
from agent.exploration.glimpses import Glimpses
from agent.exploration.goal_memory import GoalMemory
from agent.exploration.path import length_of
from agent.exploration.planning import Roads, circle
from agent.exploration.surroundings import Scene
from agent.exploration.sweep import Sweep, Viewpoints
from agent.geometry.chains import chains_of
from protocol.arrays import Floats
from protocol.messages import LidarSpec
from protocol.walls import lengths, neighbours
from protocol.wireframe import Wireframe

POCKET_REACH_M = 5.0  # distance to either side within which pockets are looked for: two rooms
VERTEX_VISITS = 10  # random vertices visited in a row that showed no new wall: then the state ends
MOST_VERTEX_VISITS = 100  # ... and in all: walls that noise makes of nothing are new, too
_OFF_M = 0.5  # distance from which a vertex is looked at, and of the points visited along the perimeter from its walls
_PERIMETER_STEP_M = 1.5  # distance between these points; from each, 3.5 m of wall to either side are in view


class DefaultStates:
    """The configured default state, which proposes tasks until it has none."""

    def __init__(self, config: ExplorationConfig, sweep: Sweep, lidar: LidarSpec, rng: np.random.Generator) -> None:
        self.config, self.sweep, self.rng = config, sweep, rng
        self.glimpses = Glimpses(lidar)
        self._edges = GoalMemory()
        self._lap: Floats | None = None
        self._in_vain, self._visits = 0, 0  # random vertices visited since there was a new wall, and in all
        self._most_wall_m = 0.0  # of all maps until then

    @property
    def nbytes(self) -> int:
        """Bytes of what is kept beside the sweep."""
        lap = 0 if self._lap is None else self._lap.nbytes
        return self.glimpses.nbytes + self._edges.nbytes + lap

    def next(self, scene: Scene, roads: Roads, viewpoints: Viewpoints) -> Task | None:
        """The next task, None at the state's end."""
        state = self.config.default_state
        if state == "perimeter":
            return self._perimeter(scene.wireframe, roads)
        if state == "random-vertex":
            return self._random_vertex(scene, roads)
        task = None if state == "least-likely" else self._sweep(scene, roads, viewpoints)
        return task if task or state == "interior-sweep" else self._least_likely(scene.wireframe, roads)

    def ended(self) -> str:
        """Why there is nothing left to do."""
        return {
            "ours": "no frontier left, all free area seen, every edge likely or looked at",
            "interior-sweep": "no frontier left, all free area seen",
            "least-likely": "no frontier left, every edge likely or looked at",
            "perimeter": "no frontier left, perimeter followed",
            "random-vertex": "no frontier left, random vertices showed nothing new",
        }[self.config.default_state]

    def done(self, task: Task) -> None:
        """The task is not to be proposed again: the robot stood where it asked, or could not."""
        if task.kind == "sweep":
            self.sweep.stood(task.stand)
        elif task.kind == "glimpse":
            self.glimpses.done(task)
        elif task.kind == "edge":
            self._edges.note(task.place, task.along).attempts += 1
        elif task.kind == "vertex":
            self._in_vain += 1
            self._visits += 1
        elif task.kind == "perimeter" and self._lap is not None:
            self._lap = self._lap[(self._lap != task.place).any(1)]

    def pockets(self, scene: Scene, roads: Roads, viewpoints: Viewpoints, begun: Task | None) -> list[Task]:
        """Sweeps, while there are frontiers, of what was seen from too far; begun: the task under way."""
        if not self.config.pockets or self.config.default_state not in ("ours", "interior-sweep"):
            return []
        samples = self.sweep.passed_by(scene.wireframe, viewpoints, scene.here, POCKET_REACH_M)
        return self.sweep.tasks(samples, roads, begun.stand if begun is not None and begun.kind == "sweep" else None)

    def _sweep(self, scene: Scene, roads: Roads, viewpoints: Viewpoints) -> Task | None:
        """First of a short tour of the standing points that show all that is unseen, and are left to no teammate.

        What was glimpsed from too far counts as unseen.
        """
        tasks = self.sweep.tasks(self.sweep.unseen(scene.wireframe, viewpoints), roads)
        tasks += self.glimpses.tasks(scene.wireframe, roads)
        if not tasks:
            return None
        agenda = agenda_of(tasks, roads)
        mine = own_share(agenda, roads, scene.partners, scene.silent)
        return first_of_tour(mine if mine.tasks else agenda, math.inf, self.config.haste)  # nobody idles

    def _least_likely(self, wireframe: Wireframe, roads: Roads) -> Task | None:
        """Edges below the threshold, the least likely first [paper]; each is looked at as often as a goal is tried."""
        for k in np.argsort(wireframe.likelihood, kind="stable"):
            if wireframe.likelihood[k] >= self.config.least_likelihood:
                break
            a, b = wireframe.points[wireframe.edges[k]]
            middle, along = 0.5 * (a + b), (b - a) / max(math.hypot(*(b - a)), 1e-9)
            if not self._edges.has_room(middle, along, self.config.attempts):
                continue
            stands = stands_at_edges(wireframe, np.array([k]))
            good = roads.with_view(stands.points, stands.in_view)
            route = roads.nearest(stands.points[good], np.zeros(int(good.sum())))
            if route is not None:
                return Task("edge", middle, route.path[-1], along)
        return None

    def _random_vertex(self, scene: Scene, roads: Roads) -> Task | None:
        """Vertices at random [paper], until so many showed no new wall. None where all that are drawn are out of reach.

        As many are drawn as may still be visited in vain. A wall is new where there is more of it than ever, by the
        smallest object: corners move by centimetres with each visit, and faces of that size go and come back.
        """
        wall_m = float(lengths(scene.wireframe.segments()).sum())
        if wall_m >= self._most_wall_m + self.config.smallest_object_m:
            self._most_wall_m, self._in_vain = wall_m, 0
        for _ in range(min(VERTEX_VISITS - self._in_vain, MOST_VERTEX_VISITS - self._visits)):
            points = scene.wireframe.points
            point = points[int(self.rng.integers(len(points)))]
            around = point + _OFF_M * circle(12)
            around = around[roads.standable(around)]
            route = roads.nearest(around, np.zeros(len(around)))
            if route is not None:
                return Task("vertex", point, route.path[-1])
        return None

    def _perimeter(self, wireframe: Wireframe, roads: Roads) -> Task | None:
        """Once around, along the longest chain of walls [paper: the outer perimeter]."""
        if self._lap is None:
            self._lap = _lap(wireframe)
        left = self._lap[roads.standable(self._lap)]
        left = left[roads.reached(left)]
        return Task("perimeter", left[0], left[0]) if len(left) else None


def _lap(wireframe: Wireframe) -> Floats:
    """Points (k, 2) off the longest chain, in its order."""
    chains = chains_of(*neighbours(wireframe.edges, len(wireframe.points)))
    longest: Floats = max((wireframe.points[chain] for chain in chains), key=length_of)
    points = []
    for p, q in itertools.pairwise(longest):
        d = q - p
        length = math.hypot(*d)
        n = max(1, math.ceil(length / _PERIMETER_STEP_M))
        free = np.array((-d[1], d[0])) / max(length, 1e-9)
        points += [p + d * (k + 0.5) / n + _OFF_M * free for k in range(n)]
    return np.array(points).reshape(-1, 2)
