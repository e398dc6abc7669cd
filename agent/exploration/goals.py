"""The map's open ends as goals: which are there, from where they are seen on, and what became of them (ours)."""

import math

import numpy as np

from agent.exploration.agenda import Task, is_end
from agent.exploration.frontiers import Ends, open_ends, same_wall, stands_of
from agent.exploration.goal_memory import SAME_DIRECTION_RAD, SAME_PLACE_M, GoalMemory
from agent.exploration.planning import Roads
from agent.exploration.surroundings import Scene
from agent.geometry.visibility import all_seen
from protocol.arrays import Floats, Ints
from protocol.messages import Event, RobotSpec
from protocol.wireframe import Wireframe

REFRESH_S = 0.6
"""Open ends are read from the map this often besides at changes of structure, as they move with each scan."""
OTHER_STAND_M = 0.25
"""A standing point nearer than this to one that did not help will not help either."""
STARE_COST = 0.5
"""Metres of path that a metre of distance between standing point and goal is worth: nearer sees better."""
WAITS = 6
"""Times that a robot waits for a teammate that bars a goal, or all of them, before that counts as an attempt."""
TEAMMATE = "a teammate is in the way"
"""The reason why a goal is given up that a teammate bars."""


class Goals:
    """The open ends of the map as it was read last, and the memory of those that were given up."""

    def __init__(self, attempts: int, spec: RobotSpec) -> None:
        self.attempts = attempts
        self.spec = spec
        self.memory = GoalMemory()
        self.ends: Ends = open_ends(Wireframe())
        self.refresh_ticks = round(REFRESH_S * spec.lidar.rate_hz)
        self._tried = np.zeros(0, np.int64)
        """Per open end its record in the memory, or -1."""
        self._version, self._tick = -1, -1

    @property
    def reasons(self) -> list[str]:
        """Per open end why it was given up; empty where it was not."""
        found = self.memory.find(self.ends.points, self.ends.along)
        return [self.memory.tried[k].reason if k >= 0 else "" for k in found]

    @property
    def given_up(self) -> int:
        """How many open ends were given up."""
        return int(np.count_nonzero(self._tried >= 0))

    def read(self, scene: Scene) -> int:
        """Read the open ends where the map is new or it is time; ticks for which this reading stands, 0 without."""
        passed = self.refresh_ticks if self._tick < 0 else scene.tick - self._tick
        if scene.version == self._version and passed < self.refresh_ticks:
            return 0
        self._version, self._tick = scene.version, scene.tick
        self.ends = open_ends(scene.wireframe)
        self._recall()
        return min(passed, self.refresh_ticks)

    def _recall(self) -> None:
        self._tried = self.memory.find(self.ends.points, self.ends.along)

    def fresh(self) -> Ints:
        """Open ends that were never given up."""
        return np.flatnonzero(self._tried < 0)

    def again(self) -> Ints:
        """Open ends that were given up, may be tried again, and whose surroundings may have changed since."""
        records = self.memory.tried
        goals = [
            goal
            for goal, k in enumerate(self._tried)
            if k >= 0 and not records[k].unreachable and records[k].version != self._version
        ]
        return np.array(goals, np.int64)

    def end_of(self, task: Task) -> int:
        """The open end that the task is about, or -1."""
        if not len(self.ends.points):
            return -1
        d = np.hypot(*(self.ends.points - task.place).T)
        d[self.ends.along @ task.along < math.cos(SAME_DIRECTION_RAD)] = np.inf
        k = int(d.argmin())
        return k if d[k] < SAME_PLACE_M else -1

    def moved(self, task: Task) -> Task | None:
        """The task with its open end as it was read last, None if it is no longer open."""
        end = self.end_of(task)
        return None if end < 0 else task._replace(place=self.ends.points[end], along=self.ends.along[end])

    def same(self, one: Task, other: Task) -> bool:
        """Whether two tasks are about the same end, or otherwise of one kind and seen from the same point."""
        if is_end(one) and is_end(other):
            return self.end_of(one) == self.end_of(other) >= 0
        return one.kind == other.kind and bool((one.stand == other.stand).all())

    def tasks(self, goals: Ints, roads: Roads, begun: Task | None = None, close: bool = False) -> list[Task]:
        """Open ends that can be seen on from a standing point that is reached: one task for each wall.

        goals: rows of ends; begun: the task that the robot is on its way to; close: of `stands_of`.
        """
        once = same_wall(self.ends, 2.0 * self.spec.lidar.range_max_m, SAME_PLACE_M)
        stands = stands_of(self.ends, goals, close)
        good = roads.standable(stands.points) & all_seen(stands.points, stands.targets, roads.walls)
        for goal in goals[self._tried[goals] >= 0]:
            for x, y in self.memory.tried[self._tried[goal]].stands:
                again = np.hypot(stands.points[:, 0] - x, stands.points[:, 1] - y) < OTHER_STAND_M
                good &= ~(again & (stands.goal == goal))
        points, goal_of = stands.points[good], stands.goal[good]
        extra = STARE_COST * np.hypot(*(points - stands.targets[good]).T)
        wall_of = once[goal_of]
        kept = self.end_of(begun) if begun is not None and is_end(begun) else -1
        tasks = []
        for wall in np.unique(wall_of):
            here = np.flatnonzero(wall_of == wall)
            route = roads.nearest(points[here], extra[here])
            if route is not None:
                k = here[route.goal]
                goal = int(goal_of[k])
                kind = "frontier" if self.ends.frontier[goal] else "occlusion"
                tasks.append(
                    Task(
                        kind,  # type: ignore[arg-type]
                        self.ends.points[goal],
                        points[k],
                        self.ends.along[goal],
                        extra_m=float(extra[k]),
                        begun=kept >= 0 and bool(once[kept] == wall),
                    )
                )
        return tasks

    def looked(self, task: Task) -> int:
        """Note that a task's end is still open seen from its standing point; how many such points there are."""
        record = self.memory.note(task.place, task.along)
        record.stands.append((float(task.stand[0]), float(task.stand[1])))
        self._recall()
        return len(record.stands)

    def abandon(self, place: Floats, along: Floats, reason: str) -> Event:
        """Give up the open end at a place (2,), whose wall goes on along (2,); the event that says so."""
        record = self.memory.note(place, along)
        record.version, record.reason = self._version, reason
        if reason == TEAMMATE and record.blocked < WAITS:
            record.blocked += 1
            record.version = -1
        else:
            record.attempts += 1
        record.unreachable = record.attempts >= self.attempts
        self._recall()
        what = "unreachable" if record.unreachable else "abandoned"
        return told("frontier", what=what, place=rounded(place), reason=reason, attempts=record.attempts)


def told(event: str, **data: object) -> Event:
    """An event with its data."""
    return Event(event=event, data=data)


def rounded(point: Floats) -> list[float]:
    """A point (2,) for events, in millimetres of precision."""
    return [round(float(point[0]), 3), round(float(point[1]), 3)]
