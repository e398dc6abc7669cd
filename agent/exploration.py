"""Where a robot goes: frontiers first, then the default state, until nothing is left to see (paper IV, Algorithm 1).

The rules are ours where the paper is silent: goals have a memory, every stretch of waiting or trying is bounded, and
`complete` is a state that a new frontier ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agent.clearance import distance_to_walls, keeps_clear
from agent.default_state import DefaultStates, Errand
from agent.driving import Driver, Motion, moved
from agent.exploration_config import DrivingConfig, ExplorationConfig, PlanningConfig
from agent.goals import Ends, GoalMemory, Tried, open_ends, same_wall, stands_of
from agent.planning import Roads, still_clear
from agent.visibility import all_seen
from protocol.messages import Event, RobotSpec
from protocol.wireframe import Wireframe

Floats = NDArray[np.float64]
PoseXYT = tuple[float, float, float]

_NEAR_M = 1.5
"""Walls within this of the robot matter for the next ticks; it drives 0.09 m in two."""


class Configs(NamedTuple):
    """What an explorer is configured by."""

    exploration: ExplorationConfig
    planning: PlanningConfig
    driving: DrivingConfig


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


@dataclass(slots=True)
class Target:
    """A goal under way."""

    kind: Literal["frontier", "sweep", "edge", "vertex", "perimeter", "park", "retreat"]
    place: Floats
    """(2,) what is to be seen."""
    along: Floats
    """(2,) unit: where the wall goes on."""
    stand: Floats
    """(2,) where to see it from."""
    path: Floats
    """(k, 2) from the robot to the standing point."""
    clearance: float
    deadline: int
    """Tick at which it is given up."""
    looks: int = 0
    """Scans taken at the standing point."""
    stands: int = 1
    """Standing points tried, this one included."""
    samples: Floats | None = None
    """(n, 2) what a sweep still has to see."""
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
        self.states = DefaultStates(self.config, spec, rng)
        self.poses: list[tuple[float, float]] = []
        """Own standing points so far, about every half metre: what was seen, kept sparsely."""
        self.complete = False
        self.target: Target | None = None
        self.ends: Ends = open_ends(Wireframe())
        self._remembered = np.zeros(0, np.int64)
        self._events: list[Event] = []
        self._reason = ""
        self._version = -1
        self._decided_version = -1
        self._refreshed = self._decided = -(10**9)
        self._news = 0
        self._least_left, self._progress_tick = math.inf, 0
        self._held_ticks = 0
        self._back_off_until = -1
        self._mates = np.zeros((0, 3))
        """Teammates in the way: x, y, tick when seen last."""

    def step(
        self,
        tick: int,
        wireframe: Wireframe,
        version: int,
        pose: PoseXYT,
        scan: Wireframe,
        discs: Floats,
    ) -> Command:
        """Decide and drive for one tick.

        wireframe: the robot's map, and pose (x, y, theta): both in the robot's own frame; version: greater whenever
        the map changed structurally. scan: corners and walls seen now, discs (k, 2): centres of teammates seen now,
        both in the frame of the robot. Metres, radians.
        """
        self.tick, self.wireframe, self.version, self.pose = tick, wireframe, version, pose
        self.here = np.array(pose[:2])
        self.discs = moved(np.asarray(discs, np.float64).reshape(-1, 2), pose)
        seen = moved(scan.points, pose)[scan.edges].reshape(-1, 4)
        self.all_walls = np.ascontiguousarray(np.vstack((wireframe.segments(), seen)))
        self.walls = self._near(self.all_walls)
        self._events = []
        self._keep_pose()
        if not len(wireframe.edges):
            self._reason = "drive until a wall is seen"
            return self._command(self._into_the_open())
        self._read_ends()
        self._judge()
        if self.target is None or self._reconsiders():
            self._decide()
        return self._command(self._drive())

    # what is there

    def _near(self, walls: Floats) -> Floats:
        """Those of walls (m, 4) that matter for the next ticks."""
        x, y = self.here
        near = (
            (np.minimum(walls[:, 0], walls[:, 2]) < x + _NEAR_M)
            & (np.maximum(walls[:, 0], walls[:, 2]) > x - _NEAR_M)
            & (np.minimum(walls[:, 1], walls[:, 3]) < y + _NEAR_M)
            & (np.maximum(walls[:, 1], walls[:, 3]) > y - _NEAR_M)
        )
        return walls[near]

    def _keep_pose(self, spacing: float | None = None) -> None:
        spacing = self.config.pose_spacing_m if spacing is None else spacing
        x, y = self.here
        self._moved_on = not self.poses or math.hypot(self.poses[-1][0] - x, self.poses[-1][1] - y) >= spacing
        if not self._moved_on:
            return
        self.poses.append((float(x), float(y)))
        if len(self.poses) > self.config.kept_poses:
            del self.poses[1::2]

    def _read_ends(self) -> None:
        """Open ends of the map, now and then, and whether one of them wakes a complete robot."""
        if self.version == self._version and self.tick - self._refreshed < self.config.refresh_ticks:
            return
        ticks = self.tick - self._refreshed
        self._version, self._refreshed = self.version, self.tick
        self.ends = open_ends(self.wireframe)
        self._remembered = self.memory.find(self.ends.points, self.ends.along)
        if not self.complete:
            return
        self._news = self._news + min(ticks, self.config.refresh_ticks) if len(self._fresh()) else 0
        if self._news >= self.config.persist_ticks:
            self.complete, self._news, self.target = False, 0, None
            point = self.ends.points[self._fresh()[0]]
            self._event("resumed", reason="a new frontier", place=_rounded(point))

    def _fresh(self) -> NDArray[np.int64]:
        """Open ends that were never given up."""
        return np.flatnonzero(self._remembered < 0)

    # what became of the target

    def _judge(self) -> None:
        """Drop the target where it is resolved, in vain, or overdue."""
        target = self.target
        if target is None:
            return
        if target.kind == "frontier":
            at = self._end_of(target)
            if at < 0:
                self.target = None
                return
        if target.samples is not None:
            seen = self.states.sweep.seen(target.samples, self.here[None], self.all_walls)
            if self._moved_on:
                target.samples = target.samples[~seen]
            if len(target.samples) - np.count_nonzero(seen) < self.config.sweep_least_samples:
                self._keep_pose(0.0)
                self.target = None
                return
        if self.tick > target.deadline and target.kind != "park":
            self._give_up("it took too long")
            return
        if math.hypot(*(target.stand - self.here)) > self.config.arrive_m:
            return
        target.looks += 1
        if target.looks < self.config.look_ticks:
            return
        if target.kind == "sweep":
            self._keep_pose(0.0)
        if target.kind == "frontier":
            record = self.memory.note(target.place, target.along)
            record.stands.append((float(target.stand[0]), float(target.stand[1])))
            if target.stands >= self.config.standing_points or not self._next_stand(target, record):
                self._give_up(f"still open seen from {len(record.stands)} standing points")
        elif target.kind != "park":
            self.states.done(target.kind, target.place)
            self.target = None

    def _end_of(self, target: Target) -> int:
        """The open end that the target is about, or -1."""
        if not len(self.ends.points):
            return -1
        d = np.hypot(*(self.ends.points - target.place).T)
        d[self.ends.along @ target.along < math.cos(self.config.same_direction_rad)] = np.inf
        k = int(d.argmin())
        return k if d[k] < self.config.same_place_m else -1

    def _next_stand(self, target: Target, record: Tried) -> bool:
        """Turn to another standing point of the same goal; False if there is none."""
        k = self._end_of(target)
        self._remembered = self.memory.find(self.ends.points, self.ends.along)
        for clearance in (self.planning.clearance_m, self.planning.tight_clearance_m):
            found = self._nearest_end(np.array([k]), self._roads(clearance))
            if found is not None:
                _, stand, path, _ = found
                target.stand, target.path, target.clearance = stand, path, clearance
                target.looks, target.stands = 0, target.stands + 1
                target.deadline = self._deadline(path)
                self._restart_progress()
                return True
        return False

    def _give_up(self, reason: str) -> None:
        """Abandon the target, and remember why."""
        target = self.target
        assert target is not None
        self.target = None
        if target.kind == "frontier":
            self._abandon(target.place, target.along, reason)
        elif target.kind not in ("park", "retreat"):
            self.states.done(target.kind, target.place)

    def _abandon(self, place: Floats, along: Floats, reason: str) -> None:
        record = self.memory.note(place, along)
        record.attempts += 1
        record.version, record.reason = self.version, reason
        record.unreachable = record.attempts >= self.config.attempts
        self._remembered = self.memory.find(self.ends.points, self.ends.along)
        self._event(
            "frontier",
            what="unreachable" if record.unreachable else "abandoned",
            place=_rounded(place),
            reason=reason,
            attempts=record.attempts,
        )

    # what to do next

    def _reconsiders(self) -> bool:
        """Whether the target is to be compared with others, or its path is no longer good."""
        target = self.target
        assert target is not None
        if self._refreshed != self.tick:
            return False
        if not still_clear(target.path, self.wireframe.segments(), target.clearance - 0.03):
            return True
        if target.kind not in ("frontier", "retreat") and len(self._fresh()) and not self.complete:
            return not self.config.joint_tour or (self.version != self._decided_version and self.tick - self._decided >= self.config.reconsider_ticks)
        return (
            target.kind == "frontier"
            and target.looks == 0
            and self.version != self._decided_version
            and self.tick - self._decided >= self.config.reconsider_ticks
        )

    def _roads(self, clearance: float) -> Roads:
        return Roads(self.planning, self.wireframe, self.here, clearance, *self._obstacles())

    def _obstacles(self) -> tuple[Floats, Floats]:
        """Teammates in the way as walls (k, 4) and nodes (j, 2) around them."""
        return np.zeros((0, 4)), np.zeros((0, 2))

    def _decide(self) -> None:
        """Choose the target: frontiers, then those to be tried again, then the default state, then park."""
        self._decided, self._decided_version = self.tick, self.version
        old, self.target = self.target, None
        clearances = (self.planning.clearance_m, self.planning.tight_clearance_m)
        if not self.complete:
            roads = [self._roads(clearances[0])]
            for again in (False, True):
                goals = self._again() if again else self._fresh()
                for k, clearance in enumerate(clearances if len(goals) else ()):
                    if k == len(roads):
                        roads.append(self._roads(clearance))
                    found = self._nearest_end(goals, roads[k], old)
                    if found is not None:
                        if not again and self.config.joint_tour:
                            if self._joint(goals, roads[k], clearance, old, found):
                                return
                        self._pursue_end(*found, clearance, old)
                        return
                for goal in goals:
                    self._abandon(self.ends.points[goal], self.ends.along[goal], "no way to a standing point")
            if old is not None and old.kind not in ("frontier", "park"):
                path = roads[0].nearest(old.stand[None], np.zeros(1))
                if path is not None:
                    old.path = path[2]
                    self._least_left = max(self._least_left, _length(old.path))
                    self.target = old
                    return
                self.target = old
                self._give_up("no way")
            for k, clearance in enumerate(clearances):
                if k == len(roads):
                    roads.append(self._roads(clearance))
                errand = self.states.next(self.wireframe, self.version, roads[k], np.array(self.poses))
                if errand is not None:
                    self._pursue(errand, clearance)
                    return
            self.complete = True
            left = sum(1 for k in self._remembered if k >= 0)
            self._event("complete", reason=self.states.ended(), unreachable=left)
        self._park(old)

    def _joint(self, goals, roads, clearance, old, found) -> bool:
        sweep = self.states.sweep
        poses = np.array(self.poses)
        samples = sweep.passed_by(self.wireframe, poses, self.here, self.config.pocket_reach_m)
        pockets, views = sweep.stands(samples, roads, self.config.pocket_samples)
        if not len(pockets):
            return False
        once = same_wall(self.ends, 2.0 * self.spec.lidar.range_max_m, self.config.same_place_m)
        tasks = []
        for goal in goals:
            if once[goal] != goal: continue
            f = self._nearest_end(np.array([goal]), roads, None)
            if f is not None:
                tasks.append((f, f[1]))
        tasks += [(k, pockets[k]) for k in range(len(pockets))]
        stands = np.array([t[1] for t in tasks])
        costs = roads.costs(stands)
        kinds = np.array([not isinstance(t[0], tuple) for t in tasks])
        costs += kinds * self.config.pocket_bias_m
        near = np.argsort(costs, kind="stable")[: self.config.sweep_tour]
        table = np.zeros((len(near) + 1, len(near) + 1))
        table[0, 1:] = costs[near]
        for k, stand in enumerate(stands[near]):
            table[k + 1, 1:] = roads.starting_at(stand).costs(stands[near])
        from agent.tour import open_tour
        order = open_tour(np.minimum(table, 1e6))
        first = near[order[1] - 1]
        for i in range(1, len(order)):
            first = near[order[i] - 1]
            if not kinds[first] : break
            nxt = [j for j in order[i+1:] if not kinds[near[j - 1]]]
            if not nxt: continue
            if table[0, order[i]] + table[order[i], nxt[0]] - table[0, nxt[0]] <= self.config.pocket_detour_m: break
        task = tasks[first][0]
        if isinstance(task, tuple):
            self._pursue_end(*task, clearance, old)
        else:
            way = roads.nearest(stands[first][None], np.zeros(1))
            if way is None:
                return False
            self._pursue(Errand("sweep", stands[first], stands[first], way[2], samples[views[task]]), clearance)
        return True

    def _again(self) -> NDArray[np.int64]:
        """Open ends that were given up, may be tried again, and whose surroundings may have changed since."""
        tried = self.memory.tried
        return np.array(
            [
                goal
                for goal, k in enumerate(self._remembered)
                if k >= 0 and not tried[k].unreachable and tried[k].version != self.version
            ],
            np.int64,
        )

    def _nearest_end(
        self, goals: NDArray[np.int64], roads: Roads, old: Target | None = None
    ) -> tuple[int, Floats, Floats, float] | None:
        """The end that costs least to see on: its index, standing point, path and cost."""
        once = same_wall(self.ends, 2.0 * self.spec.lidar.range_max_m, self.config.same_place_m)
        stands = stands_of(self.ends, goals, self.config.grazing_rad)
        good = roads.standable(stands.points) & all_seen(stands.points, stands.targets, roads.walls)
        for goal in goals:
            k = self._remembered[goal]
            for x, y in self.memory.tried[k].stands if k >= 0 else ():
                near = np.hypot(stands.points[:, 0] - x, stands.points[:, 1] - y) < 1.25 * self.config.same_place_m
                good &= ~(near & (stands.goal == goal))
        points, targets, goal_of = stands.points[good], stands.targets[good], stands.goal[good]
        extra = self.config.stare_cost * np.hypot(*(points - targets).T)
        if old is not None and old.kind == "frontier":
            kept = self._end_of(old)
            if kept >= 0:
                extra = extra + self.config.switch_gain_m * (once[goal_of] != once[kept])
        found = roads.nearest(points, extra)
        if found is None:
            return None
        k, cost, path = found
        return int(goal_of[k]), points[k], path, cost

    def _pursue_end(
        self, goal: int, stand: Floats, path: Floats, cost: float, clearance: float, old: Target | None
    ) -> None:
        place, along = self.ends.points[goal], self.ends.along[goal]
        self.target = Target("frontier", place, along, stand, path, clearance, self._deadline(path))
        if old is not None and old.kind == "frontier" and self._end_of(old) == goal:
            self.target.deadline = old.deadline
            self.target.stuck, self.target.stands = old.stuck, old.stands
            self._least_left = max(self._least_left, _length(path))
        else:
            self._restart_progress()
            self._event("frontier", what="chosen", place=_rounded(place), cost=round(cost, 2))
        self._reason = "frontier" if self.ends.frontier[goal] else "occlusion"

    def _pursue(self, errand: Errand, clearance: float) -> None:
        self.target = Target(
            errand.kind, errand.place, np.zeros(2), errand.stand, errand.path, clearance, self._deadline(errand.path)
        )
        self.target.samples = errand.samples
        self._restart_progress()
        self._reason = errand.kind

    def _park(self, old: Target | None) -> None:
        """Go to the nearest own standing point that leaves room for others to pass."""
        self._reason = "complete"
        if old is not None and old.kind == "park":
            self.target = old
            return
        poses = np.vstack((self.here[None], np.array(self.poses)))
        roads = self._roads(self.planning.tight_clearance_m)
        room = np.array([distance_to_walls(x, y, roads.walls) for x, y in poses])
        open_ = room >= min(self.config.park_clearance_m, float(room.max()))
        found = roads.nearest(poses[open_], np.zeros(int(open_.sum())))
        stand, path = (self.here, self.here[None]) if found is None else (poses[open_][found[0]], found[2])
        self.target = Target("park", stand, np.zeros(2), stand, path, self.planning.tight_clearance_m, 2**62)
        self._restart_progress()

    def _deadline(self, path: Floats) -> int:
        seconds = 2.0 * _length(path) / self.spec.max_speed_mps + self.config.patience_s
        return self.tick + math.ceil(seconds / self.tick_s)

    # how to get there

    def _into_the_open(self) -> Motion:
        """Straight ahead while nothing is known; around what only the scan shows."""
        motion = self.driver.safely(self.spec.max_speed_mps, 0.0, self.pose, self.walls, self.discs)
        return motion if motion.speed_mps > 0 else Motion(0.0, 0.5 * self.spec.max_turn_rps, True)

    def _drive(self) -> Motion:
        """Along the path, or away from where the robot is stuck."""
        target = self.target
        if target is None:
            return Motion(0.0, 0.0, False)
        if self.tick < self._back_off_until:
            return self._back_off()
        self._trim(target)
        left = _length(target.path)
        if left <= 0.5 * self.config.arrive_m:
            self._restart_progress()
            return Motion(0.0, 0.0, False)
        motion = self.driver.follow(
            target.path, self.pose, self.walls, self.discs, max(target.clearance - 0.02, self.driver.wall_limit)
        )
        if left < self._least_left - self.config.stuck_progress_m:
            self._least_left, self._progress_tick = left, self.tick
        elif self.tick - self._progress_tick > self.config.stuck_s / self.tick_s:
            self._stuck(target)
        return motion

    def _trim(self, target: Target) -> None:
        """Let the path begin here, without waypoints that are passed."""
        path = target.path
        while len(path) > 2:
            (ax, ay), (bx, by) = path[1], path[2]
            near = math.hypot(ax - self.here[0], ay - self.here[1]) < 0.03
            if not near and not keeps_clear(*self.here, bx, by, self.all_walls, target.clearance - 0.005):
                break
            path = path[1:]
        target.path = np.vstack((self.here[None], path[1:])) if len(path) > 1 else np.vstack((self.here, path[0]))

    def _restart_progress(self) -> None:
        self._least_left, self._progress_tick = math.inf, self.tick

    def _stuck(self, target: Target) -> None:
        """Back off, and give the target up the second time."""
        target.stuck += 1
        self._event("stuck", place=_rounded(self.here), on_the_way_to=target.kind, times=target.stuck)
        self._restart_progress()
        self._back_off_until = self.tick + math.ceil(self.config.back_off_s / self.tick_s)
        self._back_off_from = self.here
        if target.stuck > 1 and target.kind != "park":
            self._give_up("stuck on the way")

    def _back_off(self) -> Motion:
        """Towards the most room within a short drive."""
        if math.hypot(*(self.here - self._back_off_from)) >= self.config.back_off_m:
            self._back_off_until = -1
            self._restart_progress()
        angles = np.linspace(0, 2 * math.pi, 16, endpoint=False)
        reach = self.config.back_off_m
        around = self.here + reach * np.stack((np.cos(angles), np.sin(angles)), 1)
        room = [
            min(
                distance_to_walls(px, py, self.walls),
                min((math.hypot(px - dx, py - dy) - self.spec.radius_m for dx, dy in self.discs), default=math.inf),
            )
            for px, py in around
        ]
        px, py = around[int(np.argmax(room))]
        return self.driver.towards(px, py, self.pose, self.walls, self.discs, reach)

    # what is told

    def _event(self, event: str, **data: object) -> None:
        self._events.append(Event(event=event, data=data))

    def _command(self, motion: Motion) -> Command:
        place = None if self.target is None else (float(self.target.stand[0]), float(self.target.stand[1]))
        return Command(motion.speed_mps, motion.turn_rps, self.complete, self._reason, self._events, place)


def _length(path: Floats) -> float:
    d = np.diff(path, axis=0)
    return float(np.hypot(d[:, 0], d[:, 1]).sum())


def _rounded(point: Floats) -> list[float]:
    return [round(float(point[0]), 3), round(float(point[1]), 3)]
