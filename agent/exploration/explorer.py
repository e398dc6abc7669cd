"""Where a robot goes: frontiers first, then the default state, until nothing is left to see (paper IV, Algorithm 1).

Where the paper is silent the rules are ours: goals have a memory, all trying and waiting is bounded, and `complete`
is a state that a new frontier ends.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from agent.errand import ErrandEnd
from agent.exploration.agenda import Task, first_of_tour, is_end, not_nearer_to
from agent.exploration.config import DrivingConfig, ExplorationConfig, PlanningConfig
from agent.exploration.default_state import DefaultStates
from agent.exploration.driving import Driver, Motion
from agent.exploration.frontiers import Ends, GoalMemory, open_ends, same_wall, stands_of
from agent.exploration.planning import Roads, still_clear
from agent.exploration.sweep import Sweep
from agent.exploration.teammates import Teammates
from agent.geometry.clearance import distances_to_walls, keeps_clear
from agent.geometry.visibility import all_seen
from protocol.arrays import Floats, Ints
from protocol.geometry import Pose, apply
from protocol.messages import Event, RobotSpec
from protocol.wireframe import Wireframe

_NEAR_M = 1.5
"""Walls within this of the robot matter for the next ticks; it drives 0.09 m in two."""
_WAYPOINT_M = 0.03
"""A waypoint this near is passed."""
_PUSHED = 0.3
"""Who gets on by less than this share of what was commanded pushes against something."""
_BARRIER_M = 0.12
"""Half the width of what is taken for the unseen wall: the body's."""
_NEVER = 2**62
_AROUND = 8
"""Directions in which a standing point near an errand's place is looked for."""
_TEAMMATE = "a teammate is in the way"


class Configs(NamedTuple):
    """What an explorer is configured by."""

    exploration: ExplorationConfig
    planning: PlanningConfig
    driving: DrivingConfig


class Situation(NamedTuple):
    """What the robot knows in a tick. Metres and radians; the robot's own frame, if nothing else is said."""

    tick: int
    wireframe: Wireframe
    """The map."""
    version: int
    """Greater whenever the map changed structurally."""
    pose: Pose
    scan: Wireframe
    """Corners and walls seen now, frame of the robot's pose."""
    discs: Floats
    """(k, 2) centres of teammates seen now, frame of the robot's pose."""
    errand: Floats | None = None
    """(2,) where the robot is sent to verify a proposal."""
    rivals: Floats = np.zeros((0, 3))
    """(k, 3) places of teammates that share the work, and metres by which each must be nearer to have a goal."""
    viewpoints: Floats = np.zeros((0, 2))
    """(j, 2) places from where teammates have looked whose maps are merged."""


class Command(NamedTuple):
    """What the robot does in the next tick, and why."""

    speed_mps: float
    turn_rps: float
    complete: bool
    reason: str
    """The state in a few words."""
    events: list[Event]
    target: tuple[float, float] | None
    """Where it is going, frame of the map."""
    ended: ErrandEnd | None = None
    """How the errand ended in this tick; None while it is under way or there is none."""


@dataclass(slots=True)
class Target:
    """The task under way."""

    task: Task
    path: Floats
    """(k, 2) from the robot to the standing point."""
    clearance: float
    """Distance that the path keeps from walls, metres."""
    deadline: int
    """Tick at which it is given up."""
    looks_due: int
    """Scans to be taken at the standing point."""
    looks: int = 0
    """... and taken."""
    stands: int = 1
    """Standing points tried, this one included."""
    stuck: int = 0
    """How often the robot stuck on the way."""


class Explorer:
    """One robot's choice of goals, on its sparse map alone."""

    def __init__(self, config: Configs, spec: RobotSpec, rng: np.random.Generator) -> None:
        self.config = config.exploration
        self.planning = config.planning
        self.spec = spec
        self.rng = rng
        self.tick_s = config.driving.tick_s
        self.driver = Driver(config.driving, spec)
        self.memory = GoalMemory(self.config)
        self.sweep = Sweep(self.config, spec.lidar)
        self.states = DefaultStates(self.config, self.sweep, rng)
        self.teammates = Teammates(self.config, spec.radius_m, self.tick_s)
        self.poses: list[tuple[float, float]] = []
        """Own standing points so far, about every half metre: what was seen, kept sparsely."""
        self.pose_ticks: list[int] = []
        """When the robot was there."""
        self.viewpoints = np.zeros((0, 2))
        """(k, 2) those of teammates whose maps are merged."""
        self.complete = False
        self.target: Target | None = None
        self.ends: Ends = open_ends(Wireframe())
        self._tried = np.zeros(0, np.int64)
        """Per open end its record in the memory, or -1."""
        self.errand: Floats | None = None
        """(2,) where the robot is sent, before all exploring."""
        self.rivals = np.zeros((0, 3))
        """(k, 3) teammates' places, and metres by which they must be nearer to a frontier to have it."""
        self._errand_ended: ErrandEnd | None = None
        self._events: list[Event] = []
        self._reason = ""
        self._version = self._decided_version = -1
        self._read_tick = self._decided_tick = -_NEVER
        self._news_ticks = 0
        self._least_left_m, self._progress_tick = math.inf, 0
        self._patience_ticks, self._blocked_ticks, self._waits = 0, 0, 0
        self._back_off_until, self._back_off_from = -1, np.zeros(2)
        self._left: Target | None = None
        """The target of the last tick if another may take its place."""
        self._barriers = np.zeros((0, 4))
        """(b, 4) what stopped the robot though no scan shows it; no path leads through it again."""
        self._pushed_m = 0.0
        """Metres that the last command was to drive."""
        self._pushing_ticks, self._last = 0, (math.inf, math.inf)

    @property
    def nbytes(self) -> int:
        """Bytes of what is kept of the places seen and tried."""
        return (
            24 * len(self.poses)
            + self.viewpoints.nbytes
            + self._barriers.nbytes
            + sum(48 + 16 * len(record.stands) for record in self.memory.tried)
        )

    def look(self, situation: Situation) -> None:
        """Take in the situation. A target that is resolved, in vain or to be compared anew is under way no longer."""
        self.tick, self.wireframe, self.version, self.pose = situation[:4]
        self._xy = float(self.pose[0]), float(self.pose[1])
        self.here = np.array(self._xy)
        self._sense(situation.scan, np.asarray(situation.discs, np.float64).reshape(-1, 2))
        self._events = []
        self._take_errand(situation.errand)
        self.rivals = situation.rivals
        kept = self._keep_pose(self.config.pose_spacing_m)
        self._take_viewpoints(situation.viewpoints)
        self._left = None
        if not len(self.wireframe.edges):
            return
        self._read_ends()
        self._judge(kept)
        if self.target is None or self._reconsiders():
            self._decided_tick, self._decided_version = self.tick, self.version
            self._left, self.target = self.target, None

    def drive_forward(self) -> Command:
        """Straight ahead while nothing is mapped; around what only the scan shows."""
        self._reason = "drive until a wall is seen"
        motion = self.driver.safely(self.spec.max_speed_mps, 0.0, self.pose, self.walls_near, self.discs)
        return self._command(motion if motion.speed_mps > 0 else Motion(0.0, 0.5 * self.spec.max_turn_rps, True))

    def place_of_contact(self) -> Target | None:
        """The way to where a proposal is verified; None without proposal, or if its drive has ended or there is no way.

        While something else is under way (making room for a teammate), that goes on.
        """
        if self.errand is None:
            return None
        if self.target is None and self._errand_ended is None:
            self._run_errand()
        return self.target

    def frontier(self) -> Target | None:
        """The frontier that is under way or comes first, or a sweep with a short detour before it; None without."""
        if self.complete or (self.target is not None and not is_end(self.target.task)):
            return None
        if self.target is None:
            self._choose_frontier(self._left)
        return self.target

    def default_state(self) -> Target:
        """What else is under way, or the default state's next task, or the place to park."""
        if self.target is None:
            self._choose_default(self._left)
        assert self.target is not None
        return self.target

    def _take_errand(self, errand: Floats | None) -> None:
        """A new errand, or the end of one, is a reason to decide anew."""
        self._errand_ended = None
        if (errand is None) != (self.errand is None) or (errand is not None and (errand != self.errand).any()):
            self.errand = errand
            if errand is not None or (self.target is not None and self.target.task.kind == "errand"):
                self.target = None

    def _take_viewpoints(self, viewpoints: Floats) -> None:
        """What teammates saw need not be swept; what is taken back with a merge must."""
        if viewpoints is self.viewpoints:
            return
        more = len(viewpoints) - len(self.viewpoints)
        self.viewpoints = viewpoints
        if more and self.target is not None and self.target.task.samples is not None:
            self.target = None
        if more < 0 and self.complete:
            self.complete, self.target = False, None
            self._event("resumed", reason="what a teammate saw was taken back", place=_rounded(self.here))

    def _eyes(self) -> Floats:
        """(k, 2) all places from where was looked."""
        return np.vstack((np.array(self.poses).reshape(-1, 2), self.viewpoints))

    # what is there

    def _sense(self, scan: Wireframe, discs: Floats) -> None:
        """Walls of map and scan, standing teammates as walls, and all teammates, in the frame of the map."""
        known = self.wireframe.segments()
        seen = apply(self.pose, scan.points)[scan.edges].reshape(-1, 4)
        self.discs = self.teammates.update(self.tick, apply(self.pose, discs), known)
        standing, _ = self.teammates.obstacles(self.tick, self.planning.tight_clearance_m)
        fronts = self.teammates.fronts(self.here)
        self.walls = np.ascontiguousarray(np.vstack((known, seen, standing, fronts, self._barriers)))
        went = math.hypot(self._xy[0] - self._last[0], self._xy[1] - self._last[1])
        self._pushing_ticks = self._pushing_ticks + 1 if went < _PUSHED * self._pushed_m else 0
        self._last = self._xy
        low, high = self.here - _NEAR_M, self.here + _NEAR_M
        a, b = self.walls[:, :2], self.walls[:, 2:]
        self.walls_near = self.walls[((np.minimum(a, b) < high) & (np.maximum(a, b) > low)).all(1)]

    def _keep_pose(self, spacing_m: float) -> bool:
        """Keep the present place if it is so far from the last one; true if kept."""
        x, y = self._xy
        if self.poses and math.hypot(self.poses[-1][0] - x, self.poses[-1][1] - y) < spacing_m:
            return False
        self.poses.append((x, y))
        self.pose_ticks.append(self.tick)
        if len(self.poses) > self.config.kept_poses:
            del self.poses[1::2], self.pose_ticks[1::2]
        return True

    def _read_ends(self) -> None:
        """Open ends of the map, now and then, and whether one of them wakes a complete robot."""
        passed = self.tick - self._read_tick
        if self.version == self._version and passed < self.config.refresh_ticks:
            return
        self._version, self._read_tick = self.version, self.tick
        self.ends = open_ends(self.wireframe)
        self._recall()
        if not self.complete:
            return
        fresh = self._fresh()
        self._news_ticks = self._news_ticks + min(passed, self.config.refresh_ticks) if len(fresh) else 0
        if self._news_ticks >= self.config.persist_ticks:
            self.complete, self._news_ticks, self.target = False, 0, None
            self._event("resumed", reason="a new frontier", place=_rounded(self.ends.points[fresh[0]]))

    def _recall(self) -> None:
        self._tried = self.memory.find(self.ends.points, self.ends.along)

    def _fresh(self) -> Ints:
        """Open ends that were never given up."""
        return np.flatnonzero(self._tried < 0)

    def _again(self) -> Ints:
        """Open ends that were given up, may be tried again, and whose surroundings may have changed since."""
        records = self.memory.tried
        goals = [
            goal
            for goal, k in enumerate(self._tried)
            if k >= 0 and not records[k].unreachable and records[k].version != self.version
        ]
        return np.array(goals, np.int64)

    # what became of the target

    def _judge(self, kept: bool) -> None:
        """Drop the target where it is resolved, in vain, or overdue; kept: whether a pose was kept just now."""
        target = self.target
        if target is None or target.task.kind == "park":
            return
        if is_end(target.task):
            end = self._end_of(target.task)
            if end < 0:
                self.target = None
                return
            target.task = target.task._replace(place=self.ends.points[end], along=self.ends.along[end])
        if target.task.samples is not None and self._swept(target, kept):
            self.target = None
            return
        if self.tick > target.deadline:
            self._give_up("it took too long")
        elif math.hypot(*(target.task.stand - self.here)) <= self.config.arrive_m:
            target.looks += 1
            if target.looks >= target.looks_due:
                self._arrived(target)

    def _end_of(self, task: Task) -> int:
        """The open end that the task is about, or -1."""
        if not len(self.ends.points):
            return -1
        d = np.hypot(*(self.ends.points - task.place).T)
        d[self.ends.along @ task.along < math.cos(self.config.same_direction_rad)] = np.inf
        k = int(d.argmin())
        return k if d[k] < self.config.same_place_m else -1

    def _swept(self, target: Target, kept: bool) -> bool:
        """Whether what the sweep was to show has been seen on the way."""
        samples = target.task.samples
        assert samples is not None
        seen = self.sweep.seen(samples, self.here, self.walls)
        if len(samples) - np.count_nonzero(seen) < self.config.sweep_least_samples:
            self._keep_pose(0.0)
            return True
        if kept:
            target.task = target.task._replace(samples=samples[~seen])
        return False

    def _arrived(self, target: Target) -> None:
        """The robot has looked long enough from the standing point."""
        if not is_end(target.task):
            if target.task.kind == "sweep":
                self._keep_pose(0.0)
            if target.task.kind == "errand":
                self._errand_ended = ErrandEnd.ARRIVED
            self.states.done(target.task)
            self.target = None
            return
        record = self.memory.note(target.task.place, target.task.along)
        record.stands.append((float(target.task.stand[0]), float(target.task.stand[1])))
        self._recall()
        if target.stands < self.config.standing_points:
            for roads in self._ways():
                tasks = self._end_tasks(np.array([self._end_of(target.task)]), roads)
                if tasks:
                    self._pursue(tasks[0], roads, target)
                    assert self.target is not None
                    self.target.looks, self.target.stands = 0, target.stands + 1
                    self.target.deadline = self._deadline(self.target.path)
                    return
        self._give_up(f"still open seen from {len(record.stands)} standing points")

    def _give_up(self, reason: str) -> None:
        """Abandon the target, and remember why."""
        target, self.target = self.target, None
        assert target is not None
        if is_end(target.task):
            self._abandon(target.task.place, target.task.along, reason)
        elif target.task.kind == "errand":
            self._errand_ended = ErrandEnd.FAILED
        else:
            self.states.done(target.task)

    def _abandon(self, place: Floats, along: Floats, reason: str) -> None:
        record = self.memory.note(place, along)
        record.version, record.reason = self.version, reason
        if reason == _TEAMMATE and record.blocked < self.config.waits:
            record.blocked += 1
            record.version = -1
        else:
            record.attempts += 1
        record.unreachable = record.attempts >= self.config.attempts
        self._recall()
        what = "unreachable" if record.unreachable else "abandoned"
        self._event("frontier", what=what, place=_rounded(place), reason=reason, attempts=record.attempts)

    # what to do next

    def _reconsiders(self) -> bool:
        """Whether the target is to be compared with other tasks, or its path is no longer good."""
        target = self.target
        assert target is not None
        if self._read_tick != self.tick:
            return False
        walls = np.vstack((self.wireframe.segments(), self._barriers))
        if not still_clear(target.path, walls, target.clearance - self.planning.give_m):
            return True
        if target.task.kind in ("errand", "retreat", "park") or target.looks > 0:
            return False
        if not is_end(target.task) and not self.config.pockets:
            return len(self._fresh()) > 0
        due = self.tick - self._decided_tick >= self.config.reconsider_ticks
        return due and self.version != self._decided_version and len(self._fresh()) > 0

    def _ways(self, teammates: bool = True) -> Iterator[Roads]:
        """Roads from here with room, then tight ones; around teammates or through them, never through barriers."""
        ends = self._barriers.reshape(-1, 2)
        angles = np.arange(8) * (math.pi / 4)
        for clearance in (self.planning.clearance_m, self.planning.tight_clearance_m):
            reach = 1.15 * clearance
            around = ends[:, None] + reach * np.stack((np.cos(angles), np.sin(angles)), 1)
            walls, nodes = self._barriers, around.reshape(-1, 2)
            if teammates:
                standing, beside = self.teammates.obstacles(self.tick, clearance)
                walls, nodes = np.vstack((walls, standing)), np.vstack((nodes, beside))
            yield Roads(self.planning, self.wireframe, self.here, clearance, walls, nodes)

    def _choose_frontier(self, old: Target | None) -> None:
        """The first task of a tour through fresh frontiers, or else through those to be tried again."""
        # into slots from close by, once, where no fresh end can be seen on at ease
        for goals, views in ((self._fresh(), (False, True)), (self._again(), (False,))):
            for close, roads in ((close, roads) for close in views if len(goals) for roads in self._ways()):
                tasks = self._end_tasks(goals, roads, old, close)
                if tasks:
                    mine = not_nearer_to(self.rivals, tasks, roads)
                    mine += not_nearer_to(self.rivals, self._pockets(roads, old), roads)
                    detour_m = self.config.team_detour_m if len(self.rivals) else self.config.pocket_detour_m
                    # rather sweep than follow a teammate
                    self._pursue(first_of_tour(mine or tasks, roads, self.config, detour_m), roads, old)
                    return
            for goal in goals:
                reason = _TEAMMATE if self.teammates.in_the_way(self.tick) else "no way to a standing point"
                self._abandon(self.ends.points[goal], self.ends.along[goal], reason)

    def _choose_default(self, old: Target | None) -> None:
        """The next task of the default state, or wait for teammates that bar all there is, or complete and park."""
        if self.complete:
            self._park(old)
            return
        for roads in self._ways():
            if old is not None and not is_end(old.task) and roads.reached(old.task.stand[None])[0]:
                self._pursue(old.task, roads, old)
                return
            task = self.states.next(self.wireframe, self.version, roads, self._eyes(), self.rivals)
            if task is not None:
                self._pursue(task, roads, None)
                return
        if self.teammates.in_the_way(self.tick) and self._waits < self.config.waits and self._barred():
            self._wait()
            return
        self.complete = True
        self._event("complete", reason=self.states.ended(), unreachable=int(np.count_nonzero(self._tried >= 0)))
        self._park(None)

    def _run_errand(self) -> None:
        """Go where the robot is sent, or as near as it can stand; the errand has failed if there is no way."""
        assert self.errand is not None
        angles = np.arange(_AROUND) * (2.0 * math.pi / _AROUND)
        ring = np.stack((np.cos(angles), np.sin(angles)), 1)
        points = np.vstack((self.errand, self.errand + 0.3 * ring, self.errand + 0.6 * ring))
        away = np.hypot(*(points - self.errand).T)
        for roads in self._ways():
            good = roads.standable(points) & all_seen(points, np.repeat(self.errand[None], len(points), 0), roads.walls)
            found = roads.nearest(points[good], 2.0 * away[good])
            if found is not None:
                stand = points[good][found[0]]
                self._pursue(Task("errand", self.errand, stand), roads, None)
                return
        self._errand_ended = ErrandEnd.FAILED

    def _end_tasks(self, goals: Ints, roads: Roads, old: Target | None = None, close: bool = False) -> list[Task]:
        """Open ends that can be seen on from a standing point that is reached: one task for each wall."""
        once = same_wall(self.ends, 2.0 * self.spec.lidar.range_max_m, self.config.same_place_m)
        grazing_rad = self.config.close_grazing_rad if close else self.config.grazing_rad
        stands = stands_of(self.ends, goals, grazing_rad, close)
        good = roads.standable(stands.points) & all_seen(stands.points, stands.targets, roads.walls)
        for goal in goals[self._tried[goals] >= 0]:
            for x, y in self.memory.tried[self._tried[goal]].stands:
                again = np.hypot(stands.points[:, 0] - x, stands.points[:, 1] - y) < self.config.other_stand_m
                good &= ~(again & (stands.goal == goal))
        points, goal_of = stands.points[good], stands.goal[good]
        extra = self.config.stare_cost * np.hypot(*(points - stands.targets[good]).T)
        wall_of = once[goal_of]
        tasks = []
        kept = self._end_of(old.task) if old is not None and is_end(old.task) else -1
        for wall in np.unique(wall_of):
            here = np.flatnonzero(wall_of == wall)
            found = roads.nearest(points[here], extra[here])
            if found is not None:
                k = here[found[0]]
                goal = int(goal_of[k])
                tasks.append(
                    Task(
                        "frontier" if self.ends.frontier[goal] else "occlusion",
                        self.ends.points[goal],
                        points[k],
                        self.ends.along[goal],
                        float(extra[k]),
                        begun=kept >= 0 and bool(once[kept] == wall),
                    )
                )
        return tasks

    def _pockets(self, roads: Roads, old: Target | None) -> list[Task]:
        """Sweeps of what was passed by at too great a distance."""
        if not self.config.pockets or self.config.default_state not in ("ours", "interior-sweep"):
            return []
        samples = self.sweep.passed_by(self.wireframe, self._eyes(), self.here, self.config.pocket_reach_m)
        kept = old.task.stand if old is not None and old.task.kind == "sweep" else None
        tasks = self.sweep.tasks(samples, roads, kept)
        if kept is not None and tasks and (tasks[0].stand == kept).all():
            tasks[0] = tasks[0]._replace(begun=True)
        return tasks

    def _pursue(self, task: Task, roads: Roads, old: Target | None) -> None:
        """Make the task the target; where it is the old one's, go on with its deadline and counts."""
        found = roads.nearest(task.stand[None], np.zeros(1))
        assert found is not None, "tasks are made of standing points that are reached"
        path = found[2]
        looks_due = self.config.look_ticks if is_end(task) else 1
        self._reason = task.kind
        self.target = Target(task, path, roads.clearance, self._deadline(path), looks_due)
        if old is not None and self._same(old.task, task):
            self.target.deadline, self.target.stands, self.target.stuck = old.deadline, old.stands, old.stuck
            self._least_left_m = max(self._least_left_m, _length(path))
            return
        self._restart_progress()
        self._waits = 0
        if is_end(task):
            self._event("frontier", what="chosen", place=_rounded(task.place), cost=round(found[1], 2))

    def _same(self, old: Task, new: Task) -> bool:
        if is_end(old) and is_end(new):
            return self._end_of(old) == self._end_of(new) >= 0
        return old.kind == new.kind and bool((old.stand == new.stand).all())

    def _park(self, old: Target | None) -> None:
        """Go to an own standing point that leaves room for others to pass: near, but rather roomy than in a doorway."""
        self._reason = "complete"
        poses = np.vstack((self.here[None], np.array(self.poses)))
        if old is not None and old.task.kind == "park":
            poses = np.vstack((old.task.stand, poses))
        *_, roads = self._ways()
        room = distances_to_walls(poses, roads.walls)
        roomy = room >= min(self.config.park_clearance_m, float(room.max()))
        poses, room = poses[roomy], np.minimum(room[roomy], self.config.park_room_m)
        if len(roads.nodes):  # around the jambs of doors, where the ways of others bend
            bends = np.hypot(*(poses[:, None] - roads.nodes[None]).transpose(2, 0, 1)).min(1)
            room = np.minimum(room, 0.5 * bends)
        found = roads.nearest(poses, -self.config.park_gain * room)
        stand, path = (self.here, self.here[None]) if found is None else (poses[found[0]], found[2])
        self.target = Target(Task("park", stand, stand), path, self.planning.tight_clearance_m, _NEVER, _NEVER)
        self._restart_progress()

    def _deadline(self, path: Floats) -> int:
        seconds = 2.0 * _length(path) / self.spec.max_speed_mps + self.config.patience_s
        return self.tick + math.ceil(seconds / self.tick_s)

    # how to get there

    def drive(self, target: Target) -> Command:
        """Drive towards the target, or away from where the robot is stuck."""
        return self._command(self._drive(target))

    def _drive(self, target: Target) -> Motion:
        if self.tick < self._back_off_until:
            return self._back_off()
        self._trim(target)
        left = _length(target.path)
        if left <= 0.5 * self.config.arrive_m:
            self._restart_progress()
            return Motion(0.0, 0.0, False)
        clearance = max(target.clearance - self.planning.give_m, self.driver.wall_limit)
        motion = self.driver.follow(target.path, self.pose, self.walls_near, self.discs, clearance)
        if left < self._least_left_m - self.config.stuck_progress_m:
            self._least_left_m, self._progress_tick = left, self.tick
            self._blocked_ticks = 0
        elif self._blocked(motion):
            self._progress_tick = self.tick
        elif self.tick - self._progress_tick > self.config.stuck_s / self.tick_s:
            self._stuck(target)
        return motion

    def _trim(self, target: Target) -> None:
        """Let the path begin here, without waypoints that are passed."""
        path = target.path
        while len(path) > 2:
            (ax, ay), (bx, by) = path[1], path[2]
            passed = math.hypot(ax - self.here[0], ay - self.here[1]) < _WAYPOINT_M
            if not passed and not keeps_clear(*self._xy, bx, by, self.walls, target.clearance):
                break
            path = path[1:]
        target.path = np.vstack((self.here, path[1:] if len(path) > 1 else path))

    def _restart_progress(self) -> None:
        self._least_left_m, self._progress_tick = math.inf, self.tick
        self._blocked_ticks = 0
        self._patience_ticks = round(self.config.wait_s * (0.5 + self.rng.random()) / self.tick_s)

    def _blocked(self, motion: Motion) -> bool:
        """Whether the robot waits for a teammate; after some patience, drawn at random, it gives way."""
        mate = self.teammates.near(*self._xy, self.config.blocked_m) if motion.held else None
        if mate is None or self.target is None:
            return False
        self._blocked_ticks += 1
        if self._blocked_ticks > self._patience_ticks:
            mate.avoid_until = self.tick + math.ceil(self.config.avoid_s / self.tick_s)
            self._retreat(mate.x, mate.y)
        return True

    def _retreat(self, x: float, y: float) -> None:
        """Make room for the teammate at (x, y): plan around it, or go back to an own standing point away from it."""
        target = self.target
        assert target is not None
        self._event("stuck", place=_rounded(self.here), on_the_way_to=target.task.kind, reason="a teammate")
        for roads in self._ways():
            found = roads.nearest(target.task.stand[None], np.zeros(1))
            if found is not None:
                target.path, target.clearance = found[2], roads.clearance
                self._restart_progress()
                return
        poses = np.array(self.poses)
        away = np.hypot(poses[:, 0] - x, poses[:, 1] - y)
        room = distances_to_walls(poses, self.walls)
        poses = poses[(away >= self.config.retreat_m) & (room >= self.planning.tight_clearance_m)]
        found = roads.nearest(poses, -np.minimum(distances_to_walls(poses, self.walls), self.config.park_clearance_m))
        if target.task.kind not in ("retreat", "park"):
            self._give_up(_TEAMMATE)
        if found is not None:
            self.target = Target(
                Task("retreat", poses[found[0]], poses[found[0]]), found[2], roads.clearance,
                self._deadline(found[2]), self._patience_ticks,
            )  # fmt: skip
            self._reason = "retreat"
        self._restart_progress()

    def _barred(self) -> bool:
        """Whether there would be something to do if no teammate stood in the way."""
        if len(self._again()):
            return True
        eyes = self._eyes()
        return any(
            self.states.next(self.wireframe, self.version, roads, eyes, self.rivals)
            for roads in self._ways(teammates=False)
        )

    def _wait(self) -> None:
        """Stand still for a while."""
        self._waits += 1
        self._restart_progress()
        here = Task("retreat", self.here, self.here)
        self.target = Target(here, self.here[None], self.planning.tight_clearance_m, _NEVER, self._patience_ticks)
        self._reason = "wait for a teammate"

    def _stuck(self, target: Target) -> None:
        """Back off, and give the target up the second time."""
        target.stuck += 1
        gives_up = target.stuck > 1 and target.task.kind != "park"
        unseen = self._pushing_ticks >= self.config.push_ticks
        if unseen:
            self._bar()
        self._event(
            "stuck",
            place=_rounded(self.here),
            on_the_way_to=target.task.kind,
            reason="an unseen wall" if unseen else "no progress",
            recovery="another goal" if gives_up else "back off",
        )
        self._restart_progress()
        self._back_off_until = self.tick + math.ceil(self.config.back_off_s / self.tick_s)
        self._back_off_from = self.here
        if gives_up:
            self._give_up("stuck on the way")

    def _bar(self) -> None:
        """Remember a wall that no scan shows, across the way just before the robot."""
        c, s = math.cos(self.pose[2]), math.sin(self.pose[2])
        off = self.spec.radius_m + self.planning.give_m
        x, y = self._xy[0] + off * c, self._xy[1] + off * s
        wall = [x - _BARRIER_M * s, y + _BARRIER_M * c, x + _BARRIER_M * s, y - _BARRIER_M * c]
        self._barriers = np.vstack((self._barriers, wall))[-self.config.barriers :]

    def _back_off(self) -> Motion:
        """Towards the most room within a short drive."""
        reach = self.config.back_off_m
        if math.hypot(*(self.here - self._back_off_from)) >= reach:
            self._back_off_until = -1
            self._restart_progress()
        angles = np.arange(16) * (math.pi / 8)
        around = self.here + reach * np.stack((np.cos(angles), np.sin(angles)), 1)
        room = distances_to_walls(around, self.walls_near)
        for x, y in self.discs:
            room = np.minimum(room, np.hypot(around[:, 0] - x, around[:, 1] - y) - self.spec.radius_m)
        px, py = around[int(np.argmax(room))]
        return self.driver.towards(px, py, self.pose, self.walls_near, self.discs, reach)

    # what is told

    def _event(self, event: str, **data: object) -> None:
        self._events.append(Event(event=event, data=data))

    def _command(self, motion: Motion) -> Command:
        self._pushed_m = motion.speed_mps * self.tick_s
        place = None
        if self.target is not None:
            x, y = self.target.task.stand
            place = float(x), float(y)
        complete = self.complete and self.errand is None
        events, ended = self._events, self._errand_ended
        return Command(motion.speed_mps, motion.turn_rps, complete, self._reason, events, place, ended)


def _length(path: Floats) -> float:
    d = np.diff(path, axis=0)
    return float(np.hypot(d[:, 0], d[:, 1]).sum())


def _rounded(point: Floats) -> list[float]:
    return [round(float(point[0]), 3), round(float(point[1]), 3)]
