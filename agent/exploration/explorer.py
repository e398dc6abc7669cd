"""Where a robot goes: the targets of Algorithm 1's branches (paper IV), kept until they are reached or given up.

Where the paper is silent the rules are ours: goals have a memory, all trying and waiting is bounded, and `complete`
is a state that a new frontier ends, or viewpoints that are taken back.
"""

import math
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from agent.errand import Errand
from agent.exploration import standing
from agent.exploration.agenda import Target, Task, agenda_of, first_of_tour, is_end
from agent.exploration.auction import own_share
from agent.exploration.config import DrivingConfig, ExplorationConfig
from agent.exploration.default_state import DefaultStates
from agent.exploration.driving import STOP, Driver, Motion, ticks_to_drive
from agent.exploration.glimpses import SAME_M
from agent.exploration.goals import OTHER_STAND_M, TEAMMATE, WAITS, Goals, rounded
from agent.exploration.headway import STUCK_S, Headway
from agent.exploration.homing import Homing
from agent.exploration.parking import AGAIN_S, Parking
from agent.exploration.path import ARRIVED_M, GIVE_M, ahead_of, length_of, still_clear
from agent.exploration.planning import Roads, circle
from agent.exploration.surroundings import MOST_WALLS, Scene, Situation, Surroundings
from agent.exploration.sweep import MOST_KEPT, Sweep, Viewpoints
from agent.exploration.teammates import Teammate
from agent.geometry.clearance import distances_to_walls
from agent.geometry.wall_tiles import wall_tiles
from agent.mapping.submaps.settled import Settled
from agent.state import State, checked
from protocol.arrays import Floats
from protocol.messages import Event, RobotSpec

LOOKS_S = {"frontier": 0.8, "occlusion": 0.8, "glimpse": 3.0, "home": 3.0, "look": 3.0}
"""Seconds near a standing point before a goal counts as unresolved: a map changes its mind after three scans. A face of
0.1 m becomes a wall after a dozen, so an end has as long as a glimpse from its last standing point while something is
seen beside it: in drlnav_stage7 the back of a partition was left for good when one scan more would have made it a wall.
From each standing point, runs in `symmetric` took a seventh longer."""
STANDING_POINTS = 3  # standing points tried in one attempt at a goal
RECONSIDER_M = 0.44
"""Goals are compared anew where the map has changed, and as much time has passed as a drive of half a doorway takes."""
PERSIST_S = 0.8  # a new frontier must last this long to wake a complete robot, as single scans flicker
NOBODY = np.zeros((0, 2))
LOST_M = 0.08
"""m, standard deviation of its place at which a robot goes home before it goes on. Its gates are three of it: beyond,
it takes one face of a column for another, or its first walls for walls that are gone."""
BACK_OFF_M = 0.2  # how far a stuck robot moves away from what it is close to
BACK_OFF_S = 3.0  # ... and for how long at most


class Command(NamedTuple):
    """What the robot does in the next tick, and why."""

    speed_mps: float
    turn_rps: float
    complete: bool
    reason: str  # the state in a few words
    events: list[Event]
    target: tuple[float, float] | None  # where it is going, frame of the map


class Explorer:
    """One robot's choice of targets, on its sparse map alone.

    In each tick `look` comes first. Then `stop`, `drive_forward`, or `drive` to the target of one of the branches.
    """

    def __init__(self, config: ExplorationConfig, driving: DrivingConfig, spec: RobotSpec, rng: Generator) -> None:
        self.config, self.spec = config, spec
        self.driver, self.surroundings = Driver(driving, spec), Surroundings(driving, spec)
        self.viewpoints, self.headway = Viewpoints(), Headway(rng, spec)
        self._remember_nothing(rng)
        self.complete = False
        self._put_back: Target | None = None
        """The last target, where this tick compares it with others, or its path is no longer clear."""
        self._errand: Errand | None = None
        self._events: list[Event] = []
        self._decided_tick, self._decided_version = 0, -1
        self._reconsider_ticks = ticks_to_drive(RECONSIDER_M, spec)
        self._sd_at_home_m = 0.0  # of its place when it was last there: where that did not help, it is not tried again
        self._withdrawn = 0  # times that teammates' viewpoints were taken back
        self._news = 0  # ticks for which a complete robot has seen a new frontier
        self._waits = 0  # times that the robot has waited for a teammate since it last had a target

    def _remember_nothing(self, rng: Generator) -> None:
        """Begin with no memory of places, but for those that were looked from."""
        config, lidar = self.config, self.spec.lidar
        self.goals, self.sweep = Goals(config.attempts, self.spec), Sweep(config.smallest_object_m, lidar)
        self.states = DefaultStates(config, self.sweep, lidar, rng)
        self.homing, self.parking = Homing(), Parking()
        self.target: Target | None = None
        self._back_off: tuple[int, Floats] = (-1, np.zeros(2))  # until which tick, and (2,) where the robot was stuck

    @property
    def nbytes(self) -> int:
        """Bytes of what is kept of the places seen and tried."""
        kept = self.viewpoints.nbytes + self.surroundings.touch.walls.nbytes + self.goals.nbytes
        return kept + self.sweep.nbytes + self.states.nbytes

    def look(self, situation: Situation) -> Scene:
        """Take in the situation. The target is dropped where it is resolved, in vain, or to be compared anew."""
        scene = self.surroundings.look(situation)
        self._events, self._put_back = [], None
        self._take_errand(scene.errand)
        moved_on = self.viewpoints.keep(scene.tick, scene.here)
        self._take_viewpoints(scene)
        self.states.glimpses.keep(scene.tick, scene.glimpses, scene.sees_past)
        if not len(scene.wireframe.edges):
            return scene
        read_ticks = self.goals.read(scene)
        self._wake(read_ticks)
        self._judge(scene, moved_on)
        if self.target is None or (read_ticks and self._reconsiders(scene, self.target)):
            self._decided_tick, self._decided_version = scene.awake, scene.version
            self._put_back, self.target = self.target, None
        return scene

    def state(self) -> dict[str, NDArray[Any]]:
        """What it saw and felt, for a checkpoint; where to go is decided anew."""
        eyes = self.viewpoints
        return {
            "eyes": eyes.own_places(),
            "eye_ticks": np.array(eyes.ticks, np.int64),
            "felt": self.surroundings.touch.walls.copy(),
        }

    def restore(self, state: State) -> None:
        """Go on with what was kept. Raises ValueError or LookupError where it makes no sense."""
        eyes = checked(state, "eyes", np.zeros((0, 2)), rows=True)
        ticks = checked(state, "eye_ticks", np.zeros(0, np.int64), rows=True)
        felt = checked(state, "felt", self.surroundings.touch.walls, rows=True)
        if not len(eyes) == len(ticks) <= MOST_KEPT or len(felt) > MOST_WALLS:
            raise ValueError("more viewpoints or walls than are kept")
        self.viewpoints.own = [(x, y) for x, y in eyes.tolist()]
        self.viewpoints.ticks = ticks.tolist()
        self.surroundings.touch.restore(felt)

    def mend(self, settled: Settled) -> None:
        """The map was torn and is merged anew: from where it was looked moves with it.

        So do walls found by touch, and what is beside the robot. All else that is remembered of places begins anew.
        """
        eyes = self.viewpoints
        eyes.own = [(x, y) for x, y in settled.places(np.array(eyes.ticks, np.int64), eyes.own_places()).tolist()]
        self.surroundings.mend(settled)
        self._remember_nothing(self.states.rng)

    # the branches of Algorithm 1

    def drive_forward(self, scene: Scene) -> Command:
        """Straight ahead while nothing is mapped; around what only the scan shows."""
        motion = self.driver.safely(self.spec.max_speed_mps, 0.0, scene.pose, scene.near)
        if motion.speed_mps <= 0:
            motion = Motion(0.0, 0.5 * self.spec.max_turn_rps, True)
        return self._command(motion, "drive until a wall is seen")

    def stop(self, reason: str) -> Command:
        """No motion for a tick."""
        return self._command(STOP, reason)

    def place_of_contact(self, scene: Scene) -> Target | None:
        """The way to where a proposal is verified; None without proposal, or if its drive has ended or there is no way.

        While something else is under way (making room for a teammate), that goes on.
        """
        errand = scene.errand
        if errand is None:
            return None
        if self.target is None and not errand.ended:
            hiding = wall_tiles(self.surroundings.lasting)
            for roads in self.surroundings.ways(scene):
                route = standing.near(errand.place, roads, hiding)
                if route is not None:
                    return self._pursue(scene, Task("errand", errand.place, route.path[-1]), roads, None)
            errand.ended = "no way"
        return self.target

    def way_home(self, scene: Scene) -> Target | None:
        """Home, for a robot that does not know its place and has begun nothing else; None without need or way.

        It goes on home where its path is no longer clear.
        """
        if self.complete or self.target is not None or not scene.pose_sd_m > LOST_M >= self._sd_at_home_m:
            return None
        home = self.homing.home(scene.exactness, self.surroundings.ways(scene))
        return None if home is None else self._pursue(scene, home.task, home.roads, self._put_back)

    def frontier(self, scene: Scene) -> Target | None:
        """The frontier that is under way or comes first, or a sweep with a short detour before it; None without."""
        if self.complete or (self.target is not None and not is_end(self.target.task)):
            return None
        return self.target or self._choose_frontier(scene, self._put_back)

    def default_state(self, scene: Scene) -> Target:
        """What else is under way, or the default state's next task, or the place to park.

        A robot that has parked steps aside where it is seen by somebody who does not know its frame.
        """
        if self.complete and scene.strangers and len(scene.discs) and (aside := self._step_aside(scene)):
            return aside
        return self.target or self._choose_default(scene, self._put_back)

    def drive(self, scene: Scene, target: Target) -> Command:
        """Drive towards the target, or away from where the robot is stuck."""
        motion = self._drive(scene, target)
        kind = (self.target or target).task.kind
        return self._command(motion, {"park": "complete", "wait": "wait for a teammate"}.get(kind, kind))

    # what is new

    def _take_errand(self, errand: Errand | None) -> None:
        """A new errand, or the end of one, is a reason to decide anew."""
        last, self._errand = self._errand, errand
        drives = self.target is not None and self.target.task.kind == "errand"
        if errand is not last and (errand is not None or drives):
            self.target = None

    def _take_viewpoints(self, scene: Scene) -> None:
        """What teammates saw need not be swept; what is taken back with a merge must.

        A sweep goes on while they have not seen what it is for: a crowd tells of new viewpoints at all times.
        """
        news, back = scene.viewpoints is not self.viewpoints.teammates, scene.withdrawn != self._withdrawn
        self.viewpoints.teammates, self._withdrawn = scene.viewpoints, scene.withdrawn
        if (news or back) and self.target is not None and self.target.task.samples is not None:
            left, swept = self.sweep.left(self.target.task.samples, NOBODY, scene.viewpoints, scene.walls)
            self.target.task = self.target.task._replace(samples=left)
            if swept or back:
                self.target = None
        if back and self.complete:
            self._resume(scene.here, "what a teammate saw was taken back")

    def _wake(self, read_ticks: int) -> None:
        """A new frontier that lasts ends `complete`; read_ticks: ticks for which this reading of ends counts."""
        if not read_ticks or not self.complete:
            return
        fresh = self.goals.fresh()
        self._news = self._news + read_ticks if len(fresh) else 0
        if self._news >= self._ticks(PERSIST_S):
            self._news = 0
            self._resume(self.goals.ends.points[fresh[0]], "a new frontier")

    def _resume(self, place: Floats, reason: str) -> None:
        """End `complete`; place: (2,) where something is to be done."""
        self.complete, self.target = False, None
        self.parking.leave()
        self._tell("resumed", reason=reason, place=rounded(place))

    # what became of the target

    def _judge(self, scene: Scene, moved_on: bool) -> None:
        """Drop the target where it is resolved, in vain, or overdue; moved_on: whether a viewpoint was just kept."""
        target = self.target
        if target is None or target.task.kind == "park":
            return
        if is_end(target.task):
            task = self.goals.moved(target.task)
            if task is None:
                self._closed(scene, target)
                return
            target.task = task
        elif target.task.samples is not None:
            left, swept = self.sweep.left(target.task.samples, scene.here[None], NOBODY, scene.walls)
            if swept:
                self.viewpoints.keep(scene.tick, scene.here, 0.0)
                self.sweep.leave(left)
                self.target = None
                return
            if moved_on:
                target.task = target.task._replace(samples=left)
        if scene.awake > target.deadline:
            self._give_up("it took too long")
            return
        # an end is seen from nearby as well as from the point itself
        target.looks += target.within(OTHER_STAND_M if is_end(target.task) else ARRIVED_M, scene.here)
        due = self._ticks(LOOKS_S["glimpse"]) if self._may_close(scene, target) else target.looks_due
        if target.looks >= due and target.within(ARRIVED_M, scene.here):
            self._arrived(scene, target)

    def _may_close(self, scene: Scene, target: Target) -> bool:
        """Whether an end would be given up while the scan shows something beside it that may become its wall."""
        if not is_end(target.task) or target.stands_tried < STANDING_POINTS or not len(scene.glimpses):
            return False
        return bool(np.hypot(*(scene.glimpses - target.task.place).T).min() < SAME_M)

    def _closed(self, scene: Scene, target: Target) -> None:
        """The target's end is open no longer, as it was seen or flickers; or it is a teammate's business.

        Drives count that ended where the robot sees it, after more than a moment: ends flicker as robots come near.
        """
        self.target, place = None, target.task.place
        in_sight = math.hypot(*(place - scene.here)) <= self.spec.lidar.range_max_m
        if in_sight and self.goals.end_of(target.task) < 0 and scene.awake - target.chosen >= self._reconsider_ticks:
            self._events += self.goals.closed(target.task)

    def _arrived(self, scene: Scene, target: Target) -> None:
        """The robot has looked long enough from the standing point."""
        if is_end(target.task):
            self._looked(scene, target)
            return
        if target.task.kind == "sweep":
            self.viewpoints.keep(scene.tick, scene.here, 0.0)
        if target.task.kind == "errand":
            self._end_errand("arrived")
        if target.task.kind == "home":
            self._sd_at_home_m = scene.pose_sd_m
        self._done(target.task)
        self.target = None

    def _looked(self, scene: Scene, target: Target) -> None:
        """An end is still open: try another standing point, or give up."""
        tried = self.goals.looked(target.task)
        if target.stands_tried < STANDING_POINTS:
            for roads in self.surroundings.ways(scene):
                tasks = self.goals.tasks(np.array([self.goals.end_of(target.task)]), roads)
                if tasks:
                    new = self._pursue(scene, tasks[0], roads, target)
                    new.stands_tried, new.deadline = target.stands_tried + 1, self._deadline(scene, new.path)
                    return
        self._give_up(f"still open seen from {tried} standing points")

    def _give_up(self, reason: str) -> None:
        """Drop the target, and remember why."""
        target, self.target = self.target, None
        assert target is not None
        if is_end(target.task):
            self._events.append(self.goals.abandon(target.task.place, target.task.along, reason))
        elif target.task.kind == "errand":
            self._end_errand("no way")
        elif target.task.kind == "home":
            self.homing.give_up()
        elif target.task.kind != "look" or reason != TEAMMATE:  # who bars a look may have gone later
            self._done(target.task)

    def _end_errand(self, how: Literal["arrived", "no way"]) -> None:
        """Tell the team how the drive under way has ended."""
        assert self._errand is not None, "an errand that is taken back takes its target along"
        self._errand.ended = how

    def _done(self, task: Task) -> None:
        """The task is not to be proposed again: the robot stood where it asked, or could not."""
        self.states.done(task)
        self.homing.done(task)

    def _reconsiders(self, scene: Scene, target: Target) -> bool:
        """Whether the target is to be compared with other tasks, or its path is no longer good."""
        clearance_m = target.clearance - GIVE_M
        if not still_clear(target.path, self.surroundings.lasting, clearance_m):
            return True
        if target.task.kind == "errand":  # the peer itself may stand where the robot was to look for it
            x, y = target.task.stand.tolist()
            return self.surroundings.teammates.take(scene.tick, x, y, clearance_m)
        if target.task.kind in ("home", "look", "lap", "retreat", "wait", "park") or not len(self.goals.fresh()):
            return False
        if target.looks > 0 and target.within(ARRIVED_M, scene.here):
            return False
        if not is_end(target.task) and not self.config.pockets:
            return True
        return scene.awake - self._decided_tick >= self._reconsider_ticks and scene.version != self._decided_version

    # what to do next

    def _choose_frontier(self, scene: Scene, old: Target | None) -> Target | None:
        """The first task of a tour through fresh ends, or else through those to be tried again; None without any."""
        begun = None if old is None else old.task
        # close views, into slots, are tried where no other view of a fresh end can be had
        for ends, views in ((self.goals.fresh(), (False, True)), (self.goals.again(), (False,))):
            for close in views if len(ends) else ():
                for roads in self.surroundings.ways(scene):
                    tasks = self.goals.tasks(ends, roads, begun, close)
                    if tasks:
                        return self._pursue(scene, self._first(scene, tasks, roads, begun), roads, old)
            reason = TEAMMATE if self.surroundings.teammates.in_the_way(scene.tick) else "no way to a standing point"
            for end in ends:
                event = self.goals.abandon(self.goals.ends.points[end], self.goals.ends.along[end], reason)
                self._events.append(event)
        return None

    def _first(self, scene: Scene, tasks: list[Task], roads: Roads, begun: Task | None) -> Task:
        """The task that comes first, sweeps on the way included."""
        pockets = self.states.pockets(scene, roads, self.viewpoints, begun)
        mine = own_share(agenda_of(tasks + pockets, roads), roads, scene.partners, scene.silent)
        # where teammates do all open ends, a robot sweeps rather than follow them
        agenda = mine if mine.tasks else agenda_of(tasks, roads)
        return first_of_tour(agenda, self.config.pocket_detour_m, self.config.haste)

    def _choose_default(self, scene: Scene, old: Target | None) -> Target:
        """The next task of the default state, or wait for teammates that bar all there is, or complete and park."""
        if self.complete:
            return self._park(scene, old)
        tried = list[Roads]()
        for roads in self.surroundings.ways(scene):
            if old is not None and not is_end(old.task) and roads.reached(old.task.stand[None])[0]:
                return self._pursue(scene, old.task, roads, old)
            task = self.states.next(scene, roads, self.viewpoints)
            if task is not None:
                return self._pursue(scene, task, roads, None)
            tried.append(roads)
        if (home := self.homing.next(scene.exactness, tried)) is not None:
            return self._pursue(scene, home.task, home.roads, old)
        if self.surroundings.teammates.in_the_way(scene.tick) and self._waits < WAITS and self._barred(scene):
            return self._wait(scene)
        self.complete = True
        self._tell("complete", reason=self.states.ended(), unreachable=sum(map(bool, self.goals.reasons)))
        return self._park(scene, None)

    def _pursue(self, scene: Scene, task: Task, roads: Roads, old: Target | None) -> Target:
        """Make the task the target; where it is the old one's, go on with its deadline and counts."""
        route = roads.way_to(task.stand)
        assert route is not None, "tasks are made of standing points that are reached"
        looks_due = self._ticks(LOOKS_S[task.kind]) if task.kind in LOOKS_S else 1
        deadline = self._deadline(scene, route.path)
        self.target = Target(task, route.path, roads.clearance, deadline, looks_due, chosen=scene.awake)
        if old is not None and self.goals.same(old.task, task):
            self.target.chosen, self.target.deadline = old.chosen, old.deadline
            self.target.stands_tried, self.target.stuck = old.stands_tried, old.stuck
            self.headway.allow(length_of(route.path))
            return self.target
        self.homing.pursue(task)
        self.headway.restart(scene.awake)
        self._waits = 0
        if is_end(task):
            self._tell("frontier", what="chosen", place=rounded(task.place), cost=round(route.cost, 2))
        return self.target

    def _park(self, scene: Scene, old: Target | None) -> Target:
        """Where to wait once nothing is left to do; where the old target was that, it may stay."""
        roads = self.surroundings.tight_ways(scene)
        return self._park_at(scene, self.parking.choose(scene.here, self.viewpoints.own_places(), roads, old))

    def _park_at(self, scene: Scene, place: Target) -> Target:
        self.target = place
        self.headway.restart(scene.awake)
        return place

    def _step_aside(self, scene: Scene) -> Target | None:
        """Park elsewhere, nearby, so that who sees the robot can tell it from a post."""
        self.parking.meet(scene.strangers)
        if not self.parking.may_step_aside(scene.tick, scene.here, self.target):
            return None
        roads, again = self.surroundings.tight_ways(scene), scene.tick + self._ticks(AGAIN_S)
        place = self.parking.aside(again, scene.here, self.viewpoints.own_places(), roads)
        return None if place is None else self._park_at(scene, place)

    def _barred(self, scene: Scene) -> bool:
        """Whether there would be something to do if no teammate stood in the way."""
        if len(self.goals.again()):
            return True
        ways = self.surroundings.ways(scene, teammates=False)
        return any(self.states.next(scene, roads, self.viewpoints) for roads in ways)

    def _wait(self, scene: Scene) -> Target:
        """Stand until the teammates that bar all there is may have moved on."""
        self._waits += 1
        self.headway.restart(scene.awake)
        here, patience = Task("wait", scene.here, scene.here), self.headway.patience
        self.target = Target(here, scene.here[None], self.surroundings.tight_m, looks_due=patience)
        return self.target

    def _deadline(self, scene: Scene, path: Floats) -> float:
        """Tick of `Scene.awake` at which a target at the end of a path (k, 2) is given up."""
        turns_s = (len(path) - 1) * (self.headway.stuck_s - STUCK_S)  # at its start and bends, more than others take
        seconds = 2.0 * length_of(path) / self.spec.max_speed_mps + self.config.patience_s + turns_s
        return scene.awake + math.ceil(seconds / self.driver.tick_s)

    # how to get there

    def _drive(self, scene: Scene, target: Target) -> Motion:
        """The next motion along the target's path, or back. Here a robot finds that it is stuck, or long barred."""
        if scene.awake < self._back_off[0]:
            return self._drive_back(scene)
        target.path = ahead_of(target.path, scene.here, scene.walls, target.clearance)
        left_m = length_of(target.path)
        if left_m <= 0.5 * ARRIVED_M:
            self.headway.restart(scene.awake)
            return STOP
        motion = self.driver.follow(target.path, scene.pose, scene.near, target.clearance - GIVE_M)
        mate = self._held_by(scene, target) if motion.held else None
        pace = self.headway.judge(scene.awake, left_m, mate is not None)
        if pace == "stuck":
            self._stuck(scene, target)
        elif pace == "impatient" and mate is not None:
            self.surroundings.teammates.avoid(mate)
            self._make_room(scene, target, (mate.x, mate.y))
        return motion

    def _held_by(self, scene: Scene, target: Target) -> Teammate | None:
        """The teammate that holds the robot back: one close by, or farther off where no wall would hold it."""
        x, y = scene.here.tolist()
        mate = self.surroundings.teammates.near(x, y, self.driver.beside_m)
        if mate is None or math.dist((mate.x, mate.y), (x, y)) < self.driver.close_m:
            return mate
        alone = scene.near._replace(discs=NOBODY)
        motion = self.driver.follow(target.path, scene.pose, alone, target.clearance - GIVE_M)
        return None if motion.held else mate

    def _make_room(self, scene: Scene, target: Target, teammate: tuple[float, float]) -> None:
        """Make room for a teammate: plan around it, or go back to an own former place away from it."""
        kind = target.task.kind
        self._tell("stuck", place=rounded(scene.here), on_the_way_to=kind, reason="a teammate")
        for roads in self.surroundings.ways(scene):
            route = roads.way_to(target.task.stand)
            if route is not None:
                target.path, target.clearance = route.path, roads.clearance
                self.headway.restart(scene.awake)
                return
        route = standing.away_from(teammate, self.viewpoints.own_places(), scene.walls, roads)
        if kind not in ("retreat", "wait", "park"):
            self._give_up(TEAMMATE)
        if route is not None:
            stand, deadline = route.path[-1], self._deadline(scene, route.path)
            task = Task("retreat", stand, stand)
            self.target = Target(task, route.path, roads.clearance, deadline, self.headway.patience)
        self.headway.restart(scene.awake)

    def _stuck(self, scene: Scene, target: Target) -> None:
        """Back off, and give the target up the second time."""
        target.stuck += 1
        gives_up = target.stuck > 1 and target.task.kind != "park"
        unseen = self.surroundings.touch.pushes
        if unseen:
            self.surroundings.touch.remember(scene.tick, scene.pose)
        reason, recovery = "an unseen wall" if unseen else "no progress", "another goal" if gives_up else "back off"
        kind = target.task.kind
        self._tell("stuck", place=rounded(scene.here), on_the_way_to=kind, reason=reason, recovery=recovery)
        self.headway.restart(scene.awake)
        self._back_off = scene.awake + self._ticks(BACK_OFF_S), scene.here
        if gives_up:
            self._give_up("stuck on the way")
        elif target.stuck > 1:  # another one may have parked there
            self._park(scene, None)

    def _drive_back(self, scene: Scene) -> Motion:
        """Towards the most room within a short drive."""
        if math.hypot(*(scene.here - self._back_off[1])) >= BACK_OFF_M:
            self._back_off = -1, scene.here
            self.headway.restart(scene.awake)
        around = scene.here + BACK_OFF_M * circle(16)
        room = distances_to_walls(around, scene.near.walls)
        for x, y in scene.near.discs:
            room = np.minimum(room, np.hypot(around[:, 0] - x, around[:, 1] - y) - self.spec.radius_m)
        px, py = around[int(np.argmax(room))]
        return self.driver.towards((px, py), scene.pose, scene.near, BACK_OFF_M)

    def _command(self, motion: Motion, reason: str) -> Command:
        self.surroundings.touch.command(motion.speed_mps)
        place = None
        if self.target is not None:
            x, y = self.target.task.stand
            place = float(x), float(y)
        complete = self.complete and self._errand is None
        return Command(motion.speed_mps, motion.turn_rps, complete, reason, self._events, place)

    def _tell(self, event: str, **data: object) -> None:
        self._events.append(Event(event=event, data=data))

    def _ticks(self, seconds: float) -> int:
        return math.ceil(seconds * self.spec.lidar.rate_hz)
