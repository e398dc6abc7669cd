"""The map's open ends as goals: which are there, from where they are seen on, and what became of them (ours).

What a teammate has looked at in vain is left to it, to be tried again where the map changes.
"""

import numpy as np

from agent.exploration.agenda import Task, TaskKind, is_end
from agent.exploration.driving import ticks_to_drive
from agent.exploration.frontiers import Ends, open_ends, same_wall, stands_of
from agent.exploration.goal_memory import CLOSINGS, REMEMBERED, SAME_PLACE_M, UNTRIED, GoalMemory, Tried, same_ends
from agent.exploration.planning import Roads
from agent.exploration.surroundings import Scene
from agent.geometry.clearance import distances_to_walls
from protocol.arrays import Bools, Floats, Ints
from protocol.messages import Event, RobotSpec
from protocol.viewpoints import turn_of_end
from protocol.wireframe import Wireframe

REFRESH_M = 0.13  # open ends move with each scan: read in each drive this long, and when the map's structure changes
OTHER_STAND_M = 0.25  # a standing point nearer than this to one that did not help will not help either
BEFORE_BEHIND = 2
"""Standing points that did not help before those behind the wall's line come first. The tip of a wall of 3 cm shows too
few beams to be one, and from before the wall nothing shows its back: a robot left half of such a building unseen."""
STARE_COST = 0.5  # metres of path that a metre from standing point to goal is worth: from nearer more is seen
ROOM_M = 1.7
"""Distance from walls at which a robot whose wheels err looks on, at most half its lidar's range: it sees what stands
in the room, too, which holds it along the wall. One that drove 13 m beside a wall in `hall`, and saw nothing else, had
the next wall 55 mm off. Paths there are 16 instead of 22 mm off (rms, means of five seeds)."""
CRAMPED_COST = 0.8  # metres of path that a metre less of that room is worth: more than the way off the wall costs
WAITS = 6  # times that a robot waits for a teammate that bars a goal, or all of them, before that counts as an attempt
TEAMMATE = "a teammate is in the way"  # the reason why a goal is given up that a teammate bars
MOST_ENDS = 40  # open ends that are goals at a time, the nearest of them: a hostile peer's map may have hundreds
MOST_HEARD_ENDS = 20  # of these, ends of walls that only others saw: no peer crowds out what the robot found itself
LEFT = "a teammate looked at it in vain"  # the reason why a goal is left to a teammate
TOO_MANY = "too many ends stay open"  # ... and why one is not tried


class Goals:
    """The open ends of the map as it was read last, and the memory of what became of them."""

    def __init__(self, attempts: int, spec: RobotSpec) -> None:
        self.attempts, self.spec = attempts, spec
        self.memory = GoalMemory()
        self.ends: Ends = open_ends(Wireframe())
        self.refresh_ticks = ticks_to_drive(REFRESH_M, spec)
        self.in_vain: list[tuple[float, float, int]] = []
        """Open ends that were looked at in vain, for teammates: x, y and the wall's direction as messages have it."""
        self._tried = np.zeros(0, np.int64)  # per open end its record in the memory, or -1
        self._left = np.zeros(0, np.bool_)  # per open end whether it is left to a teammate
        self._all = self.ends, self._left  # the same of all open ends, also of those that are too many
        self._version, self._tick = -1, -1

    @property
    def nbytes(self) -> int:
        """Bytes of what is remembered."""
        return self.memory.nbytes + 24 * len(self.in_vain)

    @property
    def reasons(self) -> list[str]:
        """Per open end of the map, also of those that are too many, why it was given up; empty where it was not."""
        ends, all_left = self._all
        records = self._records(self.memory.find(ends.points, ends.along))
        untried = TOO_MANY if self.memory.is_full else ""
        return [
            record.reason or (LEFT if left else untried if record is UNTRIED else "")
            for record, left in zip(records, all_left, strict=True)
        ]

    def read(self, scene: Scene) -> int:
        """Read the open ends where the map is new or it is time; ticks since the last reading, 0 where none is made."""
        passed = self.refresh_ticks if self._tick < 0 else scene.tick - self._tick
        if scene.version == self._version and passed < self.refresh_ticks:
            return 0
        self._version, self._tick = scene.version, scene.tick
        self.ends = open_ends(scene.wireframe)
        self._recall()
        self.memory.still_open(self._tried)
        # what two robots looked at in vain is both's business: each left it to the other for good
        self._left = (same_ends(self.ends.points, self.ends.along, scene.left_ends) >= 0) & ~self._given_up()
        self._all = self.ends, self._left
        if len(self._tried) > MOST_HEARD_ENDS:
            self._keep_nearest(scene.here)
        return min(passed, self.refresh_ticks)

    def _keep_nearest(self, here: Floats) -> None:
        """Forget open ends that are too many, those far from here (2,) and those that are not fresh first."""
        order = np.lexsort((np.hypot(*(self.ends.points - here).T), ~self._fresh()))
        heard = self.ends.heard[order]
        kept = np.sort(order[~heard | (np.cumsum(heard) <= MOST_HEARD_ENDS)][:MOST_ENDS])
        points, along, free, frontier, heard = self.ends
        self.ends = Ends(points[kept], along[kept], free[kept], frontier[kept], heard[kept])
        self._tried, self._left = self._tried[kept], self._left[kept]

    def _recall(self) -> None:
        """Look up the record of each open end."""
        self._tried = self.memory.find(self.ends.points, self.ends.along)

    def fresh(self) -> Ints:
        """Rows (k,) of the open ends that were never given up, nor looked at by a teammate in vain."""
        return np.flatnonzero(self._fresh())

    def _fresh(self) -> Bools:
        """(g,) which open ends are so, where the memory is full but for those that it would have to make room for."""
        fresh = ~self._given_up() & ~self._left
        return fresh & (self._tried >= 0) if self.memory.is_full else fresh

    def again(self) -> Ints:
        """Rows (k,) of those that were given up, may be tried again, and whose surroundings may have changed since."""
        version, records = self._version, self._records(self._tried)
        again = [record.given_up and not record.unreachable and record.version != version for record in records]
        return np.flatnonzero(np.array(again, np.bool_))

    def _given_up(self) -> Bools:
        """(g,) which open ends were looked at in vain, or given up."""
        return np.array([record.given_up for record in self._records(self._tried)], np.bool_)

    def _records(self, tried: Ints) -> list[Tried]:
        """Per open end, as the memory has found it (k,), what became of it so far."""
        return [self.memory.tried[k] if k >= 0 else UNTRIED for k in tried]

    def end_of(self, task: Task) -> int:
        """The open end that the task is about, or -1."""
        ends = np.hstack((self.ends.points, self.ends.along))
        return int(same_ends(task.place[None], task.along[None], ends)[0])

    def moved(self, task: Task) -> Task | None:
        """The task with its open end as it was read last, None if it is no longer open, or a teammate's business."""
        end = self.end_of(task)
        if end < 0 or self._left[end]:
            return None
        return task._replace(place=self.ends.points[end], along=self.ends.along[end])

    def same(self, one: Task, other: Task) -> bool:
        """Whether two tasks are about the same end, home or wall to look at, or of one kind and seen from one point."""
        if is_end(one) and is_end(other):
            return self.end_of(one) == self.end_of(other) >= 0
        if one.kind in ("home", "look"):
            return one.kind == other.kind and bool(np.hypot(*(one.place - other.place)) < SAME_PLACE_M)
        return one.kind == other.kind and bool((one.stand == other.stand).all())

    def tasks(self, goals: Ints, roads: Roads, begun: Task | None = None, close: bool = False) -> list[Task]:
        """Open ends whose walls can be seen on from a standing point that is reached: one task for each wall.

        goals: rows of ends; begun: the task that the robot is on its way to; close: of `stands_of`.
        """
        once = same_wall(self.ends, 2.0 * self.spec.lidar.range_max_m, SAME_PLACE_M)
        stands = stands_of(self.ends, goals, close)
        good = roads.with_view(stands.points, stands.in_view)
        records = self._records(self._tried)
        behind = ((stands.points - self.ends.points[stands.goal]) * self.ends.free[stands.goal]).sum(1) < 0.0
        for goal in goals:
            of_goal = stands.goal == goal
            for x, y in records[goal].stands:
                again = np.hypot(stands.points[:, 0] - x, stands.points[:, 1] - y) < OTHER_STAND_M
                good &= ~(again & of_goal)
            if len(records[goal].stands) >= BEFORE_BEHIND and (good & of_goal & behind).any():
                good &= ~of_goal | behind
        points, goal_of = stands.points[good], stands.goal[good]
        extra = STARE_COST * np.hypot(*(points - stands.in_view[good]).T)
        if self.spec.odometry.noisy:
            goes_on = self.ends.frontier[goal_of]
            extra[goes_on] += CRAMPED_COST * self._cramped(points[goes_on], roads)
        wall_of = once[goal_of]
        kept = self.end_of(begun) if begun is not None and is_end(begun) else -1
        tasks = []
        for wall in np.unique(wall_of):
            here = np.flatnonzero(wall_of == wall)
            route = roads.nearest(points[here], extra[here])
            if route is not None:
                k = here[route.row]
                place, along, _, frontier, _ = (of_ends[goal_of[k]] for of_ends in self.ends)
                kind: TaskKind = "frontier" if frontier else "occlusion"
                begins = kept >= 0 and bool(once[kept] == wall)
                tasks.append(Task(kind, place, points[k], along, extra_m=float(extra[k]), begun=begins))
        return tasks

    def _cramped(self, points: Floats, roads: Roads) -> Floats:
        """(s,) metres by which each of points (s, 2) is nearer to a wall than one that shows the room, too."""
        room = min(ROOM_M, 0.5 * self.spec.lidar.range_max_m)
        return np.maximum(room - distances_to_walls(points, roads.walls), 0.0)

    def looked(self, task: Task) -> int:
        """Note that a task's end is still open seen from its standing point; how many such points there are."""
        record = self.memory.note(task.place, task.along)
        record.stands.append((float(task.stand[0]), float(task.stand[1])))
        self._recall()
        return len(record.stands)

    def closed(self, task: Task) -> list[Event]:
        """Note that a task's end has closed on the way there; the event that gives it up, where it opens each time."""
        record = self.memory.note(task.place, task.along)
        record.closed += 1
        if record.closed > CLOSINGS:
            return [self.abandon(task.place, task.along, "it opens again and again")]
        self._recall()
        return []

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
        if record.stands and not record.told and len(self.in_vain) < REMEMBERED:
            record.told = True
            x, y = place.tolist()
            self.in_vain.append((x, y, turn_of_end(along)))
        self._recall()
        what = "unreachable" if record.unreachable else "abandoned"
        told = {"what": what, "place": rounded(place), "reason": reason, "attempts": record.attempts}
        return Event(event="frontier", data=told)


def rounded(point: Floats) -> list[float]:
    """A point (2,) for events, in millimetres of precision."""
    return [round(float(point[0]), 3), round(float(point[1]), 3)]
